"""What the simulated controller answers: oks, errors, overruns, and only what a controller says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.status import parse_status
from simulators.motion.config import MotionConfig
from simulators.motion.controller import SimulatedController
from simulators.motion.settings import SettingError
from tests.simulators.motion_cases import BOTH, LEAD_S


@BOTH
def test_ok_means_planned_and_a_full_planner_answers_no_more(rig, dialect):
    controller = rig(dialect, planner_blocks=15)
    lines = "".join(f"G1 X{x} F600\n" for x in range(1, 19))
    assert len(lines) > 127
    said = controller.send(lines[:120])
    count = lines[:120].count("\n")
    assert said == ["ok"] * count
    for line in [*lines[120:].splitlines(keepends=True), "G1 X19\n", "G1 X20\n"]:
        said += controller.send(line)
    assert len(said) == 15
    report = controller.status()
    assert (report.planner_blocks_free, report.state) == (0, "Run")
    assert report.rx_bytes_free < (128 if dialect == "grbl" else 1023)
    assert controller.wait(0.2 - LEAD_S[dialect] - 0.1) == []
    assert controller.wait(0.1) == ["ok"]
    assert controller.status().planner_blocks_free == 0
    said += controller.wait(60.0)
    assert controller.machine.position_mm() == (20.0, 0.0, 0.0)


@BOTH
def test_every_line_earns_one_answer_in_order(rig, dialect):
    controller = rig(dialect)
    said = controller.ask("G1 X1 F600\n\n(remark)\n$G\nG4 P0.1\nM3 S5\nG0 X0\n", 20.0)
    assert [line for line in said if line != "ok"] == [
        line for line in said if line.startswith("[GC:")
    ]
    assert said.count("ok") == 7


def test_grbl_runs_on_after_an_error_and_grblhal_does_not(rig):
    lines = "G1 X1 F600\nG1 X2 Q\nG1 X3\nG1 X4\n"
    assert rig("grbl").ask(lines, 5.0) == ["ok", "error:2", "ok", "ok"]
    controller = rig("grblhal")
    assert controller.ask(lines, 5.0) == ["ok", "error:2", "error:2", "error:2"]
    assert controller.machine.position_mm() == (1.0, 0.0, 0.0)
    for cure in ("\n", "$G\n", "\x18"):
        controller.ask("FOO\n", 0.1)
        controller.ask(cure, 0.1)
        assert controller.ask("G0 X5\n", 0.1) == ["ok"]


@BOTH
def test_an_overrun_is_lost_and_counted(rig, dialect):
    controller = rig(dialect, planner_blocks=2)
    controller.send("G1 X1 F60\nG1 X2\nG1 X3\n")
    for _ in range(60):
        controller.send("G1 X4.000 Y1.000 (filler)\n")
    assert controller.controller.device.overruns > 0


@BOTH
def test_too_long_a_line_is_refused_and_not_executed(rig, dialect):
    controller = rig(dialect)
    assert controller.ask("G0 X" + "0" * 300 + "9\n", 1.0) == ["error:11"]
    assert controller.machine.position_mm() == (0.0, 0.0, 0.0)


def test_grbl_never_reports_line_numbers_and_grblhal_keeps_the_last(rig):
    for dialect, expected in (("grbl", [None, None]), ("grblhal", [120, 130])):
        controller = rig(dialect)
        controller.ask("N120 G1 X10 F600\nN130 G1 X0\n", 0.5)
        first = controller.status().line_number
        controller.wait(10.0)
        assert [first, controller.status().line_number] == expected


@BOTH
def test_a_block_leaves_the_planner_before_its_motion_is_over(rig, dialect):
    controller = rig(dialect)
    blocks = controller.controller.machine.planner.capacity
    controller.ask("G1 X2 F600\n", 0.22 - LEAD_S[dialect] / 2)
    report = controller.status()
    assert (report.state, report.planner_blocks_free) == ("Run", blocks)
    assert report.machine_mm[0] < 2.0


@BOTH
def test_the_work_offset_is_reported_when_it_changes(rig, dialect):
    controller = rig(dialect)
    for _ in range(3):
        controller.status()
    controller.ask("G92 X5 Y-1\n", 0.1)
    assert controller.status().offset_mm == (-5.0, 1.0, 0.0)
    assert controller.status().offset_mm is None


@BOTH
def test_work_position_is_reported_where_the_mask_says_so(rig, dialect):
    controller = rig(dialect, settings={10: 2})
    controller.ask("G92 X5\n", 0.1)
    report = controller.status()
    assert (report.machine_mm, report.work_mm) == (None, (5.0, 0.0, 0.0))


def test_the_user_info_shows_a_bench(rig):
    assert "[VER:1.1f.20260817:lmctl-bench]" in rig("grblhal").ask("$I\n", 0.1)
    assert "[VER:1.1h.20190830:lmctl-bench]" in rig("grbl").ask("$I\n", 0.1)
    assert "[OPT:V,20,256]" in rig("grbl", planner_blocks=20, rx_bytes=256).ask("$I\n", 0.1)


def test_a_wrong_configuration_is_refused():
    with pytest.raises(ValueError, match=r"unknown dialect 'marlin'; known: grbl, grblhal"):
        SimulatedController(MotionConfig(dialect="marlin"))
    with pytest.raises(SettingError, match=r"\$20: error:10"):
        SimulatedController(MotionConfig(dialect="grbl", settings={20: 1}))


REALTIME = [bytes([b]) for b in b"?!~?!~\x84\x85\x91\x92\x96\x9b\x9e\xa0\x87\x18"]
LINES = [
    b"G1 X10 F1200 S500\n", b"G0 Y3\n", b"M4 S600\n", b"M3\n", b"M5\n", b"G4 P0.2\n", b"\n",
    b"$J=G91 X3 F600\n", b"$G\n", b"$X\n", b"$C\n", b"G2 X5 Y5 R4\n", b"FOO\n", b"G28\n", b"M8\n",
    b"G1 X0.1 F60\n", b"M0\n", b"M62 P1\n", b"N7 G1 Z1 F900\n", b"$H\n", b"$10=3\n", b"M30\n",
]  # fmt: skip
STEPS = st.lists(
    st.tuples(st.sampled_from(LINES + LINES + REALTIME), st.sampled_from([0.0, 0.01, 0.2, 3.0])),
    max_size=30,
)


@BOTH
@settings(deadline=None, max_examples=60)
@given(steps=STEPS)
def test_whatever_is_sent_it_says_only_what_a_controller_says(rig, dialect, steps):
    controller = rig(dialect, planner_blocks=4)
    said = []
    for data, wait in steps:
        said += controller.send(data) + controller.wait(wait)
    said += controller.wait(1000.0)
    for line in said:
        known = ("ok", "error:", "ALARM:", "[", "Grbl", "$")
        assert line == "" or line.startswith(known) or parse_status(line) is not None
    answers = sum(line == "ok" or line.startswith("error:") for line in said)
    assert answers <= sum(data.endswith(b"\n") for data, _ in steps)
    assert controller.controller.next_wake_s() is None
    t = np.linspace(0.0, controller.now_s, 5000)
    controller.machine.stepper.commit()
    speed = controller.trace.sample(t).speed_mm_s
    assert speed.min() >= 0.0
    assert speed.max() <= 100.0 * 3**0.5 + 1e-6
    ends = controller.trace.blocks().end_mm
    if len(ends):
        assert controller.machine.position_mm() == pytest.approx(tuple(ends[-1]), abs=0.003)
