"""One look at a motion controller: it is asked, and nothing is moved, written or reset.

Opening a serial port restarts some boards (AVR with auto-reset); nothing can be done about that
from here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from firmware_protocol.status import StatusReport
from lmctl.errors import MachineError
from lmctl.machine.motion.callbacks import ConnectionCallbacks
from lmctl.machine.motion.connection import GrblConnection
from lmctl.machine.motion.driver import MotionDriver
from lmctl.machine.motion.handshake import first_report, query_homed, query_identity
from lmctl.machine.motion.identity import (
    ControllerIdentity,
    is_homing_enabled,
    parse_settings,
    parse_work_offset,
)

_COMMAND_S = 3.0
_PERIOD_S = 1.0  # of status reports; none is asked for beyond those waited for
_ANSWERING = ("Idle", "Alarm")  # states in which `$` commands are answered


@dataclass(frozen=True)
class MotionReading:
    """What a controller reports of itself: all that the conditions of a run look at.

    identity, settings, parser_state, offsets : None or empty where it does not answer in its state;
        parser_state and offsets are the lines of `$G` and `$#`
    is_position_trusted : whether reported positions are those of the machine
    position_doubt : why they are not, where that is known; else ""
    is_homed : whether it reports its axes homed; None where it does not (Grbl never does)
    damaged_message_count : messages that made no sense on the way
    is_taken_over : whether this host has taken it over, as a run does: it has been brought to rest
    """

    report: StatusReport
    identity: ControllerIdentity | None
    settings: dict[int, str]
    parser_state: Sequence[str]
    offsets: Sequence[str]
    is_position_trusted: bool
    is_homed: bool | None
    damaged_message_count: int
    is_taken_over: bool = False
    position_doubt: str = ""

    @property
    def offset_mm(self) -> tuple[float, ...] | None:
        """Work offset in force (work = machine - offset), or None where it is not reported."""
        return parse_work_offset(self.parser_state, self.offsets) if self.offsets else None

    @property
    def position_mm(self) -> tuple[float, ...] | None:
        """Program coordinates, None where they are not known."""
        if self.report.work_mm is not None or self.report.machine_mm is None:
            return self.report.work_mm
        offset_mm = self.report.offset_mm or self.offset_mm
        if offset_mm is None:
            return None
        return tuple(m - o for m, o in zip(self.report.machine_mm, offset_mm, strict=False))


async def inspect_controller(endpoint: str, *, baud: int, timeout_s: float = 5.0) -> MotionReading:
    """Read a controller's identity and state.

    Raises MachineError where it is unreachable, silent or no Grbl; ConfigError for a bad endpoint.
    """
    connection = GrblConnection(endpoint, _PERIOD_S, ConnectionCallbacks(
        on_ok=_ignore, on_rejected=_ignore, on_report=_ignore, on_alarm=_ignore, on_restart=_ignore,
        on_batch_done=_ignore, on_lost=_ignore,
    ))
    try:
        await connection.open(baud, timeout_s)
        report = await first_report(connection, timeout_s)
        if report.state not in _ANSWERING:
            return MotionReading(report, None, {}, (), (), False, None, connection.damaged)
        identity = await query_identity(connection)
        connection.use_dialect(identity.dialect, identity.rx_bytes)
        settings = parse_settings(await _lines_of(connection, "$$"))
        parser_state = await _lines_of(connection, "$G")
        offsets = await _lines_of(connection, "$#")
        report = await connection.query_report(timeout_s) or report
        is_homed = await query_homed(connection)
        trusted = report.state == "Idle" and bool(settings) and (
            is_homed is True or not is_homing_enabled(settings)
        )
        return MotionReading(report, identity, settings, parser_state, offsets, trusted, is_homed,
                             connection.damaged)
    finally:
        connection.close()


async def read_motion(motion: MotionDriver) -> MotionReading:
    """The same of a controller that is open; it must be idle or in alarm.

    Raises MachineError where it has not reported, or does not answer.
    """
    report = motion.status
    if report is None:
        raise MachineError("the motion controller does not report its state",
                           hint="check its cable, then try again")
    return MotionReading(
        report, motion.identity, motion.settings,
        await _lines_of_driver(motion, "$G"), await _lines_of_driver(motion, "$#"),
        motion.position_trusted, None, motion.damaged_message_count, is_taken_over=True,
        position_doubt=motion.position_doubt,
    )


async def _lines_of_driver(motion: MotionDriver, command: str) -> list[str]:
    """The same of a controller that is open."""
    try:
        return await motion.send_command(command)
    except MachineError:
        if not motion.is_all_answered:
            raise
        return []


def _ignore(*_: object) -> None:
    """Ignore an event that has no listener."""


async def _lines_of(connection: GrblConnection, command: str) -> list[str]:
    """The answer to a command; empty where the command is refused (as in some alarms)."""
    try:
        return await connection.send_command(command, _COMMAND_S)
    except MachineError:
        if connection.lost:
            raise
        return []
