"""The least and the greatest share within all intervals, and the parameter that moves it most.

Each parameter is tried at both ends of its interval alone; from the ends that shift the mixture the
same way, and from those that are worst alone, one parameter after the other is moved to wherever
the share is least, until none makes it less. The search is cheap and need not find the very worst
combination; it never states a share that no combination has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from lmctl.array_types import FloatArray
from lmctl.plan.margins.cell_parameters import CellParameter, Level
from lmctl.plan.margins.path_shares import PathShares
from lmctl.plan.sequence.nozzle_flow import CellValues

_LEVELS: tuple[Level, ...] = (-1, 0, 1)
_ENDS: tuple[Level, ...] = (-1, 1)
#: What the mean error counts beside the share: it decides where no share differs.
_OF_MEAN_ERROR = 1e-2
#: Each parameter is moved so often at most.
_MOST_SWEEPS = 3

Levels = tuple[Level, ...]
ValuesOf = Callable[[Levels], CellValues]


@dataclass(frozen=True)
class SingleDeviation:
    """One parameter at an end of its interval, all others as planned, and the share then."""

    parameter: CellParameter
    level: Level
    share: float

    @property
    def text(self) -> str:
        """In words, as "hopper B's dead time 0.09 s longer"."""
        return f"{self.parameter.name} {self.parameter.deviation_text(self.level)}"


@dataclass(frozen=True)
class WorstCase:
    """Shares of path within intervals.

    planned : with every parameter as planned
    worst, best : least and greatest share of those tried; at_worst, at_best : the levels then
    alone : for each parameter its worse end, the parameter that moves the share most first
    without : at worst but for one parameter, which is as planned; what helps most comes first
    """

    planned: float
    worst: float
    best: float
    at_worst: Levels
    at_best: Levels
    alone: tuple[SingleDeviation, ...]
    without: tuple[SingleDeviation, ...]


class _Search:
    """Shares of combinations, each computed once."""

    def __init__(self, shares: PathShares, values_of: ValuesOf) -> None:
        self._shares = shares
        self._values_of = values_of
        self._known: dict[Levels, tuple[float, float]] = {}

    def share(self, levels: Levels) -> float:
        return self._of(levels)[0]

    def score(self, levels: Levels) -> float:
        """The share, and a little of the mean error where shares are equal."""
        share, mean_error = self._of(levels)
        return share - _OF_MEAN_ERROR * mean_error

    def _of(self, levels: Levels) -> tuple[float, float]:
        if levels not in self._known:
            errors = self._shares.errors(self._values_of(levels))
            weight = self._shares.length_mm
            self._known[levels] = (self._shares.share(errors),
                                   float(errors @ weight) / float(weight.sum()))
        return self._known[levels]

    def followed(self, start: Levels, sign: float) -> Levels:
        """Levels from `start` on, moved one by one to where sign · score is greatest."""
        now = start
        for _ in range(_MOST_SWEEPS):
            before = now
            for at in range(len(now)):
                now = max((_with(now, at, level) for level in _LEVELS),
                          key=lambda levels: (sign * self.score(levels), levels == now))
            if now == before:
                break
        return now


def as_planned(parameters: Sequence[object]) -> Levels:
    """The levels at which every parameter is as planned."""
    planned: Level = 0
    return (planned,) * len(parameters)


def worst_case(
    shares: PathShares, parameters: Sequence[CellParameter], values_of: ValuesOf
) -> WorstCase:
    """The range of the share within the parameters' intervals. values_of : hoppers at levels"""
    search = _Search(shares, values_of)
    planned = as_planned(parameters)
    ends = [_with(planned, at, level) for at in range(len(parameters)) for level in _ENDS]
    mean = [_mean_volume_shift(shares, values_of, planned, levels) for levels in ends]
    starts = [
        _joined(_worse_ends(ends, [search.score(levels) for levels in ends])),
        _joined(_worse_ends(ends, mean)), _joined(_worse_ends(ends, [-one for one in mean])),
    ]
    tried = [planned, *ends, *(search.followed(start, -1.0) for start in starts)]
    at_worst = min(tried, key=search.score)
    at_best = max([*tried, search.followed(planned, 1.0)], key=search.score)
    worse = [min((_with(planned, at, level) for level in _ENDS), key=search.score)
             for at in range(len(parameters))]
    alone = [SingleDeviation(parameter, levels[at], search.share(levels)) for at, (
        parameter, levels) in sorted(enumerate(zip(parameters, worse, strict=True)),
                                     key=lambda one: search.score(one[1][1]))]
    without = sorted(
        (SingleDeviation(parameter, level, search.share(_with(at_worst, at, 0)))
         for at, (parameter, level) in enumerate(zip(parameters, at_worst, strict=True)) if level),
        key=lambda one: -one.share)
    return WorstCase(search.share(planned), min(search.share(at) for at in tried),
                     max(search.share(at) for at in (*tried, at_best)), at_worst, at_best,
                     tuple(alone), tuple(without))


def _with(levels: Levels, at: int, level: Level) -> Levels:
    return (*levels[:at], level, *levels[at + 1 :])


def _worse_ends(ends: Sequence[Levels], measure: Sequence[float]) -> Iterable[Levels]:
    """Of each parameter's two ends the one of the lesser measure."""
    return (ends[k] if measure[k] <= measure[k + 1] else ends[k + 1]
            for k in range(0, len(ends), 2))


def _joined(ends: Iterable[Levels]) -> Levels:
    """All parameters at the ends where one of these has each."""
    columns = list(zip(*ends, strict=True))
    return tuple(next((level for level in column if level), 0) for column in columns)


def _mean_volume_shift(
    shares: PathShares, values_of: ValuesOf, planned: Levels, levels: Levels
) -> float:
    """By how much the first material's share of the volume rises."""
    def first_share(volume: FloatArray) -> float:
        return float(volume[:, 0].sum()) / max(float(volume.sum()), 1e-300)

    return first_share(shares.volume_mm3_s(values_of(levels))) - first_share(
        shares.volume_mm3_s(values_of(planned)))
