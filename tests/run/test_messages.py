"""What is told where a run cannot begin, go on or be asked: what is wrong, where, and what next."""

from __future__ import annotations

import asyncio
import shutil
import socket
import threading
from importlib.resources import files
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from lmctl.config.machine import load_profile
from lmctl.errors import JobError, JournalError, MachineError, UsageError
from lmctl.run.cell import acceptance
from lmctl.run.cell.beam_control import BeamControl
from lmctl.run.cell.devices import Cell
from lmctl.run.cell.ownership import lock_machine
from lmctl.run.control.client import send_request
from lmctl.run.control.socket_path import SOCKET_NAME, connect_to_run
from lmctl.run.execution.device_monitor import DeviceMonitor
from lmctl.run.execution.run_segment import RunSegmentFactory
from lmctl.run.executor import RunExecutor
from lmctl.run.interlocks.alarms import InterlockError
from lmctl.run.journal import run_folders
from lmctl.run.journal.format import line_hashes
from lmctl.run.journal.replay import replay_run
from lmctl.run.journal.run_folders import RunFolder, create_run_folder
from lmctl.run.journal.writer import JournalWriter
from lmctl.run.powder import purge_measurement
from lmctl.run.powder.refill import RefillProcedure
from simulators import virtual_time
from tests.error_facts import assert_states


@pytest.fixture
def profile():
    return load_profile(files("lmctl.examples") / "cell.toml")



# --- folders and journals ---------------------------------------------------------------------


def test_a_folder_of_runs_that_is_none(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "job.lmj").write_text("")
    for runs, fact in (("file", "is not a folder"), ("/proc/runs", "cannot write /proc/runs")):
        with pytest.raises(JournalError) as refused:
            create_run_folder(tmp_path / runs, tmp_path / "job.lmj")
        assert_states(refused.value, fact)


def test_a_run_without_a_journal_and_one_without_records(tmp_path: Path) -> None:
    made = RunFolder(tmp_path / "run-0001")
    made.path.mkdir()
    with pytest.raises(JournalError) as refused:
        replay_run(made)
    assert_states(refused.value, "run-0001 has no journal", "lmctl jobs")
    made.journal.write_text("")
    with pytest.raises(JournalError) as refused:
        list(line_hashes(made.journal))
    assert_states(refused.value, "is not what was written", "it holds no record")


def test_a_run_that_is_still_going_is_not_recovered(tmp_path: Path) -> None:
    made = RunFolder(tmp_path / "run-0001")
    made.path.mkdir()
    with JournalWriter(made.journal, {"lines": 9}, local={}):
        with pytest.raises(JournalError) as refused:
            replay_run(made)
        assert_states(refused.value, "run-0001 is still running", "lmctl status", "lmctl stop")


def test_a_job_that_changes_while_it_is_read(tmp_path, profile, job_file, monkeypatch) -> None:
    job = tmp_path / "job.lmj"
    job_file(job, profile)
    copied = run_folders.create_run_folder

    def after_another_was_planned(runs_dir, of):
        made = copied(runs_dir, of)
        job_file(made.job, profile, peaks={"A": 9.0, "B": 9.0})
        return made

    monkeypatch.setattr(run_folders, "create_run_folder", after_another_was_planned)
    with pytest.raises(JobError) as refused:
        virtual_time.run_in_virtual_time(RunExecutor(job, profile, tmp_path / "runs").run())
    assert_states(refused.value, "changed while it was read")


# --- who has the machine, and who asks --------------------------------------------------------


def test_locks_that_cannot_be_had(tmp_path, profile, monkeypatch) -> None:
    monkeypatch.setattr("lmctl.run.cell.ownership.FOLDERS", (tmp_path,))
    locks = tmp_path / "lmctl-locks"
    locks.write_text("")
    with pytest.raises(MachineError) as refused, lock_machine(profile, "run-0001", tmp_path):
        pass
    assert_states(refused.value, f"{locks} is not a folder", "remove it")
    locks.unlink()
    with lock_machine(profile, "run-0001", tmp_path):
        names = [path.name for path in locks.iterdir()]
    shutil.rmtree(locks)
    for name in names:
        (locks / name).mkdir(parents=True)
    with pytest.raises(MachineError) as refused, lock_machine(profile, "run-0001", tmp_path):
        pass
    assert_states(refused.value, "no lock can be had on the machine", "Is a directory",
                  "permissions")


