"""One look at a motion controller: it is asked, and nothing is moved, written or reset.

Opening a serial port restarts some boards (AVR with auto-reset); nothing can be done about that
from here.
"""

from __future__ import annotations

from dataclasses import dataclass

from firmware_protocol.messages import Feedback, parse_message
from firmware_protocol.status import StatusReport
from lmctl.errors import MachineError
from lmctl.machine.motion.conversation import Conversation, Hearer
from lmctl.machine.motion.handshake import first_report, homed, identify
from lmctl.machine.motion.identify import Identity, homing_enabled, read_offset, read_settings

_COMMAND_S = 3.0
_PERIOD_S = 1.0  # of status reports; none is asked for beyond those waited for
_ANSWERING = ("Idle", "Alarm", "Check")  # states in which `$` commands are answered


@dataclass(frozen=True)
class MotionLook:
    """What a controller says of itself.

    identity, settings, modal, offset_mm : None or empty where it does not tell in its state
    homed : whether it calls its axes homed; None where it does not say (Grbl never does)
    damaged : messages that made no sense on the way
    """

    report: StatusReport
    identity: Identity | None
    settings: dict[int, str]
    modal: str
    offset_mm: tuple[float, ...] | None
    homed: bool | None
    damaged: int

    @property
    def position_trusted(self) -> bool:
        """Whether somebody has said where the machine is (see `handshake.Introduction`)."""
        return self.report.state == "Idle" and bool(self.settings) and (
            self.homed is True or not homing_enabled(self.settings)
        )

    @property
    def position_mm(self) -> tuple[float, ...] | None:
        """Program coordinates, None where they cannot be told."""
        if self.report.work_mm is not None or self.report.machine_mm is None:
            return self.report.work_mm
        offset_mm = self.report.offset_mm or self.offset_mm
        if offset_mm is None:
            return None
        return tuple(m - o for m, o in zip(self.report.machine_mm, offset_mm, strict=False))


async def look_at_motion(endpoint: str, *, baud: int, timeout_s: float = 5.0) -> MotionLook:
    """Ask a controller what it is and how it stands.

    Raises MachineError where it is unreachable, silent or no Grbl; ConfigError for a bad endpoint.
    """
    talk = Conversation(endpoint, _PERIOD_S, Hearer(
        accepted=_ignore, rejected=_ignore, report=_ignore, alarm=_ignore, restarted=_ignore,
        batch_done=_ignore, lost=_ignore,
    ))
    try:
        await talk.connect(baud, timeout_s)
        report = await first_report(talk, timeout_s)
        if report.state not in _ANSWERING:
            return MotionLook(report, None, {}, "", None, None, talk.damaged)
        identity = await identify(talk)
        talk.settle_on(identity.dialect, identity.rx_bytes)
        settings = read_settings(await _told(talk, "$$"))
        parser_state = await _told(talk, "$G")
        offsets = await _told(talk, "$#")
        said = [m.text for m in map(parse_message, parser_state) if isinstance(m, Feedback)]
        return MotionLook(
            await talk.fresh_report(timeout_s) or report, identity, settings, " ".join(said),
            read_offset(parser_state, offsets) if offsets else None, await homed(talk),
            talk.damaged,
        )
    finally:
        talk.close()


def _ignore(*_: object) -> None:
    """What becomes of an event that nobody waits for."""


async def _told(talk: Conversation, command: str) -> list[str]:
    """What a command is answered with, nothing where it is refused (as in some alarms)."""
    try:
        return await talk.command(command, _COMMAND_S)
    except MachineError:
        if talk.lost:
            raise
        return []
