"""Waiting for what a planned fault waits for."""

from __future__ import annotations

import asyncio

from simulators.feeder.device import PmxFeederDevice
from simulators.motion.simulator import MotionSimulator

#: Motion is looked at this often. Under way it is known before it happens; from rest it is not.
_LOOK_S = 0.01
#: Levels are looked at this often, and whenever they are foreseen to be reached.
_LEVEL_LOOK_S = 1.0


async def wait_for_line(motion: MotionSimulator, line: int) -> None:
    """Returns as the axes begin the first move whose N word is at least `line`.

    Exactly then where they are under way before; up to 0.01 s later where they begin from rest.
    """
    loop = asyncio.get_running_loop()
    while True:
        row = await _loaded(motion, line)
        while (begins_s := motion.trace.block_start_s(row)) is None or begins_s > loop.time():
            if motion.trace.rows <= row:
                break  # a reset came before it
            await asyncio.sleep(_LOOK_S if begins_s is None else begins_s - loop.time())
        else:
            return


async def _loaded(motion: MotionSimulator, line: int) -> int:
    """Row of the move, as soon as it is the next to begin."""
    loop = asyncio.get_running_loop()
    row: asyncio.Future[int] = loop.create_future()
    timer: asyncio.TimerHandle

    def look() -> None:
        nonlocal timer
        motion.advance_motion()
        timer = loop.call_later(_LOOK_S, look)

    timer = loop.call_later(_LOOK_S, look)
    forget = motion.trace.call_at_line(line, row.set_result)
    try:
        return await row
    finally:
        timer.cancel()
        forget()


async def wait_for_level(feeder: PmxFeederDevice, channel: int, grams: float) -> None:
    """Returns as so much powder is left in a hopper."""
    process = feeder.hoppers[channel].process
    while True:
        now_s = feeder.advance_to_now()
        due_s = process.time_when_remaining_s(grams)
        if due_s <= now_s:
            return
        await asyncio.sleep(min(_LEVEL_LOOK_S, due_s - now_s))