def test_a_run_that_answers_nonsense(tmp_path: Path) -> None:
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listening.bind(str(tmp_path / SOCKET_NAME))
    listening.listen()

    def answer() -> None:
        peer, _ = listening.accept()
        peer.recv(1000)
        peer.sendall(b"state: depositing\n")
        peer.close()

    answering = threading.Thread(target=answer)
    answering.start()
    with pytest.raises(JournalError) as refused:
        send_request(tmp_path, "status")
    answering.join()
    listening.close()
    assert_states(refused.value, "answers makes no sense", "another version of lmctl")


def test_a_socket_that_cannot_be_connected_to(tmp_path: Path) -> None:
    (tmp_path / SOCKET_NAME).symlink_to("/" + "s" * 200)
    with pytest.raises(JournalError) as refused:
        connect_to_run(tmp_path)
    assert_states(refused.value, "cannot be reached", "only the user who runs it")


def test_acts_that_a_run_has_no_use_for(tmp_path, profile) -> None:
    executor = RunExecutor(tmp_path / "job.lmj", profile, tmp_path)
    with pytest.raises(UsageError) as refused:
        executor.enter_height(8.0)
    assert_states(refused.value, "no height is asked for in this run", "height_check_every")
    refilling = RefillProcedure(profile.hopper, SimpleNamespace())
    refilling.request_refill("A")
    with pytest.raises(UsageError) as refused:
        refilling.request_refill("B")
    assert_states(refused.value, "hopper A is being refilled", "one hopper after the other")


# --- the cell ---------------------------------------------------------------------------------


class Controller:
    """A motion controller that answers every command with the same lines."""

    def __init__(self, *lines: str, at_mm=(10.0, 10.0, 20.0), trusted: bool = True) -> None:
        self.lines, self.position_mm, self.position_trusted = lines, at_mm, trusted
        self.status = SimpleNamespace(state="Idle", substate=None, is_held=False)

    async def send_command(self, line: str) -> list[str]:
        return list(self.lines)

    async def reset(self) -> None:
        pass


@pytest.mark.parametrize(
    ("lines", "facts"),
    [
        (("[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]",),
         ("did not arm the beam at zero", "it says [GC:", "after M4 S0", "reset the controller")),
        (("[GC:G0 G5\x7f",),
         ("answers are unreadable", "whether the beam is at zero", "cable and earthing")),
        ((), ("answers are unreadable", "nothing readable")),
    ],
)
def test_a_beam_that_is_not_armed(lines: tuple[str, ...], facts: tuple[str, ...]) -> None:
    cell = SimpleNamespace(motion=Controller(*lines), safety=None)
    with pytest.raises(MachineError) as refused:
        asyncio.run(BeamControl(cell).arm())
    assert_states(refused.value, *facts)


def test_a_position_that_was_lost_while_the_machine_came_to_rest() -> None:
    cell = SimpleNamespace(motion=Controller(trusted=False), safety=None)
    with pytest.raises(MachineError) as refused:
        asyncio.run(BeamControl(cell).come_to_rest())
    assert_states(refused.value, "position is no longer known", "home the machine", "lmctl recover")


@pytest.mark.parametrize(
    ("at_mm", "state", "facts"),
    [
        ((10.0, 12.5, 20.0), "Idle",
         ("the machine is at X10.000 Y12.500 Z20.000, not at the purge position",
          "did not come about within 5 s", "cable and earthing")),
        ((10.0, 12.5, 20.0), "Run", ("the move to the purge position did not come about",)),
    ],
)
def test_a_machine_that_does_not_arrive(at_mm, state: str, facts: tuple[str, ...]) -> None:
    motion = Controller(at_mm=at_mm)
    motion.status.state = state
    cell = Cell(motion, [], None, [])
    with pytest.raises(MachineError) as refused:
        virtual_time.run_in_virtual_time(cell.wait_at_position((10.0, 10.0, 20.0), 5.0))
    for fact in facts:
        assert fact in refused.value.render()


