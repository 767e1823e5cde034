"""Beam and motion of a cell, which stop together and return in order.

Under M4 no motion means no beam. Where the cell has a laser-enable output, it is switched off
first: it does not wait for motion the controller has prepared (110 ms with grblHAL at 10 mm/s,
measured), nor for a controller that no longer responds.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Coroutine
from typing import Any

from firmware_protocol.realtime import RealtimeCommand
from lmctl.config.machine import MotionSettings
from lmctl.errors import MachineError
from lmctl.run.cell.devices import Cell, is_idle
from lmctl.run.interlocks.alarms import EmergencyStopError

_REST_PATIENCE_S = 10.0

_ARMED_TRIES = 3
_PARSER_STATE = re.compile(r"\[GC:.*\]")
_ARMED = re.compile(r"\[GC:(?=.*\bM4\b)(?=.*\bS0(?:\.0*)?[\] ]).*\]")


class BeamControl:
    """Actions on beam and motion, each carried out completely."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self._motion = cell.motion

    def switch_off_now(self, error: Exception | None) -> None:
        """Laser-enable off, then `!`; returns at once.

        An open safety chain resets the controller instead: its position is lost anyway.
        """
        self._disable()
        stop = isinstance(error, EmergencyStopError)
        self._motion.send_realtime(RealtimeCommand.RESET if stop else RealtimeCommand.HOLD)

    async def arm(self) -> None:
        """Laser enabled, spindle mode M4, power zero, as the controller itself reports.

        Raises MachineError.
        """
        safety = self._cell.safety
        if safety is not None:
            safety.request_laser_enable(True)
            await safety.wait_for_laser_enable(True)
        await self._motion.send_command("M4 S0")
        for _ in range(_ARMED_TRIES):
            said = await self._motion.send_command("$G")
            if any(_ARMED.fullmatch(line) for line in said):
                return
            if any(_PARSER_STATE.fullmatch(line) for line in said):
                raise MachineError("the controller did not arm the beam at zero",
                                   where=f"it says {' '.join(said)} after M4 S0",
                                   hint="reset the controller, then resume; see `lmctl machine "
                                        "doctor`")
        raise MachineError(
            "the controller's answers are unreadable: it is not known whether the beam is at zero",
            where=f"it says {' '.join(said) or 'nothing readable'} to $G",
            hint="the link is disturbed: check cable and earthing of the controller",
        )

    async def hold(self) -> None:
        """Return when the machine is at rest. Without a hold in 250 ms the controller is reset.

        Raises MachineError where it did not hold.
        """
        self._disable()
        try:
            await self._motion.hold()
        except MachineError:
            self._motion.send_realtime(RealtimeCommand.RESET)
            raise

    async def stop(self, at_rest: Callable[[], object], failed: Callable[[str], object]) -> None:
        """Hold, and reset once it is at rest; without a hold in 250 ms reset at once (0x18).

        at_rest : called when motion has come to rest, before what was planned is dropped
        failed : called with the reason why it had to be reset in motion
        """
        self._disable()
        try:
            await self._motion.hold()
        except MachineError as error:
            failed(f"{error.what}; reset instead")
        try:
            at_rest()
        finally:  # whatever became of that, nothing is left that a cycle start could start
            await self._motion.reset()

    async def finish_motion(self) -> None:
        """See motion at its end; take the beam's mode away, and the feed override, which a
        controller would keep for whatever comes next. Raises MachineError."""
        self._disable()
        report = self._motion.status
        if report is not None and report.state == "Hold":
            await self._motion.resume()
        await self._cell.wait_until(
            lambda: is_idle(self._motion.status), _REST_PATIENCE_S, "standstill"
        )
        await _answered(self._motion.send_command("M5"))
        self._motion.send_realtime(RealtimeCommand.FEED_100)

    async def come_to_rest(self) -> None:
        """Idle, with the position known: a reset ends a door that has been closed since.

        Raises MachineError where it is not known.
        """
        if not is_idle(self._motion.status):
            await self._motion.reset()
        if not self._motion.position_trusted:
            raise MachineError(
                "the position is no longer known",
                hint="home the machine; then `lmctl recover` goes on with the part",
            )

    async def move_to_purge(self, profile: MotionSettings) -> None:
        """Up off the part, to the purge height if below it; across, and down; no beam."""
        x, y, z = profile.purge_mm
        travel = profile.travel_mm
        reach_mm = sum(high - low for low, high in (travel.x, travel.y, travel.z))
        longest_s = reach_mm / min(profile.max_speed_mm_s)
        await self._motion.send_command("G21 G90 G94")
        await self._motion.send_command("M5 S0")
        at = self._motion.position_mm
        off_mm = z if at is None else max(z, at[2] + profile.clearance_mm)
        await self._motion.send_command(f"G0 Z{min(off_mm, travel.z[1]):.3f}")
        await self._motion.send_command(f"G0 X{x:.3f} Y{y:.3f}")
        await self._motion.send_command(f"G0 Z{z:.3f}")
        await self._cell.wait_at_position((x, y, z), longest_s + _REST_PATIENCE_S)

    def _disable(self) -> None:
        if self._cell.safety is not None:
            self._cell.safety.request_laser_enable(False)


async def _answered(command: Coroutine[Any, Any, object]) -> None:
    """Wait for a command's answer even when cancelled: until then no command can follow."""
    asked = asyncio.ensure_future(command)
    try:
        await asyncio.shield(asked)
    finally:
        await asyncio.gather(asked, return_exceptions=True)
