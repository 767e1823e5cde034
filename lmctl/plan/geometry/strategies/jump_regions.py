"""Regions of a slice between jumps of its material, so that no track crosses one."""

from __future__ import annotations

from dataclasses import dataclass

import contourpy
import numpy as np

from lmctl.array_types import BoolArray, FloatArray, IntArray
from lmctl.field.kernel import kernel
from lmctl.plan.geometry.link_lines import LinkableTrack
from lmctl.plan.geometry.mixture_map import MixtureAt, MixtureMap, nearest_nodes
from lmctl.plan.geometry.planar_region import grown, loops_of, region_of

#: A change of any volume fraction by more than this, within a 30th of a node, is a jump: twice the
#: tolerance of a mixture.
JUMP_FRACTION = 0.04
_HALVINGS = 5
#: A region smaller than this, in square pitches, belongs to the one beside it.
_LEAST_AREA_PITCHES_SQ = 3.0


@dataclass(frozen=True)
class JumpRegions:
    """Connected regions between jumps.

    label : (ny, nx) int64, of each node of the map, beyond the outline that of the nearest inside
    cross_x, cross_y : (ny, nx) float64, where the jump lies between a node and the next one in x
        and in y, as a part of the way
    count : regions
    """

    field: MixtureMap
    label: IntArray
    cross_x: FloatArray
    cross_y: FloatArray
    count: int

    def outlines(self) -> list[list[FloatArray]]:
        """Outline of each region on the map: closed loops (k, 2) [mm]."""
        return [self._outline(number) for number in range(self.count)]

    def _outline(self, number: int) -> list[FloatArray]:
        grid = self.field.grid
        own = np.pad((self.label == number).astype(np.float64), 1)
        generator = contourpy.contour_generator(z=own, name="serial",
                                                line_type=contourpy.LineType.Separate)
        found = []
        ny, nx = grid.shape
        for line in generator.lines(0.5):
            at = np.asarray(line) - 1.0  # in nodes of the map
            low = np.clip(np.floor(at + 1e-9).astype(np.intp), 0, [nx - 1, ny - 1])
            on_row = np.abs(at[:, 1] - np.round(at[:, 1])) < 0.25
            part = np.where(on_row, self.cross_x[low[:, 1], low[:, 0]],
                            self.cross_y[low[:, 1], low[:, 0]])
            edge = (at >= 0).all(axis=1) & (at[:, 0] <= nx - 1) & (at[:, 1] <= ny - 1)
            place = np.where(on_row[:, None], np.column_stack([low[:, 0] + part, at[:, 1]]),
                             np.column_stack([at[:, 0], low[:, 1] + part]))
            place = np.where(edge[:, None], place, at)
            found.append(np.array(grid.origin_mm) + place * grid.pitch_mm)
        return found


def tracks_cross_jump(tracks: list[LinkableTrack]) -> bool:
    """Whether the mixture jumps between two neighbouring points of a track."""
    return any(_greatest_step(np.ascontiguousarray(track.table), 3) > JUMP_FRACTION
               for track in tracks)


@kernel
def _greatest_step(table: FloatArray, first: int) -> float:
    """Greatest difference of two rows in a row, in the columns from the first named on."""
    most = 0.0
    for k in range(1, len(table)):
        for c in range(first, table.shape[1]):
            most = max(most, abs(table[k, c] - table[k - 1, c]))
    return most


def jump_regions(field: MixtureMap, pitch_mm: float) -> JumpRegions | None:
    """The regions of a slice; None where no jump of its material parts two of them."""
    ny, nx = field.grid.shape
    along_x, cross_x = _jumps(field, 1)
    along_y, cross_y = _jumps(field, 0)
    if not (along_x.any() or along_y.any()):
        return None
    label = _connected(field.inside, along_x, along_y)
    size = np.bincount(label[field.inside])
    small = size * field.grid.pitch_mm**2 < _LEAST_AREA_PITCHES_SQ * pitch_mm**2
    kept = field.inside & ~small[np.maximum(label, 0)]
    if not kept.any():
        return None
    rows, columns = nearest_nodes(kept)
    names, label = np.unique(label[rows, columns], return_inverse=True)
    if len(names) < 2:
        return None
    rows, columns = nearest_nodes(field.inside)
    return JumpRegions(field, label.reshape(ny, nx).astype(np.int64), cross_x[rows, columns],
                       cross_y[rows, columns], len(names))


