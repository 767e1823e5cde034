"""Waiting for what a planned fault waits for."""

from __future__ import annotations

import asyncio

from simulators.feeder.device import PmxDevice
from simulators.motion.sim import MotionSim

#: Motion is looked at this often. Under way it is known before it happens; from rest it is not.
_LOOK_S = 0.01
#: Levels are looked at this often, and whenever they are foreseen to be reached.
_LEVEL_LOOK_S = 1.0


async def when_line(motion: MotionSim, line: int) -> None:
    """Returns as the axes begin the first move whose N word is at least `line`.

    Exactly then where they are under way before; up to 0.01 s later where they begin from rest.
    """
    loop = asyncio.get_running_loop()
    while True:
        row: asyncio.Future[int] = loop.create_future()
        forget = motion.trace.await_line(line, row.set_result)
        try:
            while not row.done():
                _ = motion.trace  # brings it up to what is known of the motion to come
                await asyncio.wait([row], timeout=_LOOK_S)
        finally:
            forget()
        while (begins_s := motion.trace.start_s(row.result())) is None or begins_s > loop.time():
            if motion.trace.rows <= row.result():
                break  # a reset came before it
            await asyncio.sleep(_LOOK_S if begins_s is None else begins_s - loop.time())
        else:
            return


async def when_level(feeder: PmxDevice, channel: int, grams: float) -> None:
    """Returns as so much powder is left in a hopper."""
    process = feeder.hoppers[channel].process
    while True:
        now_s = feeder.settle()
        due_s = process.when_left_s(grams)
        if due_s <= now_s:
            return
        await asyncio.sleep(min(_LEVEL_LOOK_S, due_s - now_s))
