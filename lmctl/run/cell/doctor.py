"""Every condition of a cell that can be judged without moving or writing anything, all at once."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Iterator
from contextlib import AsyncExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lmctl.config.machine import FeederSettings, HopperSettings, MachineProfile
from lmctl.errors import LmctlError, MachineError
from lmctl.machine.manual.controller import open_motion_controller
from lmctl.machine.manual.inspect_modbus import FeederInspection, inspect_feeder, inspect_safety
from lmctl.machine.manual.inspect_motion import MotionReading, inspect_controller, read_motion
from lmctl.machine.manual.rate_search import find_baud_rate
from lmctl.machine.motion.endpoint import parse_motion_endpoint
from lmctl.machine.safety.status import SafetyStatus
from lmctl.run.cell.condition import StartCondition
from lmctl.run.cell.feeder_conditions import FeederSnapshot, feeder_conditions
from lmctl.run.cell.motion_conditions import motion_conditions
from lmctl.run.cell.safety_conditions import safety_conditions
from lmctl.run.journal.last_known_position import LastKnownPosition


@dataclass(frozen=True)
class CellInspection:
    """One look at every device of a profile, or the error that it failed with.

    feeders : by name, in the profile's order; safety is None where the profile has none
    """

    motion: MotionReading | LmctlError
    feeders: dict[str, FeederInspection | LmctlError]
    safety: SafetyStatus | LmctlError | None


async def inspect_cell(
    profile: MachineProfile, runs_dir: Path, *, close_relay: bool = False, search: bool = False
) -> CellInspection:
    """Look at all devices at once; one that fails keeps no other from being looked at.

    runs_dir : where the machine's journal is, which records where the last session left it
    close_relay : close the watchdog relay first and bring the controller to rest, as a run does,
        so that one behind its door input can be asked too
    search : look for a silent motion controller on a serial port at other rates
    """
    names = [feeder.name for feeder in profile.feeder]
    motion, safety, *feeders = await asyncio.gather(
        _or_error(_motion_taken_over(profile) if close_relay else inspect_controller(
            profile.motion.endpoint, baud=profile.motion.baud)),
        _or_error(inspect_safety(profile.safety)) if profile.safety and not close_relay
        else asyncio.sleep(0),
        *(_or_error(inspect_feeder(f, hoppers_of_feeder(profile, f.name))) for f in profile.feeder),
    )
    if close_relay and profile.safety:  # a device may serve one connection at a time
        safety = await _or_error(inspect_safety(profile.safety))
    if search:
        motion = await _motion_searched(motion, profile)
    if isinstance(motion, MotionReading):
        is_trusted, doubt = LastKnownPosition(runs_dir, profile).judged(motion)
        motion = replace(motion, is_position_trusted=is_trusted, position_doubt=doubt)
    return CellInspection(motion, dict(zip(names, feeders, strict=True)), safety)


def hoppers_of_feeder(profile: MachineProfile, feeder: str) -> list[HopperSettings]:
    return [hopper for hopper in profile.hopper if hopper.feeder == feeder]


def check_inspection(look: CellInspection, profile: MachineProfile) -> dict[str,
                                                                            list[StartCondition]]:
    """Every condition of the cell, device by device."""
    found = {"motion": list(_motion(look.motion, profile))}
    for feeder in profile.feeder:
        found[f"feeder {feeder.name}"] = list(
            _feeder(look.feeders[feeder.name], feeder, profile)
        )
    if look.safety is not None and profile.safety is not None:
        found["safety"] = (
            [_unreachable(look.safety)] if isinstance(look.safety, LmctlError)
            else list(safety_conditions(look.safety, profile.safety))
        )
    return found


async def _motion_taken_over(profile: MachineProfile) -> MotionReading:
    async with AsyncExitStack() as opened:
        return await read_motion(await opened.enter_async_context(open_motion_controller(profile)))


async def _or_error(look: Coroutine[Any, Any, Any]) -> Any:
    try:
        return await look
    except LmctlError as error:
        return error


async def _motion_searched(look: Any, profile: MachineProfile) -> Any:
    """The look itself, or its error with the rate at which the controller does answer."""
    where, baud = parse_motion_endpoint(profile.motion.endpoint), profile.motion.baud
    if not isinstance(look, MachineError) or where.kind != "serial":
        return look
    rate = await find_baud_rate(where, baud)
    if rate is None:
        return MachineError(f"{look.what}; nor does a Grbl answer at another usual rate",
                            where=look.where, hint=look.hint)
    return MachineError(f"{look.what}; a Grbl answers there at {rate} baud, and {baud} is set",
                        where=look.where, hint=f"set motion.baud = {rate} in the machine profile")


def _unreachable(error: LmctlError) -> StartCondition:
    return StartCondition(False, "; ".join([error.what, *error.where]), error.hint,
                          refuses_run=True)


def _motion(look: MotionReading | LmctlError, profile: MachineProfile) -> Iterator[StartCondition]:
    if isinstance(look, LmctlError):
        yield _unreachable(look)
    else:
        yield from motion_conditions(look, profile)


def _feeder(
    look: FeederInspection | LmctlError, feeder: FeederSettings, profile: MachineProfile
) -> Iterator[StartCondition]:
    if isinstance(look, LmctlError):
        yield _unreachable(look)
        return
    reading = FeederSnapshot(look.identity, look.status, look.hopper_limits,
                            clock_ratio=look.clock_ratio, reply_time_s=look.reply_time_s)
    yield from feeder_conditions(reading, feeder, hoppers_of_feeder(profile, feeder.name),
                                 send_horizon_s=profile.motion.send_horizon_s)
