"""Interlocks and faults in a run: beam and motion first, then powder; what can be gone on with."""

from __future__ import annotations

import errno
import os
import re
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from lmctl.errors import (
    JournalError,
    MachineError,
    RunFailedError,
    RunInterruptedError,
    RunStoppedError,
)
from lmctl.run.journal.format import verify_journal
from lmctl.run.journal.recorder import RunRecorder
from lmctl.run.journal.replay import replay_run
from lmctl.run.journal.run_folders import RunFolder
from lmctl.run.program.place import ProgramPlace
from simulators.faults.fault_injector import FaultInjector
from simulators.faults.kinds import Fault
from tests.run.whole.deposited import (
    BEAM_OFF_S,
    EXACT_MM,
    OVERLAP_MM,
    acts,
    check_all_is_laid,
    laid_again_mm,
)


def stop(one):
    one.executor.stop()


def reboot(one):
    """Another host's 0x18 in the middle of the stream: to this host the controller restarts."""
    one.bench.motion.receive(b"\x18")


def deafen(one):
    """The wire to the controller breaks; what it says still arrives."""
    one.bench.motion.receive = lambda data: None


def silence(one):
    one.bench.motion.detach_client()


def estop_chain(one):
    one.bench.feeders["F1"].set_estop_open(True)


def feeder_restarts(one):
    one.bench.feeders["F2"].restart()


def feeder_to_local(one):
    one.bench.feeders["F1"].set_local_mode(True)


#: What happens, in how many cycles of its feeder the host can know, and what it must say.
INTERLOCKS = {
    "estop": (estop_chain, 1, "emergency"),
    "feeder restarts": (feeder_restarts, 5, "feeder F2"),
}


def test_a_feeder_at_local_takes_no_orders_and_is_read_all_the_same(run, large_square_job):
    """It refuses the orders of a host, and says by its status that its discs stand."""
    one = run(large_square_job, acts=[(3.0, feeder_to_local), (20.0, stop)])
    assert isinstance(one.error, RunStoppedError)
    assert "LOCAL" in one.error.what
    assert "no answer" not in one.error.render()
    assert one.still_feeding == []
    assert len(one.standing_beam) == 0
    assert "held" in one.states


@pytest.mark.parametrize("name", INTERLOCKS)
def test_an_interlock_takes_beam_and_motion_down_first_and_waits(
    run, profile, large_square_job, name
):
    act, cycles, words = INTERLOCKS[name]
    seen_s = cycles * profile.feeder[0].watchdog_s / 4
    one = run(large_square_job, acts=[(3.0, act), (20.0, stop)])
    assert isinstance(one.error, RunStoppedError), one.error
    text = one.error.render()
    assert words.lower() in text.lower()
    assert "lmctl recover" in text
    assert len(one.standing_beam) == 0
    assert one.path.time_s.max() < one.started_s + 3.0 + seen_s + BEAM_OFF_S
    assert one.still_feeding == []
    assert one.states[-4:] == ["holding", "held", "stopping", "stopped"]
    assert [do for do in acts(one) if do.startswith(("feed hold", "powder off"))][:2] == [
        "feed hold", "powder off"]
    assert words.lower() in one.records("alarm")[0]["what"].lower()
    (seal,) = one.records("seal")
    assert seal["recoverable"]


def test_after_an_interlock_the_operator_goes_on_with_the_part(
    run, large_square_job, undisturbed
):
    """The disc of a feeder that was switched to LOCAL and back: alarms acknowledged, powder new."""
    one = run(large_square_job, acts=[
        (3.0, feeder_to_local), (20.0, lambda r: r.bench.feeders["F1"].set_local_mode(False)),
        (25.0, lambda r: r.executor.resume()),
    ])
    whole = undisturbed["large"]
    assert one.result.state == "done", one.error
    # Until the feeder was asked again, a second later, no reading showed it.
    assert one.bare_beam[:, 1].max() < one.started_s + 3.0 + 1.0 + BEAM_OFF_S
    one.bare_beam = []
    one.check_safe()
    check_all_is_laid(one, whole)
    assert laid_again_mm(one, whole) == pytest.approx(OVERLAP_MM, abs=EXACT_MM)


def test_a_restarted_controller_ends_the_run(run, large_square_job):
    one = run(large_square_job, acts=[(3.0, reboot)])
    assert isinstance(one.error, RunFailedError), one.error
    assert "the motion controller restarted" in one.error.render()
    assert one.path.time_s.max() < one.started_s + 3.0 + BEAM_OFF_S
    assert one.still_feeding == []
    assert one.states[-2:] == ["tripped", "faulted"]
    assert "restarted" in one.records("fault")[0]["what"]
    assert one.records("seal")[0]["state"] == "faulted"


