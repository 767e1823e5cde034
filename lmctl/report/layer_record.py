"""One layer over all runs that worked on it: planned, reported, inferred, and how it differs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add

from lmctl.report.run_record import LayerAccount, PlannedLayer, RunRecord
from lmctl.run.journal.figures import NO_FIGURES, ExecutionFigures

#: Figures that are compared with the plan, beside powder.
_NAMES = {"path_mm": "path", "beam_s": "beam time", "energy_J": "energy"}

#: Share of the planned figure by which a reported one may differ before it is marked.
DEVIATION_TOLERANCE = 0.02
#: Powder that may differ besides [g]: set-points change ten times a second, so where powder stops
#: just as a layer ends, a tick of it falls on one side or the other.
POWDER_TOLERANCE_G = 0.05


@dataclass(frozen=True)
class LayerRecord:
    """One layer, over all runs.

    planned : of the whole layer
    reported : from what controller and feeders reported; inferred : as much of it as no report of
        power or place covers
    unreported : motion after a run's last report, inferred from where the machine was found
    weighed_g : {hopper: weight lost in motion}, of hoppers that weighed throughout
    place_error_mm : greatest distance reported of the nozzle from the path
    feed_percent, power_percent : (least, greatest) override reported, None where none was
    entered_again, repeated_mm : how often it was entered in its middle, bead deposited twice there
    runs : names, in order; began, ended : wall clock (UTC)
    reached_line, reached_share : place reached last; complete : no bead of the layer is left
    seq : of the last run's journal record of it, None where its host died
    """

    number: int
    z_mm: float
    lines: tuple[int, int]
    paths: int
    planned: ExecutionFigures
    reported: ExecutionFigures
    inferred: ExecutionFigures
    unreported: ExecutionFigures
    weighed_g: dict[str, float]
    place_error_mm: float
    feed_percent: tuple[int, int] | None
    power_percent: tuple[int, int] | None
    entered_again: int
    repeated_mm: float
    runs: tuple[str, ...]
    began: str
    ended: str
    reached_line: int
    reached_share: float
    complete: bool
    seq: int | None

    @property
    def executed(self) -> ExecutionFigures:
        """All that is known to have been executed, reported or inferred."""
        return self.reported + self.unreported

    @property
    def inferred_mm(self) -> float:
        """As much of the executed path as is inferred."""
        return self.inferred.path_mm + self.unreported.path_mm

    @property
    def deviations(self) -> tuple[str, ...]:
        """Names of the figures that differ from the plan by more than `TOLERANCE`."""
        return deviating_figures(self.planned, self.executed)

    @property
    def difference(self) -> str:
        """How the layer differs from its plan, in words; "" where it does not."""
        if not self.complete:
            return self.remark
        return ", ".join(
            f"{_NAMES.get(name, f'powder {name}')} {100 * (found / wanted - 1.0):+.1f} %"
            for name, wanted, found in figure_pairs(self.planned, self.executed)
            if name in self.deviations and wanted
        )

    @property
    def remark(self) -> str:
        """How the layer differs from one made without interruption, in a few words; or ""."""
        words = []
        if not self.complete:
            first, last = self.lines
            if self.executed.duration_s == 0.0:
                words.append("sent, not reported")
            else:
                words.append(f"partial: line {self.reached_line - first + 1} of {last - first + 1}")
        if self.entered_again:
            times = "" if self.entered_again == 1 else f" ({self.entered_again} times)"
            words.append(f"{self.repeated_mm:.1f} mm twice{times}")
        if self.inferred_mm > DEVIATION_TOLERANCE * self.executed.path_mm:
            words.append(f"{self.inferred_mm:.1f} mm inferred")
        return ", ".join(words)


def sum_of_figures(figures: Iterable[ExecutionFigures]) -> ExecutionFigures:
    """Their sum."""
    return reduce(add, figures, NO_FIGURES)


def figure_pairs(planned: ExecutionFigures,
                 executed: ExecutionFigures) -> list[tuple[str, float, float]]:
    """Field of Figures, or hopper; planned; executed."""
    return [
        *((name, getattr(planned, name), getattr(executed, name)) for name in _NAMES),
        *((name, grams, executed.powder_g.get(name, 0.0))
          for name, grams in planned.powder_g.items()),
    ]


def deviating_figures(planned: ExecutionFigures, executed: ExecutionFigures) -> tuple[str, ...]:
    """Names of the figures that differ by more than `DEVIATION_TOLERANCE`: fields of Figures, or
    hoppers, whose powder differs by more than `POWDER_TOLERANCE_G`, too."""
    return tuple(
        name for name, wanted, found in figure_pairs(planned, executed)
        if abs(found - wanted) > max(DEVIATION_TOLERANCE * abs(wanted),
                                     0.0 if name in _NAMES else POWDER_TOLERANCE_G)
    )


def layer_records(runs: Sequence[RunRecord]) -> Iterator[LayerRecord]:
    """Every layer of which anything was, or may have been, executed, in order."""
    planned: dict[int, PlannedLayer] = {}
    accounts: dict[int, list[tuple[str, LayerAccount]]] = {}
    for run in runs:
        planned |= run.planned
        for account in run.accounts:
            accounts.setdefault(account.layer, []).append((run.run, account))
    still_unknown = runs[-1].run if not runs[-1].seal else ""
    # A run enters the part at the next bead that is left: layers before that one are complete.
    entered = max((run.first_layer or 0 for run in runs), default=0)
    for layer, of_it in sorted(accounts.items()):
        record = _layer(planned[layer], of_it)
        if layer < entered:
            record = replace(record, complete=True)
        if record.executed.duration_s > 0.0 or still_unknown in record.runs:
            yield record


def _layer(plan: PlannedLayer, of_it: Sequence[tuple[str, LayerAccount]]) -> LayerRecord:
    accounts = [account for _, account in of_it]
    reached = max(accounts, key=lambda one: (one.reached_line, one.reached_share))
    moved = [one for one in accounts if one.reported.duration_s > 0.0]
    weighed = {
        name: sum(one.weighed_g[name] for one in moved) for name in plan.figures.powder_g
        if all(name in one.weighed_g for one in moved)
        and not any(one.unreported.duration_s for one in accounts)
    }
    return LayerRecord(
        plan.number, plan.z_mm, plan.lines, plan.paths, plan.figures,
        sum_of_figures(one.reported for one in accounts),
        sum_of_figures(one.inferred for one in accounts),
        sum_of_figures(one.unreported for one in accounts), weighed,
        max(one.place_error_mm for one in accounts),
        _hull([one.feed_percent for one in accounts]),
        _hull([one.power_percent for one in accounts]),
        sum(one.entered_again for one in accounts), sum(one.repeated_mm for one in accounts),
        tuple(dict.fromkeys(run for run, _ in of_it)),
        next((one.began for one in accounts if one.began), ""),
        next((one.ended for one in reversed(accounts) if one.ended), ""),
        reached.reached_line, reached.reached_share, any(one.complete for one in accounts),
        next((one.seq for one in reversed(accounts) if one.seq is not None), None),
    )


def _hull(spans: Sequence[tuple[int, int] | None]) -> tuple[int, int] | None:
    known = [span for span in spans if span is not None]
    return (min(s[0] for s in known), max(s[1] for s in known)) if known else None