def test_all_that_keeps_a_run_from_starting_is_told_at_once() -> None:
    with pytest.raises(MachineError) as refused:
        acceptance.refuse_unready([
            InterlockError("door", "the door is open", hint="close it"),
            InterlockError("chiller", "the chiller is warm", hint="wait"),
        ])
    assert_states(refused.value, "the cell is not ready", "the door is open", "the chiller is warm")
    assert refused.value.hint == "close it; wait"


def test_a_machine_that_stands_elsewhere_than_when_its_recovery_was_decided_on() -> None:
    continues = SimpleNamespace(standstill_mm=(10.0, 12.5, 20.0), run="run-0003")
    with pytest.raises(MachineError) as refused:
        acceptance._refuse_displaced(Controller(at_mm=(0.0, 0.0, 0.0)), continues)
    assert_states(refused.value, "says another place than a moment ago",
                  "it reports X0.000 Y0.000 Z0.000", "reported X10.000 Y12.500 Z20.000 before",
                  "DTR", "recover run-0003 again")
    acceptance._refuse_displaced(Controller(at_mm=(10.0, 12.5, 20.0)), continues)


def test_deposition_that_ended_nowhere_known_is_not_gone_on_with() -> None:
    with pytest.raises(MachineError) as refused:
        RunSegmentFactory.create(SimpleNamespace(), SimpleNamespace(is_doubtful=True), None, 100)
    assert_states(refused.value, "where deposition ended is not known", "lmctl recover")


# --- powder -----------------------------------------------------------------------------------


class SilentScale:
    """A catch scale at the purge position whose answers get lost."""

    period_s, resolution_g = 0.2, 0.01

    def error(self, what: str, hint: str) -> MachineError:
        return MachineError(f"catch scale: {what}", hint=hint)

    async def read(self) -> None:
        return None


@pytest.mark.parametrize(
    ("more_noise", "slope", "facts"),
    [(50.0, 1.0, ("does not follow the pulses", "at the purge position")),
     (1.0, 0.4, ("catches 0.40 of what is fed", "onto its pan"))],
)
def test_powder_that_is_not_that_of_the_pulses(more_noise, slope, facts) -> None:
    found = SimpleNamespace(whitened_residual=np.zeros(9), more_noise=more_noise,
                            slopes=[SimpleNamespace(value=slope)])
    with pytest.raises(MachineError) as refused:
        purge_measurement._refuse_other_powder(found, SilentScale())
    assert_states(refused.value, "catch scale", *facts)


def test_a_purge_whose_readings_get_lost() -> None:
    pulses = SimpleNamespace(weigh_from_s=0.0, end_s=2.0, lows_g_min=(1.0, 1.0), changes=())

    async def main() -> None:
        own = SimpleNamespace(_loop=asyncio.get_running_loop())
        await purge_measurement.PurgeMeasurement._pulsed(
            own, SimpleNamespace(), pulses, SilentScale())

    with pytest.raises(MachineError) as refused:
        virtual_time.run_in_virtual_time(main())
    assert_states(refused.value, "it gave too few readings", "check its cable")


def test_a_refilled_hopper_that_never_feeds_steadily(profile) -> None:
    hopper = profile.hopper[0]
    feeder = SimpleNamespace(name=hopper.feeder, status=None, request_hopper_readings=lambda: None)
    cell = Cell(SimpleNamespace(), [feeder], None, [hopper])
    refilling = RefillProcedure([hopper], SimpleNamespace())
    refilling._unproven = [hopper]
    with pytest.raises(InterlockError) as refused:
        virtual_time.run_in_virtual_time(refilling.prove_flow(cell))
    assert_states(refused.value, "hopper A does not feed steadily after its refill",
                  "it has not been read", "bridged or damp powder")


def test_a_door_that_was_opened_and_closed_holds_the_run() -> None:
    raised: list[InterlockError] = []
    monitor = SimpleNamespace(_raise=raised.append)
    DeviceMonitor._check_hold(
        monitor, SimpleNamespace(state="Door", substate=0, is_held=False))
    assert_states(raised[0], "the safety door was opened, and is closed again", "look at the part")
