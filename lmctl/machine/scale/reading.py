"""One reading of a catch scale, with its time on the host's clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from firmware_protocol.catch_scale import CYCLIC_BLOCK, ScaleStatusBits
from firmware_protocol.registers import WordOrder

_MS_MODULUS = 1 << 32


@dataclass(frozen=True)
class ScaleReading:
    """What the scale showed.

    time_s : loop time of the weighing, by the scale's own stamp
    mass_g : of the display, less the tare; None where the scale gives none
    is_stable : the display has not moved for a second
    is_overloaded : the load is beyond the scale's capacity, so the display stands still
    tare_count : modulo 65536
    """

    time_s: float
    mass_g: float | None
    is_stable: bool
    is_overloaded: bool
    is_healthy: bool
    tare_count: int


class ScaleClock:
    """Relates the scale's clock to the loop's, by the exchange that took least time.

    The reply's own time NOW lies between request and answer; the shorter they are apart, the
    better it is known.
    """

    def __init__(self) -> None:
        self._least_s = float("inf")
        self._offset_s = 0.0
        self._last_ms = 0
        self._turns = 0

    def on_exchange(self, asked_s: float, answered_s: float, now_ms: int) -> None:
        """An exchange whose reply was made at the scale's time now_ms."""
        if now_ms + self._turns * _MS_MODULUS < self._last_ms - _MS_MODULUS // 2:
            self._turns += 1
        self._last_ms = now_ms + self._turns * _MS_MODULUS
        took_s = answered_s - asked_s
        if took_s < self._least_s:
            self._least_s = took_s
            self._offset_s = (asked_s + answered_s) / 2.0 - self._last_ms / 1000.0

    def loop_time_s(self, stamp_ms: int) -> float:
        """Loop time of a stamp not much older than the last exchange."""
        full_ms = stamp_ms + self._turns * _MS_MODULUS
        if full_ms > self._last_ms + _MS_MODULUS // 2:
            full_ms -= _MS_MODULUS
        return full_ms / 1000.0 + self._offset_s


class ScaleReader:
    """Turns the cyclic registers of a scale into readings."""

    def __init__(self, word_order: WordOrder) -> None:
        self._block = CYCLIC_BLOCK.with_word_order(word_order)
        self.address, self.count = self._block.address, self._block.count
        self._clock = ScaleClock()

    def decode(self, words: Sequence[int], asked_s: float, answered_s: float) -> ScaleReading:
        """Raises RegisterError where the number of words is wrong."""
        values: dict[str, Any] = self._block.decode(words)
        self._clock.on_exchange(asked_s, answered_s, values["NOW"])
        status = ScaleStatusBits(values["STATUS"])
        return ScaleReading(
            time_s=self._clock.loop_time_s(values["STAMP"]),
            mass_g=values["MASS"],
            is_stable=ScaleStatusBits.STABLE in status,
            is_overloaded=ScaleStatusBits.OVERLOAD in status,
            is_healthy=ScaleStatusBits.SELF_TEST_OK in status,
            tare_count=values["TARE_COUNT"],
        )
