"""A driver on a scripted controller: opened, waited for, and listened to."""

from __future__ import annotations

import asyncio

from lmctl.machine.motion.driver import MotionCallbacks, MotionDriver


async def opened(endpoint: str, period_s: float = 0.1) -> MotionDriver:
    return await MotionDriver.open(endpoint, baud=115_200, status_period_s=period_s)


async def until(condition, deadline_s: float = 60.0) -> None:
    async with asyncio.timeout(deadline_s):
        while not condition():  # noqa: ASYNC110 (the tests poll a clock that jumps)
            await asyncio.sleep(0.01)


def driver_events(driver: MotionDriver) -> list[tuple]:
    """Everything the driver tells but status and progress."""
    events: list[tuple] = []
    driver.listener = MotionCallbacks(
        on_error=lambda tag, code: events.append(("error", tag, code)),
        on_alarm=lambda code: events.append(("alarm", code)),
        on_restart=lambda: events.append(("restart",)),
        on_lost=lambda reason: events.append(("lost", reason)),
    )
    return events


PROGRAM = [b"N%d G1 X%d" % (n, n % 9) for n in range(300)]