@pytest.mark.parametrize("act", [deafen, silence])
def test_without_a_host_the_controller_runs_dry_within_the_send_horizon(
    run, large_square_job, act
):
    one = run(large_square_job, acts=[(3.0, act)])
    assert isinstance(one.error, RunFailedError)
    assert "the motion controller has not reported for" in one.error.what
    assert one.path.time_s.max() < one.started_s + 3.0 + 1.0 + BEAM_OFF_S
    assert len(one.standing_beam) == 0
    assert one.still_feeding == []
    assert one.records("seal")[0]["state"] == "faulted"


def test_a_locked_machine_is_refused_and_left_alone(run, square_job):
    """Grbl with homing on ($22=1) starts in alarm until it is homed."""
    one = run(square_job, bench=[('dialect = "grblhal"', 'dialect = "grbl"'),
                                 ("10 = 511", "10 = 3\n22 = 1")])
    assert isinstance(one.error, MachineError)
    assert "alarm" in one.error.render()
    assert "lmctl machine home" in one.error.hint
    assert one.executed == []
    assert one.states == ["connecting", "checking", "faulted"]


@pytest.mark.parametrize("bench", [
    [], [('dialect = "grblhal"', 'dialect = "grbl"'), ("10 = 511", "10 = 3")],
])
def test_a_line_damaged_on_its_way_stops_the_run_at_once(run, large_square_job, bench):
    def damage(one):
        receive = one.bench.motion.receive
        left = [1]

        def damaged(data):
            if b" G1 " in data and left:
                left.clear()
                data = data.replace(b" G1 ", b" G9 ", 1)
            receive(data)

        one.bench.motion.receive = damaged

    one = run(large_square_job, bench=bench, acts=[(3.0, damage)])
    assert isinstance(one.error, RunInterruptedError)
    rejected = int(re.search(r"program line (\d+) was damaged on its way", one.error.render())[1])
    after = replay_run(RunFolder(one.journal.parent))  # a line once damaged does not end the part
    assert ProgramPlace(rejected - 20) < after.proven_place <= ProgramPlace(rejected)
    assert len(one.standing_beam) == 0
    assert one.path.time_s.max() < one.started_s + 4.5
    assert one.still_feeding == []


@pytest.mark.parametrize("bench", [
    [], [('dialect = "grblhal"', 'dialect = "grbl"'), ("10 = 511", "10 = 3")],
])
@pytest.mark.parametrize(("word", "becomes"), [
    (rb" X(\d)", rb" X"), (rb" Y(\d)(\d)", rb" Y\2\1"), (rb" X(\d)(\d)", rb" X\1"),
])
def test_a_place_damaged_on_its_way_is_seen_by_where_the_nozzle_goes(
    run, large_square_job, undisturbed, bench, word, becomes
):
    """A controller takes it for a line like any other: its answer is `ok`."""
    def damage(one):
        receive = one.bench.motion.receive

        def damaged(data):
            if b" G1 " in data:
                one.bench.motion.receive = receive
                data = re.sub(word, becomes, data, count=1)
            receive(data)

        one.bench.motion.receive = damaged

    one = run(large_square_job, bench=bench, acts=[
        (3.0, damage), (20.0, lambda r: r.executor.resume()),
    ])
    (alarm,) = one.records("alarm")
    assert "off the programmed path" in alarm["what"]
    assert one.result.state == "done"
    one.check_safe()
    whole = undisturbed["large"]
    there, wanted = cKDTree(one.path.position_mm), cKDTree(whole.path.position_mm)
    assert there.query(whole.path.position_mm)[0].max() < EXACT_MM  # none is missing
    astray = wanted.query(one.path.position_mm)[0] > EXACT_MM
    assert 0 < one.path.length_mm[astray].sum() < 6.0  # what two status periods at 10 mm/s draw


def garble(letter, percent):
    def strike(one):
        FaultInjector(one.bench).inject(Fault.create("word_garbled", letter=letter,
                                                     percent=percent))

    return strike


