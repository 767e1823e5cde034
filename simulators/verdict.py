"""What a fault came to: the judge's answers at a glance, for people and as JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from simulators.judge import Judge, PowderLack, PowderStop
from simulators.lit import Interval

if TYPE_CHECKING:
    from simulators.bench import Bench
    from simulators.faults.board import Happened


@dataclass(frozen=True)
class Verdict:
    """What the machine did from since_s on, the time a fault became real.

    dark_after_s : from then until the beam was dark, 0 where it was already
    lit_again_s : when it was lit next, on the loop's clock; None: not again
    stood_after_s : from then until the axes stood
    beam_standing : the beam lit, and no motion (whole run)
    powder_lacks : the beam lit, and the powder not as told (whole run)
    powder_stops : of the feeders that stopped since; powder_on : names of those that feed now
    gas_off_s : by feeder, when its carrier gas went off since
    gas_first : feeders whose gas was off when their powder stopped
    repeated_mm : drawn more than once with the beam lit (whole run); overruns : bytes lost
    """

    since_s: float
    dark_after_s: float
    lit_again_s: float | None
    stood_after_s: float
    beam_standing: tuple[Interval, ...]
    powder_lacks: tuple[PowderLack, ...]
    powder_stops: tuple[PowderStop, ...]
    powder_on: tuple[str, ...]
    gas_off_s: dict[str, float]
    gas_first: tuple[str, ...]
    repeated_mm: float
    overruns: int

    def shortfalls(self, dark_within_s: float, grace_s: float = 0.0) -> list[str]:
        """What is wrong with it, in words; empty for a safe end.

        dark_within_s : the time allowed from since_s to a dark beam
        grace_s : lacks of powder that the fault itself caused may last so long after since_s
        """
        found = []
        if self.dark_after_s > dark_within_s:
            found.append(f"the beam stayed lit for {self.dark_after_s:.3f} s")
        found += [
            f"the beam was lit without motion from {one.begin_s:.3f} to {one.end_s:.3f} s"
            for one in self.beam_standing
        ]
        found += [
            f"the beam was lit from {lack.begin_s:.3f} to {lack.end_s:.3f} s with powder of "
            f"{lack.feeder} {lack.why}"
            for lack in self.powder_lacks
            if not self.since_s <= lack.end_s <= self.since_s + grace_s
        ]
        found += [f"{feeder} still feeds" for feeder in self.powder_on]
        found += [f"gas of {feeder} went off before its powder" for feeder in self.gas_first]
        return found


def verdict(bench: Bench, since_s: float = 0.0, off_by: float = 0.2) -> Verdict:
    """Ask a bench everything. since_s : when the fault became real (`Happened.at_s`)

    off_by : see `Judge.powder_lacks`
    """
    judge = Judge(bench)
    stops = [judge.powder_stop(feeder, since_s) for feeder in bench.feeders]
    gas_off = {feeder: judge.gas_off_s(feeder, since_s) for feeder in bench.feeders}
    return Verdict(
        since_s=since_s,
        dark_after_s=judge.dark_s(since_s) - since_s,
        lit_again_s=judge.lit_again_s(since_s),
        stood_after_s=judge.stood_s(since_s) - since_s,
        beam_standing=judge.beam_standing(),
        powder_lacks=judge.powder_lacks(off_by),
        powder_stops=tuple(stop for stop in stops if stop is not None),
        powder_on=tuple(feeder for feeder in bench.feeders if judge.powder_on(feeder)),
        gas_first=tuple(
            stop.feeder for stop in stops
            if stop is not None and not judge.gas_on(stop.feeder, stop.told_s)
        ),
        gas_off_s={feeder: at_s for feeder, at_s in gas_off.items() if at_s is not None},
        repeated_mm=sum(line.repeated_mm for line in judge.drawn()),
        overruns=judge.overruns,
    )


def record_as_json(bench: Bench, happened: tuple[Happened, ...] = ()) -> dict[str, Any]:
    """The whole record, for a bench that is a process of its own.

    Times are seconds of the bench's clock; "host" has when hosts came and went, by device.
    """
    judge = Judge(bench)
    since_s = happened[-1].at_s if happened else 0.0
    return {
        "faults": [
            {"fault": str(one.fault), "at_s": one.at_s, "visible_s": one.visible_s,
             "cleared_s": one.cleared_s}
            for one in happened
        ],
        "verdict": asdict(verdict(bench, since_s)),
        "beam": [[lit.begin_s, lit.end_s] for lit in judge.beam()],
        "lines": [asdict(line) for line in judge.lines()],
        "drawn": [asdict(line) for line in judge.drawn()],
        "host": {name: list(edge.host_was_there) for name, edge in bench.edges.items()},
    }
