"""Homing and unlocking: describe what will move, then do it."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from firmware_protocol.realtime import RealtimeCommand
from firmware_protocol.status import StatusReport
from lmctl.errors import MachineError
from lmctl.machine.motion.driver import MotionCallbacks, MotionDriver
from lmctl.machine.motion.identity import is_homing_enabled, parse_work_offset

_AXES = "XYZ"
_TOWARDS, _SEEK, _PULL_OFF, _TRAVEL = 23, 25, 27, 130
_REPORT_S = 3.0


def describe_homing(settings: Mapping[int, str]) -> list[str]:
    """What a homing cycle moves, one line a step. Raises MachineError where there is none."""
    if not is_homing_enabled(settings):
        raise MachineError(
            "the controller has no homing cycle ($22=0)",
            hint="without one the position is what you say: `lmctl machine jog`, then `lmctl "
                 "machine offset --here X0 Y0 Z0`; or fit switches, then `lmctl machine "
                 "settings 22=1`",
        )
    towards = int(float(settings.get(_TOWARDS, "0") or 0))
    seek, off = settings.get(_SEEK, "?"), settings.get(_PULL_OFF, "?")

    def end(axis: int) -> str:
        sign = "-" if towards >> axis & 1 else "+"
        return f"{_AXES[axis]}{sign} (up to {settings.get(_TRAVEL + axis, '?')} mm)"

    return [
        f"Z goes first, to its switch: {end(2)}, at {seek} mm/min",
        f"then X and Y: {end(0)}, {end(1)}",
        f"then every axis pulls {off} mm off its switch",
    ]


async def home_axes(motion: MotionDriver) -> tuple[float, ...]:
    """Home; returns the position reached, program coordinates. Raises MachineError.

    Being cancelled resets the controller, which is all that ends a homing cycle.
    """
    if motion.status is not None and motion.status.state == "Idle":
        await motion.send_command("M5 S0")
    motion.position_trusted = False
    try:
        await motion.home()
    except asyncio.CancelledError:
        motion.send_realtime(RealtimeCommand.RESET)
        raise
    await wait_for_report(motion)
    return motion.position_mm or ()


async def set_work_offset(
    motion: MotionDriver, axes: Mapping[str, float], *, here: bool
) -> tuple[float, ...]:
    """Set the work offset of G54; returns the offset of every axis then (work = machine - offset).

    axes : by letter; here : the program coordinates of the present position, else the machine
    coordinates of program zero. The controller stores it in its EEPROM. Raises MachineError.
    """
    words = " ".join(f"{axis}{value:.3f}" for axis, value in axes.items())
    await motion.send_command("G21 G54")
    await motion.send_command(f"G10 {'L20' if here else 'L2'} P1 {words}")
    parser_state = await motion.send_command("$G")
    return parse_work_offset(parser_state, await motion.send_command("$#"))


async def clear_work_offsets(motion: MotionDriver) -> tuple[float, ...]:
    """Back to G54, without G92 and tool length; returns the offset of every axis then.

    Raises MachineError.
    """
    for line in ("G54", "G92.1", "G49"):
        await motion.send_command(line)
    parser_state = await motion.send_command("$G")
    return parse_work_offset(parser_state, await motion.send_command("$#"))


async def unlock_controller(motion: MotionDriver) -> None:
    """Take the controller out of its alarm, after a reset where the alarm asks for one.

    Without homing its position is trusted again, where nothing known speaks against that.
    Raises MachineError where the alarm's cause remains.
    """
    if motion.status is None or motion.status.state != "Alarm":
        return
    try:
        await motion.send_command("$X")
    except MachineError:
        await motion.reset()
        await motion.send_command("$X")
    report = await wait_for_report(motion)
    if report.state == "Alarm":
        raise MachineError("the controller stays in alarm", hint="its cause remains: see "
                           "`lmctl machine doctor`")
    if not is_homing_enabled(motion.settings) and not motion.position_doubt:
        motion.trust_position()


async def wait_for_report(motion: MotionDriver) -> StatusReport:
    """The next status report. Raises MachineError where none comes."""
    came: asyncio.Future[StatusReport] = asyncio.get_running_loop().create_future()

    def take(report: StatusReport) -> None:
        if not came.done():
            came.set_result(report)

    before, motion.listener = motion.listener, MotionCallbacks(on_status=take)
    try:
        async with asyncio.timeout(_REPORT_S):
            return await came
    except TimeoutError:
        raise MachineError("the motion controller is silent", hint="check its cable") from None
    finally:
        motion.listener = before
