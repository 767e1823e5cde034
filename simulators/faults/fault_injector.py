"""Injects faults into a bench: at once by `inject`, or by a plan with `schedule`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from simulators.faults.detection import call_on_first_detection
from simulators.faults.injectors import INJECTORS, FaultContext, Undo
from simulators.faults.kinds import Fault
from simulators.faults.plan import AtLevel, AtLine, AtTime, FaultPlan, PlannedFault
from simulators.faults.triggers import wait_for_level, wait_for_line

if TYPE_CHECKING:
    from simulators.bench import Bench


@dataclass(frozen=True)
class InjectedFault:
    """A fault that took effect at at_s. Times are on the loop's clock.

    detectable_s : when the first bytes that could show it reached the host; None: none so far, as
        with a silent device
    cleared_s : None while the fault is active, and for a single event
    """

    fault: Fault
    at_s: float
    detectable_s: float | None = None
    cleared_s: float | None = None

    def __str__(self) -> str:
        return f"{self.fault} at {self.at_s:.3f} s"


class FaultInjector:
    """Injects and clears the faults of one bench, for as long as the bench runs.

    on_host_killed : called to kill the host; without it, that fault is only recorded
    on_happened : called with each fault when it takes effect
    injected : faults that took effect so far, in order

    >>> def stall(bench):
    ...     injector = FaultInjector(bench)
    ...     injector.inject(Fault.create("disc_stalls", "F1"))
    """

    def __init__(
        self, bench: Bench, on_host_killed: Callable[[], None] | None = None,
        on_happened: Callable[[InjectedFault], None] | None = None,
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._scene = FaultContext(bench, self._loop, on_host_killed)
        self._on_happened = on_happened
        self._happened: list[InjectedFault] = []
        self._undo: dict[int, Undo] = {}
        self._timers: list[asyncio.TimerHandle] = []
        self._watchers: list[asyncio.Task[None]] = []

    @property
    def injected(self) -> tuple[InjectedFault, ...]:
        return tuple(self._happened)

    def inject(self, fault: Fault, for_s: float | None = None) -> int:
        """Inject a fault now; returns its number in `injected`.

        for_s : clear it after this time. Raises ValueError if the bench lacks the device.
        """
        number = len(self._happened)
        happens = InjectedFault(fault, self._loop.time())
        self._happened.append(happens)
        forget = call_on_first_detection(self._scene, fault, lambda: self._seen(number))
        try:
            undo = INJECTORS[fault.kind.name](self._scene, fault)
        except ValueError:
            forget()
            self._happened.pop()
            raise
        if self._on_happened is not None:
            self._on_happened(happens)
        if undo is not None:
            self._undo[number] = undo
            if for_s is not None:
                self._timers.append(self._loop.call_later(for_s, self._clear, number))
        return number

    def clear(self, fault: Fault | int) -> None:
        """Clear an active fault, by its number or value; no effect if it is already over."""
        for number in [fault] if isinstance(fault, int) else list(self._undo):
            if isinstance(fault, int) or self._happened[number].fault == fault:
                self._clear(number)

    def clear_all(self) -> None:
        """Clear all active faults, the latest first."""
        for number in sorted(self._undo, reverse=True):
            self._clear(number)

    def schedule(self, plan: FaultPlan) -> None:
        """Schedule each fault of a plan; times count from now."""
        for planned in plan.faults:
            if isinstance(planned.trigger, AtTime):
                self._timers.append(
                    self._loop.call_later(planned.trigger.at_s, self._inject_planned, planned)
                )
            else:
                self._watchers.append(self._loop.create_task(self._watch(planned)))

    def close(self) -> None:
        """Cancel all scheduled faults. Active faults stay active."""
        for timer in self._timers:
            timer.cancel()
        for watcher in self._watchers:
            watcher.cancel()

    async def _watch(self, planned: PlannedFault) -> None:
        bench = self._scene.bench
        match planned.trigger:
            case AtLine(line):
                await wait_for_line(bench.motion, line)
            case AtLevel(feeder, channel, grams):
                await wait_for_level(bench.feeders[feeder], channel, grams)
        self._inject_planned(planned)

    def _inject_planned(self, planned: PlannedFault) -> None:
        self.inject(planned.fault, planned.for_s)

    def _seen(self, number: int) -> None:
        self._happened[number] = replace(self._happened[number], detectable_s=self._loop.time())

    def _clear(self, number: int) -> None:
        undo = self._undo.pop(number, None)
        if undo is not None:
            undo()
            self._happened[number] = replace(
                self._happened[number], cleared_s=self._loop.time()
            )