@pytest.mark.parametrize("bench", [
    [], [('dialect = "grblhal"', 'dialect = "grbl"'), ("10 = 511", "10 = 3")],
])
@pytest.mark.parametrize(("letter", "percent"), [
    ("S", 0.0), ("S", 10.0), ("S", 120.0), ("F", 20.0), ("F", 150.0),
])
def test_a_feed_or_power_damaged_on_its_way_is_seen_by_the_next_two_reports(
    run, large_square_job, undisturbed, bench, letter, percent
):
    one = run(large_square_job, bench=bench, acts=[
        (3.0, garble(letter, percent)), (30.0, lambda r: r.executor.resume()),
    ])
    whole = undisturbed["large"]
    (alarm,) = one.records("alarm")
    assert "the program asks for" in alarm["what"]
    assert one.result.state == "done", one.error
    one.check_safe()
    check_all_is_laid(one, whole)
    usual_J_mm = np.median(whole.path.power_fraction * whole.path.duration_s
                           / whole.path.length_mm)
    energy_J_mm = one.path.power_fraction * one.path.duration_s / one.path.length_mm
    wrong = np.abs(energy_J_mm / usual_J_mm - 1.0) > 0.1
    assert one.path.length_mm[wrong].sum() < 6.0  # what two status periods at 10 mm/s lay


@pytest.mark.parametrize("bench", [
    [], [('dialect = "grblhal"', 'dialect = "grbl"'), ("10 = 511", "10 = 3")],
])
def test_a_wait_cut_short_on_its_way_is_seen_as_soon_as_it_is_over(
    run, tmp_path, profile, job_file, bench
):
    (rows, *_) = layers = job_file.squares(layers=1, per_layer=3, side_mm=12.0)
    second = next(i for i, row in enumerate(rows) if row[3] == 1)
    rows.insert(second, ("dwell", rows[second - 1][1], 8.0, -1))
    job_file(tmp_path / "job.lmj", profile, layers)
    one = run(tmp_path / "job.lmj", bench=bench, acts=[
        (3.0, garble("P", 10.0)), (30.0, lambda r: r.executor.resume()),
    ])
    whole = run(tmp_path / "job.lmj", bench=bench)
    assert whole.records("alarm") == []
    (alarm,) = one.records("alarm")
    assert re.search(r"the nozzle is (6\.9|7\.[0-3]) s ahead of the program", alarm["what"])
    assert one.result.state == "done", one.error
    one.check_safe()
    check_all_is_laid(one, whole)
    assert laid_again_mm(one, whole) < 6.0


def test_a_job_altered_while_it_runs_ends_the_run(run, tmp_path, profile, job_file):
    job_file(tmp_path / "job.lmj", profile, job_file.squares(layers=4, per_layer=3, side_mm=12.0))

    def alter(one):
        (copy,) = tmp_path.glob("bench-*/runs/*/job.lmj")
        data = bytearray(copy.read_bytes())
        at = data.rindex(b"S500")
        data[at:at + 4] = b"S999"
        copy.write_bytes(data)

    one = run(tmp_path / "job.lmj", acts=[(1.0, alter)])
    assert isinstance(one.error, RunFailedError)
    assert "job.lmj" in one.error.what
    assert "plan the part again" in one.error.hint
    assert len(one.standing_beam) == 0
    assert one.still_feeding == []
    assert one.states[-2:] == ["tripped", "faulted"]


@pytest.fixture
def fill_disk(monkeypatch):
    def fill(*_):
        def write(fd, data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        full = SimpleNamespace(**{**vars(os), "write": write})
        monkeypatch.setattr("lmctl.run.journal.writer.os", full)

    return fill


def test_a_disk_that_is_full_when_all_is_done_keeps_no_feeder_from_being_given_back(
    run, square_job, fill_disk, monkeypatch
):
    seal = RunRecorder.seal
    monkeypatch.setattr(RunRecorder, "seal",
                        lambda *args, **fields: (fill_disk(), seal(*args, **fields)))
    one = run(square_job)
    assert isinstance(one.error, JournalError)
    assert one.states[-1] == "done"
    # run() has waited for a minute since: a feeder left alone would have tripped its watchdog.
    assert {int(feeder.command) for feeder in one.bench.feeders.values()} == {0}  # given back


def test_a_full_disk_ends_the_run_safely(run, large_square_job, fill_disk, monkeypatch):
    one = run(large_square_job, acts=[(3.0, fill_disk)])
    monkeypatch.undo()
    assert isinstance(one.error, RunFailedError)
    assert "No space left on device" in one.error.render()
    assert len(one.standing_beam) == 0
    assert one.still_feeding == []
    found = verify_journal(one.journal)
    assert found.intact
    assert not found.sealed  # it could not be
    assert one.path.time_s.max() < one.started_s + 3.0 + 5.0
