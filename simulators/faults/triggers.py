"""Wait for the trigger of a planned fault: a program line or a hopper level."""

from __future__ import annotations

import asyncio

from simulators.feeder.device import PmxFeederDevice
from simulators.motion.simulator import MotionSimulator

#: Polling period of motion. While axes move, the next start is known ahead; from rest it is not.
_LOOK_S = 0.01
#: Longest polling period of levels; they are also checked when predicted to be reached.
_LEVEL_LOOK_S = 1.0


async def wait_for_line(motion: MotionSimulator, line: int) -> None:
    """Return when the axes begin the first move whose N word is at least `line`.

    Exact if the axes are already moving; up to 0.01 s late if they start from rest.
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
    """Return the row of the move as soon as it is the next to begin."""
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
    """Return when at most `grams` of powder are left in a hopper."""
    process = feeder.hoppers[channel].process
    while True:
        now_s = feeder.advance_to_now()
        due_s = process.time_when_remaining_s(grams)
        if due_s <= now_s:
            return
        await asyncio.sleep(min(_LEVEL_LOOK_S, due_s - now_s))
