"""Feed hold and resume as procedures: a byte goes out, and only reports confirm its effect."""

from __future__ import annotations

import asyncio

from firmware_protocol.realtime import RealtimeCommand
from lmctl.errors import MachineError
from lmctl.machine.motion.connection import GrblConnection

_POLL_S = 0.02
_ANSWER_S = 0.1  # a report takes 10 ms at 115,200 baud; a lost one must not use up the deadline
_FROZEN_S = 1.0  # a machine that slows down moves
_RESUMED_S = 10.0  # restoring the spindle behind a door takes some seconds


async def hold(connection: GrblConnection, seen_within_s: float, stopped_within_s: float) -> None:
    """Send `!` and return when the machine is at rest.

    raises : MachineError where no hold shows within seen_within_s, or the machine still moves
        after stopped_within_s, or an alarm stops it instead
    """
    loop = asyncio.get_running_loop()
    start_s = loop.time()
    seen = False
    place: tuple[float, ...] | None = None
    moved_s = start_s
    idle_reports = 0
    connection.send_realtime(RealtimeCommand.HOLD)
    while True:
        report = await connection.query_report(_ANSWER_S)
        if report is not None:
            if report.is_held:
                return
            if report.state == "Alarm":
                raise connection.device_error("an alarm came instead of the hold",
                                        hint="look at the alarm")
            seen = seen or report.state in ("Hold", "Door")
            at = report.machine_mm or report.work_mm
            if at != place:
                place, moved_s = at, loop.time()
            # The first may have been on its way before the hold, and nothing must be left to start.
            idle_reports += report.state == "Idle" and not connection.unanswered_lines
            if idle_reports >= 2:
                return
        waited_s = loop.time() - start_s
        if waited_s >= (stopped_within_s if seen else seen_within_s):
            raise _not_held(connection, seen, waited_s, loop.time() - moved_s)
        await asyncio.sleep(_POLL_S)


async def resume(connection: GrblConnection) -> None:
    """Send `~` to a held machine and return when it no longer does.

    `~` while it still decelerates is ignored by both firmwares, so it is not sent then.
    raises : MachineError where the machine is not held, or stays held
    """
    loop = asyncio.get_running_loop()
    report = await connection.query_report(1.0)
    if report is None or not (report.is_held or report.state == "Idle"):
        raise connection.device_error(
            "resume refused: the machine is not held at standstill (state "
            f"{'unknown' if report is None else report.state})",
            hint="hold it first and wait until it has stopped; close the safety door",
        )
    connection.send_realtime(RealtimeCommand.START)
    start_s = loop.time()
    while report is None or report.state in ("Hold", "Door"):
        if loop.time() - start_s >= _RESUMED_S:
            raise connection.device_error(
                f"the hold did not end within {_RESUMED_S:g} s of a resume",
                hint="look whether the safety door is closed",
            )
        await asyncio.sleep(_POLL_S)
        report = await connection.query_report(_ANSWER_S)


def _not_held(
    connection: GrblConnection, seen: bool, waited_s: float, still_s: float
) -> MachineError:
    if not seen:
        what = f"no hold showed within {waited_s:.2f} s of a feed hold"
    elif still_s > _FROZEN_S:
        what = (
            f"the motion controller says that it slows down, but its position has not changed for "
            f"{still_s:.1f} s: its reports cannot be relied on"
        )
    else:
        what = f"the machine still moves {waited_s:.2f} s after a feed hold"
    return connection.device_error(what, hint="reset the controller; its position is lost then")
