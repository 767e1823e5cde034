"""Waiting for what a planned fault waits for."""

from __future__ import annotations

import asyncio
import math

from simulators.feeder.device import PmxDevice
from simulators.motion.sim import MotionSim
from simulators.motion.trace import Phase

#: Motion is looked at this often; it is known longer than this before it happens.
_LOOK_S = 0.04
#: Levels are looked at this often, and whenever they are foreseen to be reached.
_LEVEL_LOOK_S = 1.0


async def when_line(motion: MotionSim, line: int) -> None:
    """Returns as the axes begin the first move whose N word is at least `line`."""
    loop, trace = asyncio.get_running_loop(), motion.trace
    record = trace.moved
    begins_s = math.inf

    def moved(phase: Phase) -> None:
        nonlocal begins_s
        record(phase)
        if begins_s == math.inf and trace.line_of(int(phase[-1])) >= line:
            begins_s = phase[0]

    trace.moved = moved
    try:
        while begins_s > loop.time():
            motion.settle()
            await asyncio.sleep(max(0.0, min(_LOOK_S, begins_s - loop.time())))
    finally:
        trace.moved = record


async def when_level(feeder: PmxDevice, channel: int, grams: float) -> None:
    """Returns as so much powder is left in a hopper."""
    process = feeder.hoppers[channel].process
    while True:
        now_s = feeder.settle()
        due_s = process.when_left_s(grams)
        if due_s <= now_s:
            return
        await asyncio.sleep(min(_LEVEL_LOOK_S, due_s - now_s))
