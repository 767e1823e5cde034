"""Outcome of a fault: the results of the safety checks, as a summary and as JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from simulators.beam_intervals import TimeInterval
from simulators.safety_checks import PowderDeficit, PowderStop, SafetyChecks

if TYPE_CHECKING:
    from simulators.bench import Bench
    from simulators.faults.fault_injector import InjectedFault


@dataclass(frozen=True)
class FaultOutcome:
    """What the machine did from since_s on, the time at which the fault took effect.

    beam_off_after_s : from since_s until the beam was off, 0 if it already was
    beam_on_again_at_s : when the beam next came on, on the loop's clock; None: not again
    axes_stopped_after_s : from since_s until the axes were at rest
    beam_on_without_motion : beam on without motion (whole run)
    powder_deficits : beam on and powder not as commanded (whole run)
    powder_stops : feeders that stopped since then; powder_on : names of feeders that feed now
    gas_off_s : by feeder, when its carrier gas went off after since_s
    gas_off_before_powder : feeders whose gas was off when their powder stopped
    repeated_mm : length repeated with the beam on (whole run)
    rx_overrun_bytes : bytes lost because the controller's receive buffer was full
    """

    since_s: float
    beam_off_after_s: float
    beam_on_again_at_s: float | None
    axes_stopped_after_s: float
    beam_on_without_motion: tuple[TimeInterval, ...]
    powder_deficits: tuple[PowderDeficit, ...]
    powder_stops: tuple[PowderStop, ...]
    powder_on: tuple[str, ...]
    gas_off_s: dict[str, float]
    gas_off_before_powder: tuple[str, ...]
    repeated_mm: float
    rx_overrun_bytes: int

    def safety_shortfalls(self, beam_off_within_s: float, grace_s: float = 0.0) -> list[str]:
        """Return a message for each shortfall; an empty list means a safe end.

        beam_off_within_s : time allowed from since_s until the beam is off
        grace_s : time after since_s in which the fault itself may cause powder deficits
        """
        found = []
        if self.beam_off_after_s > beam_off_within_s:
            found.append(f"the beam stayed on for {self.beam_off_after_s:.3f} s")
        found += [
            f"the beam was on without motion from {one.begin_s:.3f} to {one.end_s:.3f} s"
            for one in self.beam_on_without_motion
        ]
        found += [
            f"the beam was on from {lack.begin_s:.3f} to {lack.end_s:.3f} s with powder of "
            f"{lack.feeder} {lack.reason}"
            for lack in self.powder_deficits
            if not self.since_s <= lack.end_s <= self.since_s + grace_s
        ]
        found += [f"{feeder} still feeds" for feeder in self.powder_on]
        found += [
            f"gas of {feeder} went off before its powder" for feeder in self.gas_off_before_powder]
        return found


def judge_fault(bench: Bench, since_s: float = 0.0, off_by: float = 0.2) -> FaultOutcome:
    """Run all safety checks on a bench.

    since_s : when the fault took effect (`InjectedFault.at_s`)
    off_by : see `SafetyChecks.powder_deficits`
    """
    checks = SafetyChecks(bench)
    stops = [checks.powder_stop(feeder, since_s) for feeder in bench.feeders]
    gas_off = {feeder: checks.gas_off_at_s(feeder, since_s) for feeder in bench.feeders}
    return FaultOutcome(
        since_s=since_s,
        beam_off_after_s=checks.beam_off_at_s(since_s) - since_s,
        beam_on_again_at_s=checks.beam_on_again_at_s(since_s),
        axes_stopped_after_s=checks.axes_stopped_at_s(since_s) - since_s,
        beam_on_without_motion=checks.beam_on_without_motion(),
        powder_deficits=checks.powder_deficits(off_by),
        powder_stops=tuple(stop for stop in stops if stop is not None),
        powder_on=tuple(feeder for feeder in bench.feeders if checks.is_powder_on(feeder)),
        gas_off_before_powder=tuple(
            stop.feeder for stop in stops
            if stop is not None and not checks.is_gas_on(stop.feeder, stop.commanded_s)
        ),
        gas_off_s={feeder: at_s for feeder, at_s in gas_off.items() if at_s is not None},
        repeated_mm=sum(line.repeated_mm for line in checks.beam_on_length_by_line()),
        rx_overrun_bytes=checks.rx_overrun_bytes,
    )


def record_as_json(bench: Bench, happened: tuple[InjectedFault, ...] = ()) -> dict[str, Any]:
    """Return the whole record, for a bench that runs in its own process.

    Times are seconds of the bench's clock. "host" lists when hosts connected and disconnected, by
    device.
    """
    checks = SafetyChecks(bench)
    since_s = happened[-1].at_s if happened else 0.0
    return {
        "faults": [
            {"fault": str(one.fault), "at_s": one.at_s, "visible_s": one.detectable_s,
             "cleared_s": one.cleared_s}
            for one in happened
        ],
        "verdict": asdict(judge_fault(bench, since_s)),
        "beam": [[span.begin_s, span.end_s] for span in checks.beam_on_intervals()],
        "lines": [asdict(line) for line in checks.executed_lines()],
        "drawn": [asdict(line) for line in checks.beam_on_length_by_line()],
        "host": {name: list(edge.host_was_there) for name, edge in bench.edges.items()},
    }
