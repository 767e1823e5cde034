"""A cell's motion controller alone, for what is done by hand: no powder, no gas, no beam."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager

from lmctl.config.machine import MachineProfile
from lmctl.machine.motion.driver import MotionDriver
from lmctl.machine.safety.driver import SafetyDriver


@asynccontextmanager
async def open_motion_controller(profile: MachineProfile) -> AsyncIterator[MotionDriver]:
    """The controller, opened; closed again afterwards.

    With a watchdog relay wired to its door input, the controller would report an open door for
    ever. So the safety device gets its heartbeat first, and an open relay is closed: the operator's
    command to the machine counts as the deliberate act for that. Raises MachineError, ConfigError.
    """
    async with AsyncExitStack() as opened:
        if profile.safety is not None:
            safety = await SafetyDriver.open(profile.safety)
            opened.push_async_callback(safety.close)
            if profile.safety.relay_timeout_s is not None:
                await safety.reset_watchdog_relay()
        motion = await MotionDriver.open(
            profile.motion.endpoint, baud=profile.motion.baud,
            status_period_s=profile.motion.status_period_s,
        )
        opened.push_async_callback(motion.close)
        yield motion
