"""What a fault acts on: the bench, its clock, and the link taps of its devices."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from simulators.faults.kinds import Fault
from simulators.faults.link_tap import ByteFilter, LinkTap

if TYPE_CHECKING:
    from simulators.bench import Bench
    from simulators.feeder.device import PmxFeederDevice
    from simulators.feeder.hopper import SimulatedHopper
    from simulators.safety.device import SimulatedSafetyDevice

Undo = Callable[[], None]


@dataclass(frozen=True)
class FaultContext:
    """The bench on its loop. on_host_killed : see `FaultInjector`"""

    bench: Bench
    loop: asyncio.AbstractEventLoop
    on_host_killed: Callable[[], None] | None = None

    def link_tap(self, device: str) -> LinkTap:
        """Return the tap of a device. Raises ValueError if the bench has no such device."""
        try:
            return self.bench.edges[device]
        except KeyError:
            raise ValueError(f"the bench has no device {device!r}") from None

    def feeder(self, fault: Fault) -> PmxFeederDevice:
        """Return the feeder of a fault. Raises ValueError if the bench has no such feeder."""
        try:
            return self.bench.feeders[fault.device]
        except KeyError:
            raise ValueError(f"the bench has no feeder {fault.device!r}") from None

    def safety(self) -> SimulatedSafetyDevice:
        """Return the safety device. Raises ValueError if the bench has none."""
        if self.bench.safety is None:
            raise ValueError("the bench has no safety device")
        return self.bench.safety

    def hopper(self, fault: Fault) -> SimulatedHopper:
        """Return the hopper of a fault. Raises ValueError if the bench has no such hopper."""
        try:
            return self.feeder(fault).hoppers[fault.channel]
        except KeyError:
            raise ValueError(
                f"feeder {fault.device!r} has no hopper {fault.channel}"
            ) from None

    def apply_filters(self, device: str, *filters: tuple[str, ByteFilter]) -> Undo:
        """Add filters to a device's link, each with its direction; returns the undo."""
        edge = self.link_tap(device)
        for direction, one in filters:
            edge.add_filter(direction, one)

        def undo() -> None:
            for direction, one in filters:
                edge.remove_filter(direction, one)

        return undo

    def call_later(self, seconds: float, act: Callable[[], None]) -> Undo:
        """Call act after a delay; the returned undo cancels it."""
        return self.loop.call_later(seconds, act).cancel


def both(*undo: Undo) -> Undo:
    """Return one undo that calls all of them in this order."""

    def restore() -> None:
        for one in undo:
            one()

    return restore
