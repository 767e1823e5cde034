"""The first minute with a controller: does it answer, is it at rest, what does it identify as.

A port may have been used a moment ago by a host that died. So nothing is sent that could act until
the controller has answered `?`; no bare newline is ever sent, since it would execute whatever part
of a line the old host left behind; and a controller found holding is reset only once it is at rest
still, so that it keeps its position.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import dataclass

from firmware_protocol.dialect import GRBLHAL
from firmware_protocol.realtime import RealtimeCommand
from firmware_protocol.status import StatusReport
from lmctl.errors import MachineError
from lmctl.machine.motion.connection import GrblConnection
from lmctl.machine.motion.identity import (
    ControllerIdentity,
    is_homing_enabled,
    parse_identity,
    parse_settings,
    parse_work_offset,
    reported_homed_state,
)

MAX_RESET_TIME_S = 5.0
"""Longest time from a reset to the banner, an AVR board's boot included."""

_ASK_EVERY_S = 0.25
_COMMAND_S = 3.0
_IDENTIFY_TRIES = 3
_HOMED_TRIES, _HOMED_AGREEING = 8, 2
_READY = ("Idle", "Alarm")
_MOVING = ("Run", "Jog", "Home")


@dataclass(frozen=True)
class ControllerInfo:
    """What a controller reported during the handshake.

    first_report : its first report, before anything was sent that could change its state
    offset_mm : work offset, or None where it did not report one
    is_homed : whether it reports its axes homed; None where it does not (Grbl never does)
    """

    first_report: StatusReport
    identity: ControllerIdentity
    settings: dict[int, str]
    offset_mm: tuple[float, ...] | None
    is_homed: bool | None

    @property
    def is_position_stated(self) -> bool:
        """Whether the machine position is established: by homing, or, without a homing cycle ($22),
        by the operator."""
        return self.is_homed is True or not is_homing_enabled(self.settings)


async def perform_handshake(connection: GrblConnection, timeout_s: float) -> ControllerInfo:
    """Meet the controller on an open link and bring it to Idle or Alarm.

    timeout_s : for the first answer (a board that resets when the port opens takes 2 s), and again
        for coming to rest
    raises : MachineError where it is silent, is not a Grbl, or does not come to rest
    """
    found = await first_report(connection, timeout_s)
    await _come_to_rest(connection, found, timeout_s)
    identity = await query_identity(connection)
    connection.use_dialect(identity.dialect, identity.rx_bytes)
    settings = parse_settings(await connection.send_command("$$", _COMMAND_S))
    offset_mm: tuple[float, ...] | None = None
    with suppress(MachineError):  # refused in some alarms; reports carry WCO: as well
        parser_state = await connection.send_command("$G", _COMMAND_S)
        offset_mm = parse_work_offset(parser_state, await connection.send_command("$#", _COMMAND_S))
        connection.screen.set_work_offset(offset_mm)
    return ControllerInfo(found, identity, settings, offset_mm, await query_homed(connection))


async def query_homed(connection: GrblConnection) -> bool | None:
    """Whether the controller reports its axes homed; None where it does not report it.

    One changed digit would home a machine: two reports must agree.
    """
    if connection.dialect is not GRBLHAL:
        return None
    said: list[bool | None] = []
    for _ in range(_HOMED_TRIES):
        connection.send_realtime(RealtimeCommand.STATUS_FULL)
        report = await connection.query_report(_ASK_EVERY_S)
        said.append(None if report is None else reported_homed_state(report))
        if said[-1] is not None and said.count(said[-1]) >= _HOMED_AGREEING:
            return said[-1]
    return None


async def first_report(connection: GrblConnection, timeout_s: float) -> StatusReport:
    """Ask `?` until it is answered. Raises MachineError with what came instead."""
    loop = asyncio.get_running_loop()
    deadline_s = loop.time() + timeout_s
    while loop.time() < deadline_s:
        if (report := await connection.query_report(_ASK_EVERY_S)) is not None:
            connection.observation = None
            return report
    seen = connection.observation
    assert seen is not None
    what, hint = seen.diagnose_missing_report()
    raise connection.device_error(what, hint=hint)


async def _come_to_rest(connection: GrblConnection, found: StatusReport, timeout_s: float) -> None:
    """Wait out motion; reset a controller that is in a hold, behind a door, or asleep."""
    loop = asyncio.get_running_loop()
    deadline_s = loop.time() + timeout_s
    report: StatusReport | None = found
    reset = False
    while report is None or report.state not in _READY:
        if report is not None and not reset and _is_at_rest(report):
            await connection.reset(MAX_RESET_TIME_S)
            reset = True
        if loop.time() >= deadline_s:
            raise _not_at_rest_error(connection, report)
        await asyncio.sleep(min(_ASK_EVERY_S, max(0.0, deadline_s - loop.time())))
        report = await connection.query_report(_ASK_EVERY_S)


def _is_at_rest(report: StatusReport) -> bool:
    return report.is_held or report.state in ("Sleep", "Check", "Tool")


def _not_at_rest_error(connection: GrblConnection, report: StatusReport | None) -> MachineError:
    if report is None:
        return connection.device_error("the motion controller stopped answering",
                                 hint="check cable and power")
    if report.state in _MOVING:
        return connection.device_error(
            f"the machine is moving (state {report.state}) at another's command",
            hint="wait until it has stopped, or stop it at its panel, then try again",
        )
    if report.state == "Door":
        return connection.device_error("the safety door is open", hint="close it and try again")
    return connection.device_error(
        f"the motion controller stays in state {report.state}",
        hint="bring it to Idle at its panel, then try again",
    )


async def query_identity(connection: GrblConnection) -> ControllerIdentity:
    """What answers `$I`, asked again while it is refused. Raises MachineError.

    The first one may end a line that a dead host left half sent; what comes of the two together
    is no command and no motion, only an error.
    """
    for _ in range(_IDENTIFY_TRIES - 1):
        try:
            answer = await connection.send_command("$I", _COMMAND_S)
        except MachineError:
            if connection.unanswered_lines or connection.lost:
                raise
            continue
        if any(line.startswith("[VER:") for line in answer):
            return parse_identity(answer, connection.endpoint)
    return parse_identity(await connection.send_command("$I", _COMMAND_S), connection.endpoint)
