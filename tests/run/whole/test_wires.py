"""The main paths of a run over every wire: motion by TCP, pty and paced serial line, in both
dialects; feeders by Modbus TCP and RTU.
"""

from __future__ import annotations

import pytest

from simulators.bench import Bench

PTY = ('endpoint = "tcp://127.0.0.1:2323"', 'endpoint = "pty"')
GRBL = (
    ('dialect = "grblhal"', 'dialect = "grbl"'), ("rx_bytes = 1024", "rx_bytes = 128"),
    ("planner_blocks = 100", "planner_blocks = 15"), ("10 = 511", "10 = 3"),
)
RTU = (
    ('endpoint = "modbus-tcp://127.0.0.1:5021"', 'endpoint = "pty"'),
    ('endpoint = "modbus-tcp://127.0.0.1:5022"', 'endpoint = "pty"'),
)
WIRES = {
    "grblhal-tcp-modbus-tcp": ((), False),
    "grblhal-pty-modbus-rtu": ((PTY, *RTU), False),
    "grblhal-serial-modbus-tcp": ((PTY,), True),
    "grbl-tcp-modbus-rtu": ((*GRBL, *RTU), False),
    "grbl-pty-modbus-tcp": ((PTY, *GRBL), False),
    "grbl-serial-modbus-rtu": ((PTY, *GRBL, *RTU), True),
}


@pytest.fixture(params=WIRES.values(), ids=WIRES)
def over(request, run, monkeypatch):
    """Runs a job over one set of wires."""
    bench, serial = request.param
    if serial:  # the same pty, which the host paces to 115,200 baud
        served = Bench._serve_motion

        async def as_serial(self, address):
            return (await served(self, address)).replace("pty://", "serial://")

        monkeypatch.setattr(Bench, "_serve_motion", as_serial)
    return lambda job, **options: run(job, bench=bench, **options)


def test_a_whole_run(over, square_job):
    one = over(square_job)
    assert one.error is None
    assert one.result.state == "done"
    assert one.path.length_mm.sum() == pytest.approx(64.0, abs=0.01)
    assert one.flow_error().max() < 0.02
    one.check_safe()


def test_hold_and_resume(over, large_square_job):
    one = over(large_square_job, acts=[
        (3.0, lambda r: r.executor.hold()), (20.0, lambda r: r.executor.resume()),
    ])
    assert one.error is None
    assert one.result.state == "done"
    assert "held" in one.states
    laid_mm = 2 * 3 * 4 * 12.0
    assert laid_mm - 0.01 < one.path.length_mm.sum() < laid_mm + 5.0
    one.check_safe()


def test_a_feeder_that_falls_silent(over, large_square_job):
    """The cable of F2 is pulled; the beam goes first, and nothing is claimed that was not done."""
    one = over(large_square_job, acts=[
        (3.0, lambda r: r.bench.edges["F2"].set_open(False)), (12.0, lambda r: r.executor.stop()),
    ])
    assert one.error is not None
    assert "held" in one.states
    (first, *_) = one.records("alarm")
    assert "F2" in first["what"]
    one.check_safe()
    assert one.path.time_s.max() < one.started_s + 3.0 + 3.5


@pytest.mark.parametrize(
    ("right", "wrong", "words"),
    [
        ("\n32 = 1\n", "\n32 = 0\n", "laser mode"),
        ("\n30 = 1000\n", "\n30 = 255\n", "full power"),
        ("\n10 = 511\n", "\n10 = 1\n", "status reports"),
        ("\n10 = 511\n", "\n10 = 511\n13 = 1\n", "reports in mm"),
        ("\n10 = 511\n", "\n10 = 511\n22 = 1\n", "soft limits"),
        ("\n130 = 300\n", "\n130 = 100\n22 = 1\n20 = 1\n", "travel of X"),
    ],
)
def test_a_controller_set_dangerously_gets_no_line_of_the_program(
    run, square_job, right, wrong, words
):
    one = run(square_job, bench=[(right, wrong)])
    assert one.result is None
    assert words in one.error.render()
    assert one.executed == []
    assert len(one.path.time_s) == 0
