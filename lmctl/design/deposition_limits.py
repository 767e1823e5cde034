"""What the cell can deposit: gradients along and across tracks, least flows, forbidden mixtures.

A mixture follows its set-points with the lag τ of a hopper, so that a fraction changes at a rate of
about 0.5/τ (docs/explanation/powder-delivery.md). Along a track that is 0.5/(τ v) a millimetre.
From one track to the next the change has the time of run-out, travel and run-in. Dead time shifts
both alike, and is led.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.machine import MachineProfile
from lmctl.config.simulation import ForbiddenMixture
from lmctl.design.free_design import FreeDesign
from lmctl.part.part import Part

#: Places in the part at which limits are asked while a design is searched, and at its end.
SEARCH_PLACES, CHECK_PLACES = 600, 4000

#: Planning rounds a mixture that needs less than a hopper's least flow to none of it, or to the
#: least; every gradient that begins at nothing has such mixtures. So much of the part may, or as
#: much as at the start.
UNDER_FLOW_SHARE = 0.05

#: Layers that places are taken from.
_HEIGHTS = 5

#: Neighbours of a place that a gradient is taken between, as a share of the bead width.
_REACH_SHARE = 0.25

#: How sharply the largest gradient is smoothed, from above.
_SHARPNESS = 150.0


@dataclass(frozen=True)
class LayingLimits:
    """Limits of a cell and a process, fractions per mm.

    along_1_mm, across_1_mm : largest gradient of any fraction along and across tracks; along is
        infinite where tracks follow lines of equal mixture
    least_fraction : of each material, below which its hopper runs below its least flow
    """

    along_1_mm: float
    across_1_mm: float
    least_fraction: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class LayingCheck:
    """Where a design goes beyond the limits.

    over_gradient : places whose gradient is too large; places : how many were asked
    largest_along, largest_across : of the limit
    under_flow_share, forbidden_share : share of the part in mixtures that no hopper can deliver,
        and in forbidden ones
    """

    over_gradient: int
    places: int
    largest_along: float
    largest_across: float
    under_flow_share: float
    forbidden_share: float


def laying_limits(part: Part, profile: MachineProfile, rate_per_s: float) -> LayingLimits:
    """The limits of a part's process on a machine.

    rate_per_s : how fast a fraction may change at the nozzle, in units of 1/τ
    """
    process = part.process
    hoppers = {h.material: h for h in profile.hopper}
    used = [hoppers[m.name] for m in part.materials if m.name in hoppers] or list(profile.hopper)
    lag_s = max(max(h.lag_s for h in used), 1e-3)
    rate = rate_per_s / lag_s
    speed = min((m.speed_mm_s for m in part.materials), default=process.speed_mm_s)
    pitch = process.bead_width_mm * (1.0 - process.overlap)
    between_s = process.lead_in_mm / speed + (
        process.lead_in_mm + pitch) / process.travel_speed_mm_s
    if process.powder == "dwell":
        between_s += process.dwell_s
    volume_mm3_s = pitch * process.layer_height_mm * speed
    least = []
    for material in part.materials:
        flow = hoppers[material.name].min_flow_g_min if material.name in hoppers else 0.0
        least.append(flow / 60.0 * material.catch_efficiency
                     / (material.density_g_mm3 * volume_mm3_s))
    along = np.inf if process.strategy == "iso-composition" else rate / speed
    return LayingLimits(float(along), rate * between_s / pitch, tuple(least))


class LayingConstraints:
    """Smooth measures of how far a design goes beyond the limits, with gradients.

    Values at most 0 are within. names : of the entries
    """

    def __init__(
        self, part: Part, design: FreeDesign, limits: LayingLimits,
        forbidden: tuple[ForbiddenMixture, ...], count: int = SEARCH_PLACES,
    ) -> None:
        self._design, self._limits, self._count = design, limits, count
        names = [material.name for material in part.materials]
        self._bands = [(names.index(f.material), *f.between) for f in forbidden]
        self._flow_bands = [(n, 0.0, least) for n, least in enumerate(limits.least_fraction)
                            if least > 0]
        places, across = _places_on_tracks(part, count)
        self._step_mm = _REACH_SHARE * part.process.bead_width_mm
        along = np.stack([-across[:, 1], across[:, 0], np.zeros(len(places))], axis=1)
        step = self._step_mm
        self._stencil = np.concatenate([places, places + step * along, places - step * along,
                                        places + step * across, places - step * across])
        self._allowed: FloatArray = np.zeros(0)
        start = self._raw(self._fractions(design.start))
        self._allowed = np.concatenate([np.ones(2), *(
            [np.maximum(start[2:3], UNDER_FLOW_SHARE)] if self._flow_bands else []),
            *([np.full(1, 1e-4)] if self._bands else [])])
        self.names = ["gradient along tracks", "gradient across tracks",
                      *(["least flow"] if self._flow_bands else []),
                      *(["forbidden mixtures"] if self._bands else [])]

    def values(self, design: FloatArray) -> FloatArray:
        """One value a limit, at most 0 where it holds."""
        return self._raw(self._fractions(design)) - self._allowed

    def gradients(self, design: FloatArray) -> FloatArray:
        """(limits, numbers) of `values` by the design."""
        base = self._fractions(design)
        slopes = self._raw_slopes(base)
        found = np.empty((len(slopes), len(self._design.numbers)))
        for number in range(len(self._design.numbers)):
            change = self._design.slope(design, self._stencil, number)
            found[:, number] = (slopes * change.reshape(base.shape)).sum(axis=(1, 2, 3))
        return found

    def check(self, design: FloatArray) -> LayingCheck:
        """What a design breaks, counted."""
        base = self._fractions(design)
        along, across = self._gradients_of(base)
        ratio = np.stack([np.abs(along).max(axis=1) / self._limits.along_1_mm,
                          np.abs(across).max(axis=1) / self._limits.across_1_mm])
        return LayingCheck(
            int((ratio > 1.0 + 1e-9).any(axis=0).sum()), self._count, float(ratio[0].max()),
            float(ratio[1].max()), _in_bands(base[0], self._flow_bands, 1e-6),
            _in_bands(base[0], self._bands, 0.0))

    def _fractions(self, design: FloatArray) -> FloatArray:
        """(5, places, n_materials): at places, and beside them along and across."""
        return self._design.fractions(design, self._stencil).reshape(5, self._count, -1)

    def _gradients_of(self, base: FloatArray) -> tuple[FloatArray, FloatArray]:
        return ((base[1] - base[2]) / (2 * self._step_mm),
                (base[3] - base[4]) / (2 * self._step_mm))

    def _raw(self, base: FloatArray) -> FloatArray:
        along, across = self._gradients_of(base)
        found = [_smooth_largest(along / self._limits.along_1_mm)[0],
                 _smooth_largest(across / self._limits.across_1_mm)[0]]
        for bands in (self._flow_bands, self._bands):
            if bands:
                found.append(sum(float(_bump(base[0, :, n], low, high)[0].mean())
                                 for n, low, high in bands))
        return np.array(found)

    def _raw_slopes(self, base: FloatArray) -> FloatArray:
        """(limits, 5, places, n_materials) derivatives by the fractions."""
        along, across = self._gradients_of(base)
        found = []
        for pair, gradient, limit in ((1, along, self._limits.along_1_mm),
                                      (3, across, self._limits.across_1_mm)):
            slope = np.zeros_like(base)
            by_ratio = _smooth_largest(gradient / limit)[1] / limit / (2 * self._step_mm)
            slope[pair], slope[pair + 1] = by_ratio, -by_ratio
            found.append(slope)
        for bands in (self._flow_bands, self._bands):
            if bands:
                slope = np.zeros_like(base)
                for n, low, high in bands:
                    slope[0, :, n] += _bump(base[0, :, n], low, high)[1] / self._count
                found.append(slope)
        return np.stack(found)


def _smooth_largest(ratio: FloatArray) -> tuple[float, FloatArray]:
    """A bound of the largest size from above, and its slopes."""
    size = np.sqrt(ratio**2 + 1e-12)
    most = float(size.max())
    term = np.exp(_SHARPNESS * (size - most))
    total = float(term.sum())
    return most + float(np.log(total)) / _SHARPNESS, np.asarray(term / total * ratio / size)


def _bump(values: FloatArray, low: float, high: float) -> tuple[FloatArray, FloatArray]:
    """Positive between two fractions, 1 in their middle, 0 elsewhere; and its slope."""
    width = high - low
    inside = (values > low) & (values < high)
    share = (values - low) / width
    return (np.where(inside, 4.0 * share * (1.0 - share), 0.0),
            np.where(inside, 4.0 * (1.0 - 2.0 * share) / width, 0.0))


def _in_bands(
    fractions: FloatArray, bands: list[tuple[int, float, float]], slack: float
) -> float:
    inside = np.zeros(len(fractions), dtype=bool)
    for n, low, high in bands:
        inside |= (fractions[:, n] > low + slack) & (fractions[:, n] < high - slack)
    return float(inside.mean())


def _places_on_tracks(part: Part, count: int) -> tuple[FloatArray, FloatArray]:
    """Places (count, 3) in the part, and the direction across the tracks at each; always the same.

    Tracks are contours of the in-plane distance, so across is along its slope.
    """
    low, high = part.bounds_mm
    rng = np.random.default_rng(1)
    places, across = [], []
    for height in low[2] + (high[2] - low[2]) * (np.arange(_HEIGHTS) + 0.5) / _HEIGHTS:
        section = part.section(float(height))
        depth = section.in_plane_distance
        x, y = section.grid.x_mm, section.grid.y_mm
        by_y, by_x = map(np.asarray, np.gradient(depth.astype(np.float64), y, x))
        rows, columns = np.nonzero((depth > 0) & (np.hypot(by_x, by_y) > 0.9))
        places.append(np.stack([x[columns], y[rows], np.full(len(rows), height)], axis=1))
        across.append(np.stack([by_x[rows, columns], by_y[rows, columns],
                                np.zeros(len(rows))], axis=1))
    found, ways = np.concatenate(places), np.concatenate(across)
    chosen = rng.choice(len(found), count, replace=len(found) < count)
    ways = ways[chosen]
    size = np.hypot(ways[:, 0], ways[:, 1])
    return found[chosen], ways / size[:, None]
