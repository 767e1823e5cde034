"""Opening a hopper to refill it, and closing it again: without pressure, and weighed.

A loss-in-weight feeder takes powder that is filled in for a change of flow, so its weighing is
frozen meanwhile (REFILL_HOLD). A hopper is under carrier gas while gas flows: it may be opened only
when that has ended.
"""

from __future__ import annotations

import asyncio
from collections import deque

from firmware_protocol.pmx import FeederCommandBits, HopperStatusBits
from lmctl.machine.feeder.orders import ORDER_TIMEOUT_S, FeederOrders
from lmctl.machine.feeder.polling import FeederPolling
from lmctl.machine.feeder.readings import HopperReading
from lmctl.machine.feeder.status import FeederStatus

#: A weight is steady when it stays for this time within this range, or this share of itself.
STEADY_WEIGHT_DURATION_S = 3.0
_STEADY_G, _STEADY_SHARE = 1.0, 0.0005
_WEIGHT_PATIENCE_S = 60.0


class HopperRefill:
    """Orders and readings of one feeder around a refill; powder and gas are off."""

    def __init__(self, cycle: FeederPolling, orders: FeederOrders) -> None:
        self._cycle = cycle
        self._orders = orders
        self._loop = asyncio.get_running_loop()

    async def open(self, hopper: str) -> HopperReading:
        """Freeze the weighing, and return once the hopper is without pressure and may be opened.

        Returns its reading before. Raises MachineError.
        """
        before = await self._next_reading(hopper, self._loop.time())

        def is_ready(status: FeederStatus) -> bool:
            reading = status.hoppers.get(hopper)
            self._cycle.request_hopper_readings()
            return reading is not None and HopperStatusBits.REFILLING in reading.flags and (
                HopperStatusBits.PRESSURISED not in reading.flags
            )

        await self._orders.add_command_bits(FeederCommandBits.REFILL_HOLD, "freeze its weighing")
        await self._cycle.wait_until(
            is_ready, 2 * ORDER_TIMEOUT_S, f"hopper {hopper} did not become free of pressure",
            faulty=True,
        )
        return before

    async def close(self, hopper: str) -> HopperReading:
        """Weigh again, and return a reading of a weight that is steady.

        One without a load cell is returned as it is. Raises MachineError where the weight does not
        settle.
        """
        def goes_on(status: FeederStatus) -> bool:
            reading = status.hoppers.get(hopper)
            self._cycle.request_hopper_readings()
            return reading is not None and HopperStatusBits.REFILLING not in reading.flags

        await self._orders.remove_command_bits(FeederCommandBits.REFILL_HOLD, goes_on,
                                               "its weighing did not go on")
        return await self._steady(hopper)

    async def _steady(self, hopper: str) -> HopperReading:
        deadline_s = self._loop.time() + _WEIGHT_PATIENCE_S
        seen: deque[HopperReading] = deque()
        since_s = self._loop.time()
        while True:
            reading = await self._next_reading(hopper, since_s)
            since_s = reading.time_s
            if reading.weight_g is None:
                return reading
            seen.append(reading)
            while len(seen) > 2 and seen[1].time_s <= reading.time_s - STEADY_WEIGHT_DURATION_S:
                seen.popleft()
            weights = [one.weight_g for one in seen if one.weight_g is not None]
            spread_g = max(weights) - min(weights)
            lasted_s = reading.time_s - seen[0].time_s
            if lasted_s >= STEADY_WEIGHT_DURATION_S and spread_g <= max(
                _STEADY_G, _STEADY_SHARE * reading.weight_g
            ):
                return reading
            if self._loop.time() >= deadline_s:
                raise self._cycle.errors.error(
                    f"the weight of hopper {hopper} does not settle: {min(weights):.1f} to "
                    f"{max(weights):.1f} g within {lasted_s:.0f} s",
                    "close the lid, and take away what leans on the hopper or its hoses",
                )

    async def _next_reading(self, hopper: str, since_s: float) -> HopperReading:
        """A reading later than a time. Raises MachineError where none comes."""
        def is_later(status: FeederStatus) -> bool:
            reading = status.hoppers.get(hopper)
            self._cycle.request_hopper_readings()
            return reading is not None and reading.time_s > since_s

        self._cycle.request_hopper_readings()
        await self._cycle.wait_until(
            is_later, ORDER_TIMEOUT_S, f"hopper {hopper} was not read", faulty=True)
        status = self._cycle.status
        assert status is not None, "it was waited for"
        return status.hoppers[hopper]
