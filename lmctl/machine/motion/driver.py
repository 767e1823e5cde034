"""Host end of one motion link: streams lines, holds, resumes, resets. It knows no jobs.

Lines of a stream are counted three times: sent, acknowledged (planned by the controller) and
executed (done by the machine); see `progress` and `stream`.
"""

from __future__ import annotations

from collections.abc import Iterable

from firmware_protocol.codes import LOCKED_BY_ALARM, alarm_loses_position
from firmware_protocol.realtime import RealtimeCommand
from firmware_protocol.status import StatusReport
from lmctl.machine.motion import feed_hold
from lmctl.machine.motion.callbacks import ConnectionCallbacks
from lmctl.machine.motion.connection import GrblConnection
from lmctl.machine.motion.driver_callbacks import MotionCallbacks
from lmctl.machine.motion.handshake import MAX_RESET_TIME_S, ControllerInfo, perform_handshake
from lmctl.machine.motion.identity import ControllerIdentity, unsuitable_settings
from lmctl.machine.motion.line_stream import LineStream
from lmctl.machine.motion.override_arithmetic import NO_OVERRIDE

__all__ = ["MotionCallbacks", "MotionDriver"]

_HOMED_S = 180.0


class MotionDriver:
    """One motion controller, opened by `open`.

    listener : receives the events; replace its members or the whole
    status : the last believed report, or None
    overrides : feed, rapid, spindle [%] as last reported
    offset_mm : work offset as last reported, or None (work = machine - offset)
    position_mm : as last reported, in program (work) coordinates, or None
    position_trusted : whether reported positions are those of the machine
    position_doubt : why they are not, where the caller has found that out; else ""
    restarted : whether the controller has restarted unasked since its port was opened, or by that
    """

    def __init__(self, endpoint: str, status_period_s: float) -> None:
        self.listener = MotionCallbacks()
        self.status: StatusReport | None = None
        self.overrides: tuple[int, int, int] = NO_OVERRIDE
        self.offset_mm: tuple[float, ...] | None = None
        self.position_mm: tuple[float, ...] | None = None
        self.position_trusted = False
        self.position_doubt = ""
        self.restarted = False
        self._connection = GrblConnection(
            endpoint,
            status_period_s,
            ConnectionCallbacks(
                on_ok=self._accepted,
                on_rejected=self._line_rejected,
                on_report=self._reported,
                on_alarm=self._alarmed,
                on_restart=self._restarted,
                on_surplus_reply=lambda: self._stream.on_surplus_reply(),
                on_batch_done=self._batch_done,
                on_query=lambda: self.listener.on_query(),
                on_lost=self._lost,
            ),
        )
        self._stream = LineStream(
            self._connection, lambda tag, code: self.listener.on_error(tag, code))
        self._introduction: ControllerInfo | None = None
        self._unsuitable = ""  # what keeps programs from being sent
        self._at_rest_at_reset = False
        self._grown = False  # counts have grown since on_progress was called

    @classmethod
    async def open(
        cls, endpoint: str, *, baud: int, status_period_s: float, connect_timeout_s: float = 5.0
    ) -> MotionDriver:
        """Open the link, identify the controller, read its settings.

        Settings that allow no program are no error here; `submit` refuses lines with them.
        raises : MachineError where it is absent, busy, silent, not a Grbl 1.1 or grblHAL, or
            moving; ConfigError for a bad endpoint
        """
        driver = cls(endpoint, status_period_s)
        try:
            await driver._connection.open(baud, connect_timeout_s)
            said = await perform_handshake(driver._connection, connect_timeout_s)
        except BaseException:
            await driver.close()
            raise
        driver._introduction = said
        driver._connection.screen.set_controller_info(said.identity, said.settings)
        driver._unsuitable = "; ".join(
            setting.text for setting in unsuitable_settings(said.identity, said.settings)
        )
        if driver.offset_mm is None:
            driver.offset_mm = said.offset_mm
            if driver.status is not None:
                driver.position_mm = driver.status.work_position_mm(driver.offset_mm)
        idle = driver.status is not None and driver.status.state == "Idle"
        driver.position_trusted = idle and said.is_position_stated
        driver._connection.watch.start()
        return driver

    async def close(self) -> None:
        """Close the link. The machine is left as it is."""
        self._stream.discard_queue()
        self._connection.close()

    @property
    def identity(self) -> ControllerIdentity:
        """The controller's identity as reported."""
        return self._said().identity

    @property
    def settings(self) -> dict[int, str]:
        """Its settings as read at opening, by number."""
        return self._said().settings

    @property
    def first_report(self) -> StatusReport:
        """The first report of all, from before anything was sent that could change a state."""
        return self._said().first_report

    @property
    def lines_sent(self) -> int:
        """Lines of the stream handed to the link."""
        return self._stream.progress.sent

    @property
    def lines_acknowledged(self) -> int:
        """Lines of the stream answered `ok`, up to the first rejected one."""
        return self._stream.progress.acknowledged

    @property
    def lines_executed(self) -> int:
        """Lines of the stream known to be done; never above `acknowledged`."""
        return self._stream.progress.executed

    @property
    def is_all_answered(self) -> bool:
        """Whether the link is open and nothing that was sent is unanswered."""
        return self._connection.lost is None and not self._connection.unanswered_lines

    @property
    def lost(self) -> str | None:
        """Why the link is lost, None while it is not."""
        return self._connection.lost

    @property
    def lines_queued(self) -> int:
        """Lines submitted and not sent."""
        return self._stream.lines_queued

    @property
    def status_age_s(self) -> float:
        """Seconds since the last believed status report."""
        return self._connection.watch.age_s

    @property
    def damaged_message_count(self) -> int:
        """Messages so far that were damaged or answered nothing: the quality of the line."""
        return self._connection.damaged

    @property
    def unreadable_answer_count(self) -> int:
        """Answers since the last believed report that could not be read or believed."""
        return self._connection.watch.unreadable

    @property
    def unanswered_query_count(self) -> int:
        """How often `?` was sent since the last believed report."""
        return self._connection.watch.times_put

    @property
    def is_silent(self) -> bool:
        """Whether the controller was given up because it does not answer."""
        return self._connection.is_silent

    @property
    def are_overrides_known(self) -> bool:
        """Whether every report since the last one with overrides has arrived and was believed."""
        return not (self._connection.screen.overrides_missed or self._connection.screen.is_unsure)

    def request_confirming_report(self) -> None:
        """Ask for another report within 20 ms: the last one is doubted."""
        self._connection.watch.query_next_tick()

    def submit(self, lines: Iterable[bytes]) -> None:
        """Queue lines of the stream; they go out as the controller has room.

        While held, halted by an error or alarm, or lost, they stay queued; a reset drops them.
        raises : LocalProtocolError for a line that could never be sent; MachineError where the
            controller's settings ($32, $10) allow no program
        """
        if self._unsuitable:
            raise self._connection.device_error(self._unsuitable, hint="see `lmctl machine doctor`")
        self._stream.submit(lines, self.identity)

    def discard_queue(self) -> int:
        """Drop the lines submitted and not sent; returns how many."""
        return self._stream.discard_queue()

    def trust_position(self) -> None:
        """The caller confirms that reported positions are those of the machine."""
        self.position_trusted, self.position_doubt = True, ""

    def distrust_position(self, why: str) -> None:
        """The caller has found that reported positions are not those of the machine."""
        self.position_trusted, self.position_doubt = False, why

    def send_realtime(self, byte: RealtimeCommand) -> None:
        """Send one real-time byte at once, before every line not yet on the wire."""
        if byte is RealtimeCommand.RESET:
            self._stream.discard_queue()
            self._stream.held = True
            self._at_rest_at_reset = self._at_rest()
        self._connection.send_realtime(byte)

    async def send_command(self, line: str, timeout_s: float = 5.0) -> list[str]:
        """Send one line outside any stream; return the messages received before its `ok`.

        raises : MachineError with the code in words; LocalProtocolError while lines are unanswered
        """
        return await self._connection.send_command(line, timeout_s)

    async def home(self, timeout_s: float = _HOMED_S) -> None:
        """Home the machine, which clears an alarm; afterwards its position is trusted.

        raises : MachineError
        """
        self._connection.watch.stop()  # Grbl answers no `?` while it homes
        try:
            await self._connection.send_command("$H", timeout_s)
        finally:
            if self._connection.lost is None:
                self._connection.watch.start()
        self._stream.on_restart(halted=False)
        self.position_trusted = True

    async def hold(self, *, seen_within_s: float = 0.25, stopped_within_s: float = 5.0) -> None:
        """Feed hold; returns when the machine is at rest. No line is sent until `resume`.

        raises : MachineError where no hold shows within seen_within_s, or the machine still moves
            after stopped_within_s, or an alarm stops it instead
        """
        self._stream.held = True
        await feed_hold.hold(self._connection, seen_within_s, stopped_within_s)

    async def resume(self) -> None:
        """End a hold. Raises MachineError where the machine is not held, or stays held."""
        await feed_hold.resume(self._connection)
        self._stream.held = False
        self._stream.send_available()

    async def reset(self, timeout_s: float = MAX_RESET_TIME_S) -> StatusReport:
        """Soft reset: ends stream and motion; returns the first report after the banner.

        The position stays trusted only where the machine was at rest. Raises MachineError.
        """
        self._stream.discard_queue()
        self._stream.held = True
        self._at_rest_at_reset = self._at_rest()
        await self._connection.reset(timeout_s)
        report = await self._connection.query_report(timeout_s)
        if report is None:
            raise self._connection.device_error(
                "the controller restarted but answers no '?'", hint="switch it off and on"
            )
        return report

    def _accepted(self, count: int) -> None:
        self._stream.on_ok(count)
        self._grown = True

    def _line_rejected(self, tag: int, error: int) -> None:
        if error == LOCKED_BY_ALARM and not self._stream.halted:
            self._alarmed(0)  # its ALARM: line was lost
        self._stream.on_rejected(tag, error)
        self._grown = True

    def _reported(self, report: StatusReport) -> None:
        self.status = report
        if report.offset_mm is not None:
            self.offset_mm = report.offset_mm
        if report.override_percents is not None:
            self.overrides = report.override_percents
        self.position_mm = report.work_position_mm(self.offset_mm)
        if self._stream.running:
            self._grown = self._stream.on_status_report(report) or self._grown
            if report.state == "Alarm" and not self._stream.halted:
                self._alarmed(report.substate or 0)  # its ALARM: line was lost
        self.listener.on_status(report)

    def _alarmed(self, code: int) -> None:
        self._stream.halted = True
        if alarm_loses_position(code, self._connection.dialect):
            self.position_trusted = False
        self.listener.on_alarm(code)

    def _restarted(self, asked: bool) -> None:
        unrequested = not asked and self._introduction is not None
        self.restarted = self.restarted or not asked
        self._stream.on_restart(halted=unrequested)
        self.overrides = NO_OVERRIDE
        if not (asked and self._at_rest_at_reset):
            self.position_trusted = False
        if unrequested:
            self.listener.on_restart()

    def _batch_done(self) -> None:
        if self._grown:
            self._grown = False
            self.listener.on_progress()
        self._stream.send_available()

    def _lost(self, reason: str) -> None:
        self._stream.halted = True
        self.listener.on_lost(reason)

    def _at_rest(self) -> bool:
        """Whether the last report shows standstill, and nothing has been sent since."""
        report = self.status
        if report is None:
            return False
        if report.state == "Idle":
            return self._connection.unanswered_lines == 0 and self._stream.progress.is_all_executed
        return report.is_held or report.state in ("Alarm", "Check", "Sleep")

    def _said(self) -> ControllerInfo:
        if self._introduction is None:
            raise AttributeError("the driver is not open")
        return self._introduction