def region_loops(
    regions: JumpRegions, loops: list[FloatArray], step_mm: float, *, from_highest: bool
) -> list[list[FloatArray]]:
    """What of a slice with these loops each region fills.

    step_mm : how far regions reach beyond the jump, each into those that come after it in order
        of grade; 0 for a seam on the jump itself
    from_highest : the order begins with the region of highest grade
    """
    left = region_of(loops)
    shapes = [region_of(outline) for outline in regions.outlines()]
    found: list[list[FloatArray]] = [[] for _ in shapes]
    grade = regions.field.grade
    middle = [float(grade[regions.label == number].mean()) for number in range(regions.count)]
    order = np.argsort(middle, kind="stable")
    for number in (order[::-1] if from_highest else order).tolist():
        shape = grown(shapes[number], step_mm) if step_mm else shapes[number]
        found[number] = loops_of(left ^ shape)
        left = left - shape if step_mm else left
    return found


def region_mixture(regions: JumpRegions, number: int) -> MixtureAt:
    """The material field of one region; beyond its jumps, that of its nearest node."""
    field = regions.field
    own = field.inside & (regions.label == number)
    rows, columns = nearest_nodes(own)
    nearest = field.fractions[rows, columns]

    def fractions_at(points_mm: FloatArray) -> FloatArray:
        node = np.round((points_mm - np.array(field.grid.origin_mm)) / field.grid.pitch_mm)
        limits = [field.grid.shape[1] - 1, field.grid.shape[0] - 1]
        i, j = np.clip(node.astype(np.intp), 0, limits).T
        at_node = nearest[j, i]
        found = field.fractions_at(points_mm)
        beyond = np.abs(found - at_node).max(axis=1) > JUMP_FRACTION
        beyond |= regions.label[j, i] != number
        return np.where(beyond[:, None], at_node, found)

    return fractions_at


def _jumps(field: MixtureMap, axis: int) -> tuple[BoolArray, FloatArray]:
    """Between each node and the next along an axis: whether the material jumps, and where."""
    ny, nx = field.grid.shape
    jumps, where = np.zeros((ny, nx), np.bool_), np.full((ny, nx), 0.5)
    first = (slice(0, ny - (axis == 0)), slice(0, nx - (axis == 1)))
    second = (slice(int(axis == 0), ny), slice(int(axis == 1), nx))
    change = np.abs(field.fractions[first] - field.fractions[second]).max(axis=2)
    j, i = np.nonzero((change > JUMP_FRACTION) & field.inside[first] & field.inside[second])
    if len(j) == 0:
        return jumps, where
    begin = np.column_stack([field.grid.x_mm[i], field.grid.y_mm[j]])
    step = np.array([field.grid.pitch_mm, 0.0] if axis == 1 else [0.0, field.grid.pitch_mm])
    low, high = np.zeros(len(j)), np.ones(len(j))
    at_low = field.fractions[j, i]
    at_high = field.fractions[j + (axis == 0), i + (axis == 1)]
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        found = field.fractions_at(begin + middle[:, None] * step)
        beyond = np.abs(found - at_low).max(axis=1) < np.abs(at_high - found).max(axis=1)
        low, high = np.where(beyond, middle, low), np.where(beyond, high, middle)
        at_low = np.where(beyond[:, None], found, at_low)
        at_high = np.where(beyond[:, None], at_high, found)
    jumps[j, i] = np.abs(at_high - at_low).max(axis=1) > JUMP_FRACTION
    where[j, i] = (low + high) / 2
    return jumps, where


def _connected(inside: BoolArray, jump_x: BoolArray, jump_y: BoolArray) -> IntArray:
    """Number of the connected region of each node, −1 outside; no connection crosses a jump."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    node = np.arange(inside.size).reshape(inside.shape)
    x = inside[:, :-1] & inside[:, 1:] & ~jump_x[:, :-1]
    y = inside[:-1] & inside[1:] & ~jump_y[:-1]
    a = np.concatenate([node[:, :-1][x], node[:-1][y]])
    b = np.concatenate([node[:, 1:][x], node[1:][y]])
    graph = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(inside.size, inside.size))
    _, label = connected_components(graph, directed=False)
    return np.where(inside, label.reshape(inside.shape), -1).astype(np.int64)
