"""What the devices report, handed on: progress to the deposition, trouble in words to the run."""

from __future__ import annotations

from collections.abc import Callable

from firmware_protocol.codes import alarm_meaning, error_meaning
from firmware_protocol.status import StatusReport
from lmctl.errors import JobError, MachineError
from lmctl.machine.feeder import FeederDriver
from lmctl.machine.feeder_status import FeederListener, FeederStatus
from lmctl.machine.motion import MotionListener
from lmctl.run.cell import Cell
from lmctl.run.deposition import Deposition

Failed = Callable[[Exception], None]


def watch(
    cell: Cell, deposition: Deposition, failed: Failed, held: Callable[[], None]
) -> None:
    """Listen to every device of the cell from now on.

    failed : called with each reason why the run cannot go on; the first one counts
    held : called while the machine reports a hold, whoever asked for it
    """
    cell.motion.listener = _motion_listener(cell, deposition, failed, held)
    for feeder in cell.feeders:
        feeder.listener = _feeder_listener(cell, feeder, failed)


def _motion_listener(
    cell: Cell, deposition: Deposition, failed: Failed, held: Callable[[], None]
) -> MotionListener:
    dialect = cell.motion.identity.dialect
    behind_door = False

    def status(report: StatusReport) -> None:
        nonlocal behind_door
        deposition.on_status(report)
        if report.state == "Hold":
            held()
        elif report.state == "Door" and not behind_door:
            behind_door = True
            failed(MachineError("the safety door was opened during the run",
                                hint="close it, look at the part, and start the run anew"))
        cell.reported()

    def rejected(tag: int, code: int) -> None:
        meaning = error_meaning(code, dialect)
        failed(JobError(f"program line {tag} was rejected: {meaning.words}",
                        where=f"error {code} of the motion controller", hint=meaning.remedy))

    def alarm(code: int) -> None:
        meaning = alarm_meaning(code, dialect)
        failed(MachineError(f"the motion controller is in alarm: {meaning.words}",
                            where=f"alarm {code}", hint=meaning.remedy))

    def restarted() -> None:
        failed(MachineError("the motion controller restarted in the middle of the run",
                            where="its position is lost",
                            hint="look for a loose power or reset line, then home the machine"))

    def lost(reason: str) -> None:
        failed(MachineError(f"the motion controller is lost: {reason}",
                            where="it runs dry and the beam goes out within the send horizon",
                            hint="check cable and power of the controller"))

    return MotionListener(
        on_progress=deposition.on_progress, on_status=status, on_error=rejected, on_alarm=alarm,
        on_restart=restarted, on_lost=lost,
    )


def _feeder_listener(cell: Cell, feeder: FeederDriver, failed: Failed) -> FeederListener:
    def status(_: FeederStatus) -> None:
        cell.reported()

    def fault(reason: str) -> None:
        failed(feeder.fault or MachineError(f"feeder {feeder.name}: {reason}"))

    return FeederListener(on_status=status, on_fault=fault)
