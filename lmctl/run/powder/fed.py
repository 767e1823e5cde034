"""How much powder the discs have fed, from the set-points and the feeder reports.

The set-points give the shape: they change ten times a second, and a feeder reports a hopper once in
a few seconds. Each report shows whether the disc follows its set-point; any deviation scales the
flow from there on. On a healthy cell the scale is 1.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from firmware_protocol.pmx import HopperStatusBits
from lmctl.machine.feeder.readings import HopperReading

#: Amounts are available this far back [s]: a status report or two.
_KEPT_S = 10.0

#: Longest time for a disc to reach a new set-point, and for a set-point to reach the disc [s].
_FOLLOWS_WITHIN_S, _ORDERED_WITHIN_S = 1.0, 0.1


class FedPowder:
    """Mass fed by the discs of a job's hoppers since t [s, of the loop's clock].

    names : of the hoppers; flows are given in that order [g/min]
    """

    def __init__(self, names: Sequence[str], t: float) -> None:
        self._names = tuple(names)
        self._flows: Sequence[float] = (0.0,) * len(self._names)
        self._orders: deque[tuple[float, Sequence[float]]] = deque([(t, self._flows)])
        self._scales = [1.0] * len(self._names)
        self._readings: list[HopperReading | None] = [None] * len(self._names)
        self._knots: deque[tuple[float, tuple[float, ...]]] = deque(
            [(t, (0.0,) * len(self._names))])
        self._counted = [0.0] * len(self._names)

    def set_flows(self, t: float, flows_g_min: Sequence[float]) -> None:
        """From t on the discs are ordered to feed so much."""
        self._add_knot(t)
        self._flows = flows_g_min
        self._orders.append((t, flows_g_min))
        while len(self._orders) > 1 and self._orders[1][0] < t - _KEPT_S:
            self._orders.popleft()

    def on_readings(self, t: float, readings: Sequence[HopperReading | None]) -> None:
        """What the feeders have reported last, in the hoppers' order."""
        for hopper, reading in enumerate(readings):
            if reading is None or reading is self._readings[hopper]:
                continue
            self._readings[hopper] = reading
            scale = self._scale(hopper, reading)
            if scale != self._scales[hopper]:
                self._add_knot(t)
                self._scales[hopper] = scale

    def take_fed_g(self, from_t: float, to_t: float) -> dict[str, float]:
        """What was fed between two times; it counts as taken."""
        amounts = [
            after - before
            for before, after in zip(self.fed_g(from_t), self.fed_g(to_t), strict=True)
        ]
        self._counted = [c + g for c, g in zip(self._counted, amounts, strict=True)]
        return dict(zip(self._names, amounts, strict=True))

    def take_remaining_fed_g(self, t: float) -> dict[str, float]:
        """What was fed until t and has not been taken."""
        rest = [g - c for g, c in zip(self.fed_g(t), self._counted, strict=True)]
        self._counted = list(self.fed_g(t))
        return dict(zip(self._names, rest, strict=True))

    def fed_g(self, t: float) -> tuple[float, ...]:
        """Mass fed until t, of each hopper."""
        last_t, last = self._knots[-1]
        if t >= last_t:
            return self._from(last_t, last, t)
        for at in range(len(self._knots) - 1, 0, -1):
            begin_t, begin = self._knots[at - 1]
            end_t, end = self._knots[at]
            if t >= begin_t:
                share = (t - begin_t) / (end_t - begin_t)
                return tuple(b + share * (e - b) for b, e in zip(begin, end, strict=True))
        return self._knots[0][1]

    def weight_g(self, t: float) -> dict[str, float]:
        """What the scales would show at t: their last reading, less what has been fed since.

        Hoppers that do not weigh, or are being refilled, are left out.
        """
        found = {}
        fed = self.fed_g(t)
        for hopper, reading in enumerate(self._readings):
            if reading is None or reading.weight_g is None or (
                HopperStatusBits.REFILLING in reading.flags
            ):
                continue
            since_g = fed[hopper] - self.fed_g(reading.time_s)[hopper]
            found[self._names[hopper]] = reading.weight_g - since_g
        return found

    def _scale(self, hopper: int, reading: HopperReading) -> float:
        """Reported flow over the flow ordered; a disc may still be on its way to the last order."""
        flow, ordered = reading.flow_estimated_g_min, self._ordered_around(hopper, reading.time_s)
        if flow is None or min(ordered) <= 0.0:
            return self._scales[hopper]
        return flow / min(max(flow, min(ordered)), max(ordered))

    def _ordered_around(self, hopper: int, t: float) -> list[float]:
        """Every flow that was in force shortly before t."""
        ordered: list[float] = []
        for order_t, flows in reversed(self._orders):
            if order_t <= t + _ORDERED_WITHIN_S:
                ordered.append(flows[hopper])
                if order_t < t - _FOLLOWS_WITHIN_S:
                    break
        return ordered or [self._flows[hopper]]

    def _from(self, last_t: float, last: tuple[float, ...], t: float) -> tuple[float, ...]:
        minutes = (t - last_t) / 60.0
        return tuple(
            g + flow * scale * minutes
            for g, flow, scale in zip(last, self._flows, self._scales, strict=True)
        )

    def _add_knot(self, t: float) -> None:
        last_t, last = self._knots[-1]
        if t > last_t:
            self._knots.append((t, self._from(last_t, last, t)))
        while len(self._knots) > 2 and self._knots[1][0] < t - _KEPT_S:
            self._knots.popleft()
