"""Moving axes by hand, by `$J=`: within the travel, never with beam, cancelled by 0x85.

A jog is no program: the controller forgets it at a cancel, and refuses programs while it lasts.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass

from firmware_protocol.codes import alarm_meaning
from firmware_protocol.realtime import RealtimeCommand
from firmware_protocol.status import StatusReport
from lmctl.config.machine import MotionSettings
from lmctl.errors import MachineError, UsageError
from lmctl.machine.motion.driver import MotionCallbacks, MotionDriver

#: Longest relative jog of an axis while the machine position is unknown [mm].
MAX_JOG_FROM_UNKNOWN_MM = 10.0

_AXES = "XYZ"
_THERE_MM = 0.05
_PATIENCE_S = 10.0
_CANCELLED_S = 5.0


@dataclass(frozen=True)
class JogRequest:
    """A jog as it is wanted. to_mm : by axis letter; relative : from where the machine is."""

    to_mm: Mapping[str, float]
    relative: bool
    feed_mm_min: float


def check_jog(jog: JogRequest, motion: MotionDriver, limits: MotionSettings) -> dict[str, float]:
    """Where each axis will end, in program coordinates; how far it will go, where that is unknown.

    Raises UsageError for a jog out of the travel or too fast; MachineError where the machine is
    not ready, or for an absolute jog while the machine position is unknown.
    """
    fastest = 60.0 * min(limits.max_speed_mm_s[_AXES.index(axis)] for axis in jog.to_mm)
    if jog.feed_mm_min > fastest:
        raise UsageError(f"a feed of {jog.feed_mm_min:g} mm/min is too fast for this machine",
                         hint=f"at most {fastest:g}")
    report = motion.status
    if report is None or report.state not in ("Idle", "Jog"):
        state = "unknown" if report is None else report.state
        raise MachineError(f"cannot jog in state {state}",
                           hint="`lmctl machine home` or `lmctl machine unlock`"
                           if state == "Alarm" else "wait until it has stopped")
    if not motion.position_trusted:
        return _blind(jog)
    at = motion.position_mm
    if at is None:
        raise MachineError("the controller does not say where it is", hint="try again")
    target = {
        axis: value + (at[_AXES.index(axis)] if jog.relative else 0.0)
        for axis, value in jog.to_mm.items()
    }
    outside = [
        f"{axis}: {value:.2f} mm, the travel is {low:g} to {high:g}"
        for axis, value in target.items()
        for low, high in [getattr(limits.travel_mm, axis.lower())]
        if not low <= value <= high
    ]
    if outside:
        raise UsageError("the jog would leave the machine's travel", where=outside,
                         hint="jog less far, or the other way")
    return target


def _blind(jog: JogRequest) -> dict[str, float]:
    if not jog.relative:
        raise MachineError("the machine position is unknown, so it cannot be sent to a place",
                           hint="`lmctl machine home`, or jog by a distance with --relative")
    if max(map(abs, jog.to_mm.values())) > MAX_JOG_FROM_UNKNOWN_MM:
        raise UsageError("the machine position is unknown: a jog is limited to "
                         f"{MAX_JOG_FROM_UNKNOWN_MM:g} mm", hint="`lmctl machine home`")
    return dict(jog.to_mm)


async def jog_axes(jog: JogRequest, motion: MotionDriver, limits: MotionSettings) -> tuple[float,
                                                                                           ...]:
    """Jog, and return the position when the machine has stopped.

    Being cancelled stops the jog (0x85) and waits until the machine has stopped, then raises
    CancelledError as usual. Raises as `check_jog` does, and MachineError where the controller
    refuses, an alarm stops it, or it does not arrive.
    """
    target = check_jog(jog, motion, limits)
    await _beam_off(motion)
    longest_s = sum(map(abs, _distances(target, jog, motion))) * 60.0 / jog.feed_mm_min
    words = "".join(f"{axis}{value:.3f}" for axis, value in target.items())
    mode = "G90" if motion.position_trusted else "G91"
    try:
        await motion.send_command(f"$J=G21{mode}{words}F{jog.feed_mm_min:.1f}")
        await _rest(motion, longest_s + _PATIENCE_S)
    except asyncio.CancelledError:
        motion.send_realtime(RealtimeCommand.JOG_CANCEL)
        await _rest(motion, _CANCELLED_S)
        raise
    at = motion.position_mm or ()
    if motion.position_trusted and any(
        abs(at[_AXES.index(axis)] - value) > _THERE_MM for axis, value in target.items()
    ):
        position = " ".join(f"{axis}{value:.2f}" for axis, value in zip(_AXES, at, strict=False))
        raise MachineError(f"the jog ended before it arrived: the machine is at {position}",
                           hint="was it stopped at its panel?")
    return at


def _distances(target: Mapping[str, float], jog: JogRequest, motion: MotionDriver) -> list[float]:
    at = motion.position_mm
    if jog.relative or at is None:
        return list(jog.to_mm.values())
    return [value - at[_AXES.index(axis)] for axis, value in target.items()]


async def _beam_off(motion: MotionDriver) -> None:
    """Switch the beam off first: a jog would move with the beam as the last program left it."""
    await motion.send_command("M5 S0")
    said = " ".join(await motion.send_command("$G"))
    if "M5" not in said.replace("]", " ").split():
        raise MachineError("the controller did not switch the beam off", where=f"it says {said}",
                           hint="switch the laser off by hand; reset the controller")


async def _rest(motion: MotionDriver, timeout_s: float) -> None:
    """Wait for a report, from now on, that the machine is at rest. Raises MachineError."""
    ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def fail(what: str, hint: str) -> None:
        if not ended.done():
            ended.set_exception(MachineError(what, hint=hint))

    def alarm(code: int) -> None:
        meaning = alarm_meaning(code, motion.identity.dialect)
        fail(f"alarm {code}: {meaning.description}", meaning.remedy)

    def status(report: StatusReport) -> None:
        if report.state == "Alarm":
            alarm(report.substate or 0)
        elif report.state in ("Idle", "Hold") and not ended.done():
            ended.set_result(None)

    before, motion.listener = motion.listener, MotionCallbacks(
        on_status=status, on_alarm=alarm,
        on_lost=lambda reason: fail(f"the motion controller is lost: {reason}",
                                    "check cable and power of the controller"),
        on_restart=lambda: fail("the motion controller restarted", "home it"),
    )
    try:
        async with asyncio.timeout(timeout_s):
            await ended
    except TimeoutError:
        motion.send_realtime(RealtimeCommand.JOG_CANCEL)
        raise MachineError(f"the machine still moves after {timeout_s:.0f} s",
                           hint="a stop was sent; look at the machine") from None
    finally:
        motion.listener = before
