"""Runs that leave nothing to recover, or do not say from where; and recoveries that never began."""

from __future__ import annotations

import asyncio

import pytest

from lmctl.errors import JournalError, MachineError, RunFailedError, RunInterruptedError
from lmctl.job.reader import JobReader
from lmctl.run.executor import EarlierRun, RunExecutor
from lmctl.run.journal.format import read_records
from lmctl.run.journal.recovery import find_recovery_place, refuse_finished
from lmctl.run.journal.replay import continuing_runs, replay_run
from lmctl.run.journal.run_folders import RunFolder
from lmctl.run.program.place import JOB_START, Known, ProgramPlace, known_place
from lmctl.run.state.transitions import RunState
from simulators import virtual_time
from tests.run.whole.broken_off import broken_off, changed_header, seen
from tests.run.whole.conftest import wired

PLACE = ProgramPlace(30, 0.5)
STOOD_MM = (31.0, 32.5, 0.5)  # which is not that place: the run before had left the part


@pytest.fixture(params=[True, False], ids=["position kept", "position lost"])
def unentered(request, whole, profile, tmp_path):
    """A run that was to go on at PLACE, and found the cell switched off."""
    dead = wired(profile, {"motion": "tcp://127.0.0.1:9"} | {
        feeder.name: "modbus-tcp://127.0.0.1:9" for feeder in profile.feeder})
    reached = known_place(PLACE, Known.REPORTED)
    going_on = EarlierRun("run-0001", reached, is_position_trusted=request.param,
                          standstill_mm=STOOD_MM)

    async def main():
        await RunExecutor(whole.job, dead, tmp_path / "runs", continues=going_on).run()

    (tmp_path / "runs" / "run-0001").mkdir(parents=True)
    with pytest.raises(MachineError, match="devices of the cell failed"):
        virtual_time.run_in_virtual_time(main())
    return RunFolder(tmp_path / "runs" / "run-0002"), request.param


@pytest.mark.parametrize("sealed", [True, False], ids=["sealed", "killed"])
def test_a_recovery_that_never_entered_the_part_is_recovered_from_where_it_was_to(
    unentered, sealed, profile
):
    made, kept = unentered
    if not sealed:
        lines = made.journal.read_bytes().splitlines(keepends=True)
        made.journal.write_bytes(lines[0])
    after = replay_run(made)
    assert after.has_begun
    with JobReader(made.job) as job:
        found = find_recovery_place(job, after, seen(STOOD_MM), profile)
        elsewhere = find_recovery_place(job, after, seen((40.0, 30.0, 0.5)), profile)
        blind = find_recovery_place(job, after, seen(None), profile)
    assert {one.reached.place for one in (found, elsewhere, blind)} == {PLACE}
    assert (found.lost == "") is kept
    assert elsewhere.lost
    assert blind.lost


def test_a_recovery_that_does_not_say_where_it_was_to_go_on_is_no_start_from_nothing(
    whole, tmp_path
):
    made = changed_header(tmp_path / "run-0002", whole, 4, continues="run-0001")
    with pytest.raises(JournalError, match="does not say where"):
        replay_run(made)
    # Where it has come to the part, its own records say it.
    records = list(read_records(whole.journal))
    laid = next(i for i, record in enumerate(records) if record["kind"] == "executed")
    made = changed_header(tmp_path / "run-0002", whole, laid + 1, continues="run-0001")
    assert replay_run(made).proven_place > JOB_START


def test_a_run_that_has_executed_every_line_leaves_nothing_to_recover(
    whole, run, square_job, profile, tmp_path
):
    """A fault while gas runs on: the part is made, and no command leads astray."""

    async def when_finishing(one):
        while one.executor.state is not RunState.FINISHING:  # noqa: ASYNC110
            await asyncio.sleep(0.01)
        one.executor._live.machine.trip(MachineError("gas did not stop"))

    one = run(square_job, acts=[
        (0.0, lambda one: setattr(one, "waiting", asyncio.create_task(when_finishing(one)))),
    ])
    assert type(one.error) is RunFailedError
    assert not isinstance(one.error, RunInterruptedError)
    assert "recover" not in one.error.hint
    with pytest.raises(JournalError, match="nothing is left") as refused:
        replay_run(RunFolder(one.journal.parent))
    assert refused.value.where == ("gas did not stop",)
    # Nor does a host that dies then, or while the nozzle leaves the part.
    records = list(read_records(whole.journal))
    finishing = next(i for i, r in enumerate(records) if r.get("to") == RunState.FINISHING)
    with pytest.raises(JournalError, match="nothing is left"):
        replay_run(broken_off(tmp_path / "run-0001", whole, finishing + 1))
    after = replay_run(broken_off(tmp_path / "run-0001", whole, finishing))
    with JobReader(after.run.job) as job:
        place = find_recovery_place(job, after, seen(None), profile).reached.place
        with pytest.raises(JournalError, match="nothing is left"):
            refuse_finished(job, after, place, profile.motion)
        refuse_finished(job, after, JOB_START, profile.motion)
        refuse_finished(job, after, PLACE, profile.motion)


def test_a_run_that_ended_before_its_part_is_not_said_to_have_a_bad_job(
    run, square_job, profile
):
    one = run(square_job, before=lambda one: one.loop.call_later(0.5, one.executor.stop))
    with pytest.raises(JournalError, match="before it began") as refused:
        replay_run(RunFolder(one.journal.parent))
    assert "lmctl run" in refused.value.hint


def test_a_journal_no_one_can_read_keeps_no_other_run_from_being_recovered(whole, tmp_path):
    first = broken_off(tmp_path / "run-0002", whole, 30)
    for name, data in (("run-0001", b"\0" * 100 + b"\n"), ("run-0003", b"\0" * 100 + b"\n"),
                       ("run-0004", b'{"format":"lmctl-journal-9"}\n')):
        (tmp_path / name).mkdir()
        (tmp_path / name / "journal.jsonl").write_bytes(data)
    assert continuing_runs(first) == ("", ["run-0003", "run-0004"])
    changed_header(tmp_path / "run-0005", whole, 4, continues="run-0002")
    assert continuing_runs(first) == ("run-0005", ["run-0003", "run-0004"])
