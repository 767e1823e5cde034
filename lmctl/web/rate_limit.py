"""Bounds how often each client address may ask: a token bucket for each."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable

_MOST_ADDRESSES = 1000


class RateLimit:
    """A bucket of `burst` requests for each address, refilled at `per_s` a second."""

    def __init__(self, per_s: float, burst: float, now_s: Callable[[], float]) -> None:
        self._per_s = per_s
        self._burst = burst
        self._now_s = now_s
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def is_exhausted(self, address: str) -> bool:
        """Whether an address has no request left; takes none."""
        return self._level(address) < 1.0

    def take(self, address: str) -> bool:
        """Take one request of an address; False where it has none left."""
        level = self._level(address)
        taken = level >= 1.0
        self._buckets[address] = (level - 1.0 if taken else level), self._now_s()
        self._buckets.move_to_end(address)
        if len(self._buckets) > _MOST_ADDRESSES:
            self._buckets.popitem(last=False)
        return taken

    def _level(self, address: str) -> float:
        level, since_s = self._buckets.get(address, (self._burst, self._now_s()))
        return min(self._burst, level + (self._now_s() - since_s) * self._per_s)
