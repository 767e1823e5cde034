"""What a fault came to: the judge's answers at a glance, for people and as JSON."""

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
    """What the machine did from since_s on, the time a fault became real.

    beam_off_after_s : from then until the beam was dark, 0 where it was already
    beam_on_again_at_s : when it was lit next, on the loop's clock; None: not again
    axes_stopped_after_s : from then until the axes stood
    beam_on_without_motion : the beam lit, and no motion (whole run)
    powder_deficits : the beam lit, and the powder not as told (whole run)
    powder_stops : of the feeders that stopped since; powder_on : names of those that feed now
    gas_off_s : by feeder, when its carrier gas went off since
    gas_off_before_powder : feeders whose gas was off when their powder stopped
    repeated_mm : drawn more than once with the beam lit (whole run); rx_overrun_bytes : bytes lost
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

    def safety_shortfalls(self, dark_within_s: float, grace_s: float = 0.0) -> list[str]:
        """What is wrong with it, in words; empty for a safe end.

        dark_within_s : the time allowed from since_s to a dark beam
        grace_s : lacks of powder that the fault itself caused may last so long after since_s
        """
        found = []
        if self.beam_off_after_s > dark_within_s:
            found.append(f"the beam stayed lit for {self.beam_off_after_s:.3f} s")
        found += [
            f"the beam was lit without motion from {one.begin_s:.3f} to {one.end_s:.3f} s"
            for one in self.beam_on_without_motion
        ]
        found += [
            f"the beam was lit from {lack.begin_s:.3f} to {lack.end_s:.3f} s with powder of "
            f"{lack.feeder} {lack.reason}"
            for lack in self.powder_deficits
            if not self.since_s <= lack.end_s <= self.since_s + grace_s
        ]
        found += [f"{feeder} still feeds" for feeder in self.powder_on]
        found += [
            f"gas of {feeder} went off before its powder" for feeder in self.gas_off_before_powder]
        return found


def judge_fault(bench: Bench, since_s: float = 0.0, off_by: float = 0.2) -> FaultOutcome:
    """Ask a bench everything. since_s : when the fault became real (`InjectedFault.at_s`)

    off_by : see `SafetyChecks.powder_lacks`
    """
    judge = SafetyChecks(bench)
    stops = [judge.powder_stop(feeder, since_s) for feeder in bench.feeders]
    gas_off = {feeder: judge.gas_off_at_s(feeder, since_s) for feeder in bench.feeders}
    return FaultOutcome(
        since_s=since_s,
        beam_off_after_s=judge.beam_off_at_s(since_s) - since_s,
        beam_on_again_at_s=judge.beam_on_again_at_s(since_s),
        axes_stopped_after_s=judge.axes_stopped_at_s(since_s) - since_s,
        beam_on_without_motion=judge.beam_on_without_motion(),
        powder_deficits=judge.powder_deficits(off_by),
        powder_stops=tuple(stop for stop in stops if stop is not None),
        powder_on=tuple(feeder for feeder in bench.feeders if judge.is_powder_on(feeder)),
        gas_off_before_powder=tuple(
            stop.feeder for stop in stops
            if stop is not None and not judge.is_gas_on(stop.feeder, stop.commanded_s)
        ),
        gas_off_s={feeder: at_s for feeder, at_s in gas_off.items() if at_s is not None},
        repeated_mm=sum(line.repeated_mm for line in judge.beam_on_length_by_line()),
        rx_overrun_bytes=judge.rx_overrun_bytes,
    )


def record_as_json(bench: Bench, happened: tuple[InjectedFault, ...] = ()) -> dict[str, Any]:
    """The whole record, for a bench that is a process of its own.

    Times are seconds of the bench's clock; "host" has when hosts came and went, by device.
    """
    judge = SafetyChecks(bench)
    since_s = happened[-1].at_s if happened else 0.0
    return {
        "faults": [
            {"fault": str(one.fault), "at_s": one.at_s, "visible_s": one.detectable_s,
             "cleared_s": one.cleared_s}
            for one in happened
        ],
        "verdict": asdict(judge_fault(bench, since_s)),
        "beam": [[lit.begin_s, lit.end_s] for lit in judge.beam_on_intervals()],
        "lines": [asdict(line) for line in judge.executed_lines()],
        "drawn": [asdict(line) for line in judge.beam_on_length_by_line()],
        "host": {name: list(edge.host_was_there) for name, edge in bench.edges.items()},
    }
