"""The CSC scale: powder and weights on a pan, seen through its lag, its display and its faults.

Nothing runs between requests. `advance_to_now` weighs every cycle that fell due since the last one.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from firmware_protocol.catch_scale import (
    CSC_MAP,
    DEVICE_ID,
    FULL_BLOCK,
    MAP_MAJOR,
    MAP_MINOR,
    MIRROR_ADDRESS,
    TARE_KEY,
    ScaleStatusBits,
)
from simulators.array_types import FloatArray
from simulators.modbus_errors import (
    ILLEGAL_ADDRESS,
    ILLEGAL_VALUE,
    ExceptionReplyError,
    RequestIgnoredError,
)
from simulators.scale.config import ScaleConfig

_FIRMWARE = 0x0100
_SERIAL = 1
_STEPS_PER_CYCLE = 4
_STABLE_S = 1.0
_TARE = CSC_MAP.wire_address("TARE")


class SimulatedCatchScale:
    """One scale. now : the simulation's clock.

    flow_g_s : flow onto the pan at times (n,), which are in the past; (n,) float64 [g/s]
    """

    def __init__(
        self, config: ScaleConfig, now: Callable[[], float],
        flow_g_s: Callable[[FloatArray], FloatArray],
    ) -> None:
        self.config = config
        self.now = now
        self._flow_g_s = flow_g_s
        self._block = FULL_BLOCK.with_word_order(config.word_order)
        self._random = np.random.default_rng(config.seed)
        self._powered_s = self._until_s = now()
        self._cycle = math.floor(self._until_s / config.cycle_s)
        self._load_g = self._seen_g = config.pan_g
        self._displayed_g = self._weighed_g = config.pan_g
        self._stamp_s = self._cycle * config.cycle_s
        self._recent: deque[float] = deque(maxlen=max(2, round(_STABLE_S / config.cycle_s)))
        self._tare_g = 0.0
        self._tares = 0
        self._stuck = self._silent = False

    @property
    def device_id(self) -> int:
        return self.config.device_id

    # --- operator and fault actions

    def put_on(self, mass_g: float) -> None:
        """Something is put onto the pan, or with a negative mass taken off it."""
        self.advance_to_now()
        self._load_g += mass_g

    def bump(self, shift_g: float) -> None:
        """It is knocked against: the display jumps, and stays beside the load."""
        self.advance_to_now()
        self._load_g += shift_g
        self._seen_g += shift_g

    def set_stuck(self, stuck: bool = True) -> None:
        """The display stands still whatever lies on it."""
        self.advance_to_now()
        self._stuck = stuck

    def set_silent(self, silent: bool = True) -> None:
        """It does not answer."""
        self._silent = silent

    # --- weighing

    def advance_to_now(self) -> float:
        """Weigh every cycle due until now; returns now."""
        now_s = self.now()
        config = self.config
        step_s = config.cycle_s / _STEPS_PER_CYCLE
        first, last = self._until_s / step_s, now_s / step_s
        inner = np.arange(math.floor(first) + 1, math.ceil(last))
        ends_s = np.append(inner * step_s, now_s)
        begins_s = np.append(self._until_s, ends_s[:-1])
        lengths_s = ends_s - begins_s
        fed_g = self._flow_g_s((begins_s + ends_s) / 2.0) * lengths_s
        for end_s, length_s, grown_g in zip(
            ends_s.tolist(), lengths_s.tolist(), fed_g.tolist(), strict=True
        ):
            self._settle(length_s, grown_g)
            cycle = math.floor(end_s / config.cycle_s + 1e-9)
            if cycle > self._cycle:
                self._cycle = cycle
                self._weigh(cycle * config.cycle_s)
        self._until_s = now_s
        return now_s

    def _settle(self, length_s: float, grown_g: float) -> None:
        """What the cell sees follows a load that grows evenly."""
        before_g, lag_s = self._load_g, self.config.lag_s
        self._load_g += grown_g
        if length_s <= 0:
            return
        if lag_s <= 0:
            self._seen_g = self._load_g
            return
        left = math.exp(-length_s / lag_s)
        slope = grown_g / length_s
        self._seen_g = (self._seen_g * left + before_g * (1 - left)
                        + slope * (length_s - lag_s * (1 - left)))

    def _weigh(self, time_s: float) -> None:
        self._stamp_s = time_s
        if self._stuck:
            return
        config = self.config
        noise_g = config.noise_g * self._random.standard_normal() if config.noise_g else 0.0
        drift_g = config.drift_g_min * (time_s - self._powered_s) / 60.0
        self._weighed_g = min(self._seen_g + noise_g + drift_g, config.capacity_g)
        self._displayed_g = round(self._weighed_g / config.resolution_g) * config.resolution_g
        self._recent.append(self._displayed_g)

    # --- requests

    def read_input(self, address: int, count: int) -> list[int]:
        words = self._words()
        if address + count > len(words):
            raise ExceptionReplyError(ILLEGAL_ADDRESS)
        return words[address : address + count]

    def read_holding(self, address: int, count: int) -> list[int]:
        if address >= MIRROR_ADDRESS:
            return self.read_input(address - MIRROR_ADDRESS, count)
        self._meet()
        if (address, count) != (_TARE, 1):
            raise ExceptionReplyError(ILLEGAL_ADDRESS)
        return [0]

    def write(self, address: int, words: Sequence[int]) -> None:
        self._meet()
        if address != _TARE or len(words) != 1:
            raise ExceptionReplyError(ILLEGAL_ADDRESS)
        if words[0] not in (0, TARE_KEY):
            raise ExceptionReplyError(ILLEGAL_VALUE)
        if words[0] == TARE_KEY and self.config.tare_works:
            self._tare_g = self._displayed_g
            self._tares += 1

    def _meet(self) -> float:
        """Raises RequestIgnoredError while it is silent; returns now."""
        if self._silent:
            raise RequestIgnoredError
        return self.advance_to_now()

    def _words(self) -> list[int]:
        time_s = self._meet()
        status = ScaleStatusBits.SELF_TEST_OK
        is_quiet = len(self._recent) == self._recent.maxlen and (
            max(self._recent) - min(self._recent) <= 1.5 * self.config.resolution_g)
        if is_quiet or self._stuck:
            status |= ScaleStatusBits.STABLE
        if self._weighed_g >= self.config.capacity_g:
            status |= ScaleStatusBits.OVERLOAD
        if self._displayed_g < -self.config.resolution_g:
            status |= ScaleStatusBits.UNDERLOAD
        if self._tares:
            status |= ScaleStatusBits.TARED
        return self._block.encode({
            "DEVICE_ID": DEVICE_ID,
            "MAP_VERSION": MAP_MAJOR << 8 | MAP_MINOR,
            "FW_VERSION": _FIRMWARE,
            "RESOLUTION": round(1000 * self.config.resolution_g),
            "SERIAL": _SERIAL,
            "STATUS": int(status),
            "TARE_COUNT": self._tares & 0xFFFF,
            "MASS": self._displayed_g - self._tare_g,
            "STAMP": round(1000 * self._stamp_s) & 0xFFFF_FFFF,
            "NOW": round(1000 * time_s) & 0xFFFF_FFFF,
            "CAPACITY": self.config.capacity_g,
            "UPTIME": int(time_s - self._powered_s),
        })
