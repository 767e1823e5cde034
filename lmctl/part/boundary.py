"""The surface of a boolean: points on its pieces L1 … L4 and their creases, and the way to them.

Every node of a grid near the surface looks for its nearest point on it, exactly: on one body's
surface, on the crease of two, at the corner of three. These points are swept over the grid; a place
asks the nodes around it for theirs, and searches on from the nearest. Memory goes with the grid
(four bytes a node) and with the surface, never with how finely places are asked for.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lmctl.field.grid import Grid
from lmctl.field.kernel import kernel
from lmctl.field.sweep import sweep_sources
from lmctl.part.operands import MOST_ACTIVE, Operands, alone, joined_by

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Nodes this near a surface, in pitches, look for points on it: no surface passes all of them by.
BAND_PITCHES = 1.0

#: Beyond so many pitches the nearest found point is as good as the nearest there is.
FAR_PITCHES = 16.0

#: Within so many it matters that a foot found on a crease may have a nearer one beside it.
NEAR_PITCHES = 4.0

#: Nodes along each side of the blocks in which the grid is walked.
BLOCK_NODES = 8

#: Points searched for at a time.
POINTS_AT_ONCE = 100_000


@dataclass(frozen=True)
class Boundary:
    """The surface of a union of operands, as points on it.

    grid : holds all of the surface, or all of it that matters
    """

    operands: Operands
    grid: Grid

    @property
    def feet_mm(self) -> FloatArray:
        """(n, 3) float64 [mm], points on the surface; none where there is no surface."""
        return self._found[0]

    @property
    def active(self) -> NDArray[np.int16]:
        """(n, MOST_ACTIVE) int16, the bodies on whose surfaces each foot lies; −1 for none."""
        return self._found[1]

    def nearest(self, points: FloatArray) -> FloatArray:
        """The point of the surface nearest to each of points (n, 3) -> (n, 3) float64 [mm].

        There must be a surface.
        """
        result = np.empty((len(points), 3))
        for first in range(0, len(points), POINTS_AT_ONCE):
            part = slice(first, first + POINTS_AT_ONCE)
            result[part] = self._nearest(np.ascontiguousarray(points[part]))
        return result

    def _nearest(self, points: FloatArray) -> FloatArray:
        feet_mm, active = self._found
        origin, pitch = np.asarray(self.grid.origin_mm), self.grid.pitch_mm
        nodes = (points - origin) / pitch
        rows = _around_kernel(self._sources, feet_mm, points, nodes)
        last = np.asarray(self.grid.shape[::-1]) - 1
        beyond = np.any((nodes < 0) | (nodes > last), axis=1)
        if beyond.any():
            rows[beyond] = self._tree.query(points[beyond])[1]
        feet = feet_mm[rows]
        squared = _squares(feet, points)
        met = active[rows].astype(np.int64)
        self._improve(feet, squared, points, met, FAR_PITCHES)
        creased = np.where(met[:, 1] >= 0, squared, np.inf)
        for slot in range(2):  # beside a crease, one of its surfaces may come nearer still
            self._improve(feet, creased, points, alone(met[:, slot]), NEAR_PITCHES)
        return feet

    def _improve(
        self, feet: FloatArray, squared: FloatArray, points: FloatArray, active: IntArray,
        within_pitches: float,
    ) -> None:
        """Replace feet by nearer points of the surfaces active there, in place."""
        near = np.flatnonzero(squared < (within_pitches * self.grid.pitch_mm) ** 2)
        if len(near):
            at, _, found = self._searched(points[near], feet[near], active[near])
            found_squared = _squares(at, points[near])
            taken = found & (found_squared < squared[near])
            feet[near[taken]] = at[taken]
            squared[near[taken]] = found_squared[taken]

    @cached_property
    def _tree(self) -> cKDTree:
        """For places outside the grid, which no nodes surround."""
        return cKDTree(self.feet_mm)

    def _searched(
        self, points: FloatArray, start: FloatArray, active: IntArray, *, exact: bool = False
    ) -> tuple[FloatArray, IntArray, NDArray[np.bool_]]:
        """The nearest exposed point where the active surfaces meet, or beside it, on a crease with
        what covers that.

        exact : where one body is active, `start` is the nearest point of its surface already
        returns : (n, 3) [mm], the active bodies there, and whether one was found
        """
        at, found = start.copy(), np.ones(len(points), dtype=bool)
        several = np.flatnonzero(active[:, 1] >= 0) if exact else np.arange(len(points))
        at[several], found[several] = self.operands.settle(
            points[several], start[several], active[several])
        active = active.copy()
        for _ in range(MOST_ACTIVE - 1):
            cover = self.operands.covering(at, active)
            rows = np.flatnonzero(found & (cover >= 0) & (active[:, -1] < 0))
            if len(rows) == 0:
                break
            active[rows] = joined_by(active[rows], cover[rows])
            at[rows], found[rows] = self.operands.settle(points[rows], at[rows], active[rows])
        found &= self.operands.exposed(at, active)
        found &= self.operands.covering(at, active) < 0
        return at, active, found

    @cached_property
    def _found(self) -> tuple[FloatArray, NDArray[np.int16]]:
        """Points on the surface and their active bodies."""
        feet, active = [], []
        band = BAND_PITCHES * self.grid.pitch_mm
        for points in self._blocks():
            points = points[np.abs(self.operands.bound(points)) <= band]
            values = self.operands.values(points)
            near = np.abs(values.max(axis=0, initial=-np.inf)) <= band
            for at, met in self._from_nodes(points[near], values[:, near]):
                feet.append(at)
                active.append(met.astype(np.int16))
        if not feet:
            return np.empty((0, 3)), np.empty((0, MOST_ACTIVE), np.int16)
        return np.concatenate(feet), np.concatenate(active)

    def _blocks(self) -> Iterator[FloatArray]:
        """The nodes of those blocks of the grid that the surface may pass, some at a time.

        Bounds change by at most 1 mm per mm, so one in the middle tells for a whole block.
        """
        pitch, origin = self.grid.pitch_mm, np.asarray(self.grid.origin_mm)
        counts = np.ceil(np.array(self.grid.shape[::-1]) / BLOCK_NODES).astype(int)
        reach = (0.5 * (BLOCK_NODES - 1) * np.sqrt(3.0) + BAND_PITCHES) * pitch
        steps = np.stack(
            np.meshgrid(*[np.arange(BLOCK_NODES)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        blocks = np.stack(
            np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), axis=-1).reshape(-1, 3)
        firsts = origin + BLOCK_NODES * pitch * blocks
        middles = firsts + 0.5 * (BLOCK_NODES - 1) * pitch
        at_once = POINTS_AT_ONCE // BLOCK_NODES**3
        for first in range(0, len(blocks), POINTS_AT_ONCE):
            part = slice(first, first + POINTS_AT_ONCE)
            kept = firsts[part][np.abs(self.operands.bound(middles[part])) <= reach]
            for start in range(0, len(kept), at_once):
                some = kept[start : start + at_once]
                yield (some[:, None] + pitch * steps).reshape(-1, 3)

    def _from_nodes(
        self, points: FloatArray, values: FloatArray
    ) -> list[tuple[FloatArray, IntArray]]:
        """What nodes near the surface find: on the deepest body's surface, and on its crease with
        the next. Each as (points on the surface, their active bodies)."""
        if len(points) == 0:
            return []
        order = np.argsort(-values, axis=0, kind="stable")
        deepest = order[0]
        at = self.operands.feet(points, deepest)
        looks = [(at, alone(deepest), np.arange(len(points)))]
        if len(order) > 1:
            second = values[order[1], np.arange(len(points))]
            rows = np.flatnonzero(second >= -BAND_PITCHES * self.grid.pitch_mm)
            looks.append((at[rows], joined_by(alone(deepest[rows]), order[1, rows]), rows))
        found = []
        for start, active, rows in looks:
            at, active, good = self._searched(points[rows], start, active, exact=True)
            good &= _squares(at, points[rows]) <= (2 * self.grid.pitch_mm) ** 2
            if good.any():
                found.append((at[good], active[good]))
        return found

    @cached_property
    def _sources(self) -> NDArray[np.int32]:
        """(nz, ny, nx) int32: the foot nearest to each node."""
        feet = self.feet_mm
        sources = np.full(self.grid.shape, -1, dtype=np.int32)
        squared = np.full(self.grid.shape, np.inf, dtype=np.float32)
        relative = (feet - np.asarray(self.grid.origin_mm)) / self.grid.pitch_mm
        _seed_kernel(relative, sources, squared)
        del squared, relative
        sweep_sources(sources, feet, self.grid)
        return sources


def _squares(a: FloatArray, b: FloatArray) -> FloatArray:
    squares: FloatArray = ((a - b) ** 2).sum(axis=1)
    return squares


@kernel
def _seed_kernel(
    relative: FloatArray, sources: NDArray[np.int32], squared: NDArray[np.float32]
) -> None:
    """Offer each foot to the nodes around it; a node keeps the nearest it was offered.

    relative : feet in node units; sources : −1 where none was offered; squared : inf there
    """
    nz, ny, nx = sources.shape
    for n in range(len(relative)):
        x, y, z = relative[n, 0], relative[n, 1], relative[n, 2]
        i0, j0, k0 = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        for k in range(max(k0 - 1, 0), min(k0 + 3, nz)):
            for j in range(max(j0 - 1, 0), min(j0 + 3, ny)):
                for i in range(max(i0 - 1, 0), min(i0 + 3, nx)):
                    d2 = np.float32((x - i) ** 2 + (y - j) ** 2 + (z - k) ** 2)
                    if d2 < squared[k, j, i]:
                        squared[k, j, i] = d2
                        sources[k, j, i] = n


@kernel
def _around_kernel(
    sources: NDArray[np.int32], feet: FloatArray, points: FloatArray, nodes: FloatArray
) -> IntArray:
    """Of the feet that the corners of each point's cell know, the one nearest to the point.

    nodes : (n, 3), where to look, in node units; taken to the grid's rim where they lie outside
    """
    nz, ny, nx = sources.shape
    rows = np.empty(len(points), dtype=np.int64)
    for n in range(len(points)):
        i = int(min(max(nodes[n, 0], 0.0), nx - 1.001))
        j = int(min(max(nodes[n, 1], 0.0), ny - 1.001))
        k = int(min(max(nodes[n, 2], 0.0), nz - 1.001))
        least, best = np.inf, 0
        for c in range(8):
            row = sources[k + (c >> 2 & 1), j + (c >> 1 & 1), i + (c & 1)]
            d2 = (
                (feet[row, 0] - points[n, 0]) ** 2 + (feet[row, 1] - points[n, 1]) ** 2
                + (feet[row, 2] - points[n, 2]) ** 2
            )
            if d2 < least:
                least, best = d2, row
        rows[n] = best
    return rows
