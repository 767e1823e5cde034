"""Detects when a fault becomes visible to the host: at the first bytes that could show it."""

from __future__ import annotations

from collections.abc import Callable

from simulators.faults.fault_context import FaultContext, Undo
from simulators.faults.kinds import Fault, FaultTarget
from simulators.faults.link_tap import PassOn

_PLACES = {FaultTarget.MOTION: "motion", FaultTarget.SAFETY: "safety"}


def call_on_first_detection(scene: FaultContext, fault: Fault, seen: Callable[[], None]) -> Undo:
    """Call seen() when the first bytes from a device with the fault reach the host.

    A fault that a feeder detects by itself counts as visible only once its alarm is raised.
    """
    forgets: list[Undo] = []

    def restore() -> None:
        for forget in forgets:
            forget()

    def observe(data: bytes, deliver: PassOn) -> None:
        deliver(data)
        if _shows(scene, fault):
            restore()
            seen()

    forgets += [scene.bench.edges[place].add_observer(observe) for place in _places(scene, fault)]
    return restore


def _places(scene: FaultContext, fault: Fault) -> list[str]:
    target = fault.kind.target
    if target is FaultTarget.HOST:
        return []
    if target is FaultTarget.CELL:
        return list(scene.bench.edges)
    place = fault.device or _PLACES[target]
    return [place] if place in scene.bench.edges else []


def _shows(scene: FaultContext, fault: Fault) -> bool:
    if not fault.values.get("noticed", False):
        return True
    return bool(scene.bench.feeders[fault.device].alarms)
