"""Register numbering and word order of a Modbus device, recognised from its answers.

The setting in the profile is checked, and an error names the key to correct.

Swapped words give values that may well be possible, so no single reading proves an order. A counter
of seconds does: only in the right order does it go forward by one.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from firmware_protocol.registers import RegisterBlock, WordOrder
from lmctl.config.modbus_device import ModbusDevice
from lmctl.machine.modbus.client import ModbusLink
from lmctl.machine.modbus.opening_retries import answer_with_retries

#: How long a counter of seconds is watched, and the interval between its readings [s].
_WATCHED_S = 1.5
_EVERY_S = 0.1
#: How far it may advance between two readings [s].
_MAX_STEP_S = 3


async def detect_word_order(
    link: ModbusLink, uptime: RegisterBlock, configured: WordOrder
) -> WordOrder | None:
    """The word order in which a device's uptime counts seconds.

    uptime : the block of input registers that holds the counter alone
    configured : the order that is expected; it is preferred where several would do
    Returns None where the counter does not change, or counts in no order. Raises as readings do.
    """
    async def reading() -> tuple[int, ...]:
        return tuple(await answer_with_retries(
            lambda: link.read_input(uptime.address, uptime.count), _EVERY_S))

    loop = asyncio.get_running_loop()
    until_s = loop.time() + _WATCHED_S
    before = now = await reading()
    while now == before:
        if loop.time() >= until_s:
            return None
        await asyncio.sleep(_EVERY_S)
        now = await reading()
    for order in sorted(WordOrder, key=lambda order: order is not configured):
        block = uptime.with_word_order(order)
        (then_s,), (now_s,) = block.decode(before).values(), block.decode(now).values()
        if isinstance(then_s, int) and isinstance(now_s, int) and (
            1 <= now_s - then_s <= _MAX_STEP_S
        ):
            return order
    return None


def address_base_hint(words: Sequence[int], device_code: int, device: ModbusDevice) -> str:
    """What to write into the profile where the code that identifies a device is one register
    later than asked for; "" where it does not."""
    if device.address_base == 0 and len(words) > 1 and words[1] == device_code:
        return "it counts its registers from 1: write address_base = 1 for it into the profile"
    return ""
