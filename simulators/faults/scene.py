"""What a fault acts on: the bench, its clock, and the edges of its devices."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from simulators.faults.edge import Edge, Filter
from simulators.faults.kinds import Fault

if TYPE_CHECKING:
    from simulators.bench import Bench
    from simulators.feeder.device import PmxDevice
    from simulators.feeder.hopper import Hopper
    from simulators.safety.device import SafetyDevice

Undo = Callable[[], None]


@dataclass(frozen=True)
class Scene:
    """The bench on its loop. on_host_killed : see `FaultBoard`"""

    bench: Bench
    loop: asyncio.AbstractEventLoop
    on_host_killed: Callable[[], None] | None = None

    def edge(self, device: str) -> Edge:
        """Raises ValueError for a device the bench has not."""
        try:
            return self.bench.edges[device]
        except KeyError:
            raise ValueError(f"the bench has no device {device!r}") from None

    def feeder(self, fault: Fault) -> PmxDevice:
        """Raises ValueError for a feeder the bench has not."""
        try:
            return self.bench.feeders[fault.device]
        except KeyError:
            raise ValueError(f"the bench has no feeder {fault.device!r}") from None

    def safety(self) -> SafetyDevice:
        """Raises ValueError where the bench has none."""
        if self.bench.safety is None:
            raise ValueError("the bench has no safety device")
        return self.bench.safety

    def hopper(self, fault: Fault) -> Hopper:
        """Raises ValueError for a hopper the bench has not."""
        try:
            return self.feeder(fault).hoppers[fault.channel]
        except KeyError:
            raise ValueError(
                f"feeder {fault.device!r} has no hopper {fault.channel}"
            ) from None

    def befall(self, device: str, *filters: tuple[str, Filter]) -> Undo:
        """Put filters on a device's edge, each with its direction; what takes them away."""
        edge = self.edge(device)
        for direction, one in filters:
            edge.put(direction, one)

        def undo() -> None:
            for direction, one in filters:
                edge.take(direction, one)

        return undo

    def later(self, seconds: float, act: Callable[[], None]) -> Undo:
        """Do something after a while, unless it is undone before."""
        return self.loop.call_later(seconds, act).cancel


def both(*undo: Undo) -> Undo:
    """Undo all of them, in this order."""

    def whole() -> None:
        for one in undo:
            one()

    return whole
