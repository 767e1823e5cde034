"""Group nodes into small blocks and find, from each block's middle, which leaves matter in it.

Distances change by at most 1 mm per mm, so a leaf's distance in the middle of a block bounds its
distance all over the block. Most blocks have one or two leaves near. The others count as infinitely
far, on their own side, which changes neither the minimum nor the maximum of the near ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.field.grid import Window
from lmctl.part.booleans.expression import BooleanExpression

#: Nodes along each side of a block.
BLOCK_NODES = 8

#: Distances held at a time: leaves times nodes.
VALUES_AT_ONCE = 2_000_000

#: Nodes at a time, however few leaves there are.
NODES_AT_ONCE = 250_000


@dataclass(frozen=True, eq=False)
class NearbyLeaves:
    """What is near in some blocks of a window.

    points : (b, m, 3) float64 [mm]
    leaf_bounds_mm : of each leaf its bound in them, (b, m) float64 [mm], or (b, 1) and infinite
    where it is
        far from all of these blocks
    is_leaf_near : (k, b) bool, which leaves are near in which of them
    """

    points: FloatArray
    leaf_bounds_mm: list[FloatArray]
    is_leaf_near: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class NodeBlocks:
    """A window's nodes as blocks; nodes beyond the window's rim are included, and dropped later."""

    expression: BooleanExpression
    window: Window

    @cached_property
    def _side(self) -> tuple[int, int, int]:
        planes, ny, nx = self.window.shape
        return min(BLOCK_NODES, planes), min(BLOCK_NODES, ny), min(BLOCK_NODES, nx)

    @cached_property
    def first_node_indices(self) -> IntArray:
        """(n, 3) int64: x, y, z numbers of each block's first node, in the window."""
        counts = [-(-n // side) for n, side in zip(self.window.shape, self._side, strict=True)]
        numbers = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1)
        return (numbers.reshape(-1, 3) * self._side)[:, ::-1]

    @cached_property
    def node_offsets(self) -> IntArray:
        """(m, 3) int64: from a block's first node to each of its nodes."""
        numbers = np.stack(np.meshgrid(*map(np.arange, self._side), indexing="ij"), axis=-1)
        return numbers.reshape(-1, 3)[:, ::-1]

    @property
    def radius_mm(self) -> float:
        """From a block's middle to its corners [mm]."""
        return float(0.5 * self.window.grid.pitch_mm * np.linalg.norm(self.node_offsets[-1]))

    def leaf_bounds_at_centres_mm(self) -> FloatArray:
        """Each leaf's bound in the blocks' middles, (k, n) float64 [mm]."""
        middles = self._origin + self.window.grid.pitch_mm * (
            self.first_node_indices + 0.5 * self.node_offsets[-1])
        found = np.empty((len(self.expression.leaves), len(middles)))
        for row, leaf in zip(found, self.expression.leaves, strict=True):
            for first in range(0, len(middles), NODES_AT_ONCE):
                part = slice(first, first + NODES_AT_ONCE)
                row[part] = leaf.distance_bound(middles[part])
        return found

    def iterate_nearby(
        self, which: IntArray, bounds: FloatArray, near: NDArray[np.bool_]
    ) -> Iterator[tuple[IntArray, NearbyLeaves]]:
        """Bounds of near leaves in some of the blocks, a bounded number at a time.

        which : (n,) numbers of blocks; bounds, near : (k, n), of their middles
        Yields the numbers of blocks and what is near in them.
        """
        each = len(self.node_offsets) * max(1, int(near.sum(axis=0).max(initial=1)))
        at_once = max(1, min(VALUES_AT_ONCE // each, NODES_AT_ONCE // len(self.node_offsets)))
        pitch = self.window.grid.pitch_mm
        for first in range(0, len(which), at_once):
            part = slice(first, first + at_once)
            some, their = which[part], near[:, part]
            points = self._origin + pitch * (self.first_node_indices[some,
                                                                     None] + self.node_offsets)
            rows = []
            for leaf, close, middle in zip(
                self.expression.leaves, their, bounds[:, part], strict=True
            ):
                far = np.where(middle > 0, np.inf, -np.inf)[:, None]
                if close.all():
                    far = leaf.distance_bound(points.reshape(-1, 3)).reshape(points.shape[:2])
                elif close.any():
                    far = np.repeat(far, points.shape[1], axis=1)
                    found = leaf.distance_bound(points[close].reshape(-1, 3))
                    far[close] = found.reshape(-1, points.shape[1])
                rows.append(far)
            yield some, NearbyLeaves(points, rows, their)

    def assemble(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """From blocks (n, m) to the window's own shape, without what is beyond its rim."""
        side = self._side
        counts = [-(-n // step) for n, step in zip(self.window.shape, side, strict=True)]
        padded = values.reshape(*counts, *side).transpose(0, 3, 1, 4, 2, 5)
        planes, ny, nx = self.window.shape
        joined = padded.reshape([n * step for n, step in zip(counts, side, strict=True)])
        return joined[:planes, :ny, :nx]

    @property
    def _origin(self) -> FloatArray:
        grid = self.window.grid
        origin = np.array(grid.origin_mm)
        origin[2] += grid.pitch_mm * self.window.z_first
        return origin
