"""One account for each layer a run works on: what is planned for it and what went into it.

An account lasts over holds. It is opened when the first line of its layer is about to be sent, and
closed when the layer is over or the run ends, whichever comes first: every layer of which anything
was executed has one. Both are journaled; between them the samples carry the present account.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from lmctl.run.execution.layer_plan import LayerPlan
from lmctl.run.journal.figures import NO_FIGURES, ExecutionFigures
from lmctl.run.journal.recorder import RunRecorder, place_fields
from lmctl.run.program.place import ProgramPlace

#: Less bead than this is no bead left: nothing shorter is entered again (see `reentry`) [mm].
MIN_BEAD_MM = 0.02


@dataclass
class _Account:
    """Of one layer. reported, inferred : sums so far; weighed_g : weight lost in motion so far

    feed_percent, power_percent : least and greatest override reported
    """

    plan: LayerPlan
    reported: ExecutionFigures = NO_FIGURES
    inferred: ExecutionFigures = NO_FIGURES
    weighed_g: dict[str, float] = field(default_factory=dict)
    weight_g: Mapping[str, float] | None = None  # where powder began to count, None before
    unweighed: set[str] = field(default_factory=set)  # did not weigh throughout
    place_error_mm: float = 0.0
    feed_percent: tuple[int, int] | None = None
    power_percent: tuple[int, int] | None = None
    entered_again: int = 0
    repeated_mm: float = 0.0

    def as_json(self, reached: ProgramPlace) -> dict[str, Any]:
        """As journal records carry it; what is nothing is left out."""
        weighed_g = {
            name: round(grams, 2) for name, grams in sorted(self.weighed_g.items())
            if name not in self.unweighed and self.weight_g is None
        }
        again = {"entered_again": self.entered_again, "repeated_mm": round(self.repeated_mm, 3)}
        return {
            "layer": self.plan.layer, "reached": place_fields(reached),
            "reported": self.reported.as_json(),
            **({} if self.inferred is NO_FIGURES else {"inferred": self.inferred.as_json()}),
            **({"weighed_g": weighed_g} if weighed_g else {}),
            "place_error_mm": round(self.place_error_mm, 3),
            "feed_percent": self.feed_percent, "power_percent": self.power_percent,
            **(again if self.entered_again else {}),
        }


def _widened(span: tuple[int, int] | None, value: int) -> tuple[int, int]:
    return (value, value) if span is None else (min(span[0], value), max(span[1], value))


class LayerAccounts:
    """The accounts of one run.

    plan_of : what the job plans for a layer, by its index; to be set before any is opened
    """

    plan_of: Callable[[int], LayerPlan]

    def __init__(self, recorder: RunRecorder) -> None:
        self._recorder = recorder
        self._open: dict[int, _Account] = {}
        self._reached: Callable[[], tuple[ProgramPlace, float]] = lambda: (ProgramPlace(), 0.0)
        recorder.layer_so_far = self._so_far

    def follow_place(self, reached: Callable[[], tuple[ProgramPlace, float]]) -> None:
        """Motion begins; from now on this gives the place it has reached, and the bead left there.

        The bead left is that of the layer which holds the place [mm].
        """
        self._reached = reached

    def open_layer(self, layer: int) -> None:
        """Lines of a layer are about to be sent."""
        if layer not in self._open:
            plan = self.plan_of(layer)
            self._open[layer] = _Account(plan)
            self._recorder.record_layer_opened(
                layer=layer, z_mm=round(plan.z_mm, 6), lines=list(plan.lines), paths=plan.paths,
                planned=plan.figures.as_json(),
            )

    def start_weighing(self, layer: int, weight_g: Mapping[str, float]) -> None:
        """Powder counts from here on; later calls before `leave` change nothing.

        weight_g : of the hoppers that weigh
        """
        if self._open[layer].weight_g is None:
            self._open[layer].weight_g = weight_g

    def leave_layer(self, layer: int, weight_g: Mapping[str, float]) -> None:
        """Motion in a layer ends, or rests."""
        account = self._open.get(layer)
        if account is None or account.weight_g is None:
            return
        before_g = account.weight_g
        account.unweighed |= account.plan.figures.powder_g.keys() - (
            before_g.keys() & weight_g.keys())
        for name in account.plan.figures.powder_g.keys() - account.unweighed:
            lost_g = before_g[name] - weight_g[name]
            account.weighed_g[name] = account.weighed_g.get(name, 0.0) + lost_g
        account.weight_g = None

    def is_weighed(self, layer: int) -> bool:
        """Whether `weigh_from` has been called for a layer, and not `leave` since."""
        return self._open[layer].weight_g is not None

    def record_reentry(self, layer: int, repeated_mm: float) -> None:
        """A layer is entered in its middle, with so much bead deposited twice."""
        self.open_layer(layer)
        self._open[layer].entered_again += 1
        self._open[layer].repeated_mm += repeated_mm

    def add_figures(self, layer: int, figures: ExecutionFigures, *, inferred: bool) -> None:
        """Motion in a layer. inferred : no report shows its power"""
        account = self._open[layer]
        account.reported += figures
        if inferred:
            account.inferred += figures

    def on_report(self, layer: int, off_mm: float, overrides: tuple[int, int, int]) -> None:
        """A report: how far off the path the nozzle is; feed, rapid and power override [%]."""
        if (account := self._open.get(layer)) is not None:
            account.place_error_mm = max(account.place_error_mm, off_mm)
            account.feed_percent = _widened(account.feed_percent, overrides[0])
            account.power_percent = _widened(account.power_percent, overrides[2])

    def close_before(self, layer: int, lines: int | None = None) -> None:
        """Close the accounts of earlier layers. lines : only of those that so many lines end"""
        for index in sorted(self._open):
            last_line = self._open[index].plan.lines[1]
            if index < layer and (lines is None or last_line < lines):
                self._close(index, ProgramPlace(last_line + 1), 0.0)

    def close_all(self, reached: ProgramPlace, left_mm: float) -> None:
        """The run is over. left_mm : bead left to deposit in the layer that holds `reached`"""
        for index in sorted(self._open):
            first_line, last_line = self._open[index].plan.lines
            if reached.line > last_line:
                self._close(index, ProgramPlace(last_line + 1), 0.0)
            elif reached.line < first_line:
                self._close(index, ProgramPlace(first_line), self._open[index].plan.figures.path_mm)
            else:
                self._close(index, reached, left_mm)

    def close_at_reached_place(self) -> None:
        """The run is over, wherever it is."""
        if self._open:
            self.close_all(*self._reached())

    def _close(self, layer: int, reached: ProgramPlace, left_mm: float) -> None:
        account = self._open.pop(layer)
        self._recorder.record_layer(
            **account.as_json(reached), complete=left_mm < MIN_BEAD_MM,
        )

    def _so_far(self) -> list[dict[str, Any]]:
        """The open accounts, as the samples carry them."""
        if not self._open:
            return []
        reached, _ = self._reached()
        return [
            account.as_json(reached)
            for account in self._open.values() if account.reported is not NO_FIGURES
        ]
