"""The temperature of a part and its plate while the part is deposited, layer by layer."""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.part.materials.build_heat import PlateHeat
from lmctl.plan.heat.cell_body import LEAST_J_K, CellBody, connect_body, empty_body
from lmctl.plan.heat.heat_grid import FINE_SLABS, SLABS_PER_COARSE, HeatGrid
from lmctl.plan.heat.heat_stages import stages_of
from lmctl.plan.heat.heat_steps import BeadLines, advance_cells

#: Steps of time, short enough for a beam that comes back soon [s].
STEP_S = 0.15
#: Plain steps are this part of the longest that keeps every cell between its neighbours; and steps,
#: of the time in which deep cells follow what lies on them, which stays what it was in a step.
_STEP_SHARE, _FOLLOW_SHARE = 0.9, 0.5
#: Room for deep slabs is made so many at a time.
_ROOM = 16


class PartTemperature:
    """The part so far: `begin_layer`, `advance`; `copy` to try one course and then another."""

    def __init__(
        self, grid: HeatGrid, plate: PlateHeat, layer_mm: float,
        greatest_diffusivity_mm2_s: float,
    ) -> None:
        """greatest_diffusivity_mm2_s : of any material of the part"""
        self.time_s = 0.0
        self._grid, self._plate, self._layer_mm = grid, plate, layer_mm
        self._greatest = greatest_diffusivity_mm2_s
        self._layers = 0  # in the top slab, complete or begun
        self._plate_slabs = 0  # of the plate, among the fine ones
        self._fine = empty_body(FINE_SLABS + 1, grid.dx_mm, grid.dy_mm)
        self._deep = empty_body(_ROOM, grid.coarse_dx_mm, grid.coarse_dy_mm)
        self._cover_before = self._fine.cover[0].copy()
        self._volume_before = self._fine.volume_mm3[0].copy()
        self._box = np.array([*grid.part_y, *grid.part_x])
        self._steps = (STEP_S, 1, 1)  # its length [s], and the stages of fine and of deep cells
        self._lay_plate()
        self._workspace = [np.zeros_like(body.rise_K) for body in (self._fine, self._deep)]

    def copy(self) -> PartTemperature:
        """The same part, to go on by itself."""
        other = object.__new__(PartTemperature)
        other.__dict__.update(self.__dict__)
        other._fine, other._deep = self._fine.copy(), self._deep.copy()
        return other

    def become(self, other: PartTemperature) -> None:
        """Take over what another copy of the same part has come to."""
        self.__dict__.update(other.__dict__)

    def begin_layer(self) -> None:
        """From here on beads belong to the next layer."""
        fine = self._fine
        if 0 < self._layers < self._grid.layers_per_slab:
            self._layers += 1
            self._volume_before = fine.volume_mm3[fine.n].copy()
            self._cover_before = fine.cover[fine.n].copy()
            return
        if self._layers:  # the top slab is complete: what it covers is the mean of its layers
            area = np.outer(fine.dy_mm, fine.dx_mm)
            thick = self._layers * self._layer_mm
            fine.cover[fine.n] = np.clip(fine.volume_mm3[fine.n] / (area * thick), 0, 1)
        if fine.n == FINE_SLABS:
            self._retire_lowest()
        fine.n += 1
        self._layers = 1
        self._volume_before = np.zeros_like(self._volume_before)
        self._cover_before = np.zeros_like(self._cover_before)
        connect_body(fine, self._plate.loss_W_mm2_K)
        self._join()

    def advance(
        self, until_s: float, lines: BeadLines, read_s: FloatArray, read_mm: FloatArray
    ) -> FloatArray:
        """Go on to a later time; temperatures at places (r, 2) at times (r,), rising.

        Times before now count as now. NaN where a time is not reached, or there is no content.
        """
        found = np.full(len(read_s), np.nan)
        if until_s <= self.time_s:
            return found
        fine, deep, grid, plate = self._fine, self._deep, self._grid, self._plate
        places, times, amounts = lines.arrays()
        step_s, stages, deep_stages = self._steps
        advance_cells(
            fine.arrays(), self._workspace[0], deep.arrays(), self._workspace[1], fine.dx_mm,
            fine.dy_mm, fine.n, deep.n, self._plate_slabs + 1, self._box, self._cover_before,
            self._volume_before, grid.coarse_x, grid.coarse_y, grid.origin_mm, grid.cell_mm,
            self._layer_mm, plate.loss_W_mm2_K, plate.ambient_C - plate.at_C, self.time_s, until_s,
            step_s, stages, deep_stages, places, times, amounts,
            np.maximum(read_s, self.time_s), np.ascontiguousarray(read_mm, np.float64), found)
        self.time_s = until_s
        return found + plate.at_C

    def heat_content_J(self) -> float:
        """Heat in part and plate above the surroundings' temperature."""
        ambient_K = self._plate.ambient_C - self._plate.at_C
        return float(sum(
            (body.capacity_J_K[1:body.n + 1].astype(np.float64)
             * (body.rise_K[1:body.n + 1].astype(np.float64) - ambient_K)).sum()
            for body in (self._fine, self._deep)))

    def _lay_plate(self) -> None:
        """Slabs of the plate: fine ones, each as thick as one of the part, on a coarse one."""
        plate, fine, deep = self._plate, self._fine, self._deep
        thick = self._grid.layers_per_slab * self._layer_mm
        count = min(FINE_SLABS - 1, int(plate.thickness_mm / thick) - 1)
        count -= count % SLABS_PER_COARSE  # so that all of it can lie in deep slabs
        if count < 1:
            count, thick = 1, plate.thickness_mm / 2
        self._plate_slabs = fine.n = count
        heights = _growing(plate.thickness_mm - count * thick, SLABS_PER_COARSE * thick)[::-1]
        deep.n = len(heights)
        slabs = [(deep, k + 1, height) for k, height in enumerate(heights)]
        slabs += [(fine, k + 1, thick) for k in range(count)]
        for body, slab, height in slabs:
            inner = (slab, slice(1, -1), slice(1, -1))
            body.volume_mm3[inner] = height * np.outer(body.dy_mm, body.dx_mm)[1:-1, 1:-1]
            body.cover[inner] = 1.0
        # beyond the fine columns the plate is whole
        far = np.ones(deep.volume_mm3.shape[1:], np.bool_)
        grid = self._grid
        far[np.ix_(np.unique(grid.coarse_y[1:-1]), np.unique(grid.coarse_x[1:-1]))] = False
        deep.volume_mm3[deep.n, far] *= 1 + count * thick / heights[-1]
        for body in (fine, deep):
            body.capacity_J_K[:] = body.volume_mm3 * plate.capacity_J_mm3_K
            body.conductivity_mm3[:] = body.volume_mm3 * plate.conductivity_W_mm_K
        connect_body(fine, plate.loss_W_mm2_K)
        self._join()

    def _retire_lowest(self) -> None:
        """Make one deep slab of the lowest fine ones, and move the others down."""
        fine, grid = self._fine, self._grid
        count = SLABS_PER_COARSE if self._plate_slabs != 1 else 1  # of the plate, or of the part
        if self._deep.n + 2 == len(self._deep.volume_mm3):
            self._deep = _with_room(self._deep)
            self._workspace = [self._workspace[0], np.zeros_like(self._deep.rise_K)]
        deep = self._deep
        deep.n += 1
        top, lowest = deep.n, slice(1, count + 1)
        where = np.ix_(grid.coarse_y, grid.coarse_x)

        def gather(values: FloatArray) -> FloatArray:
            total = np.zeros(deep.volume_mm3.shape[1:])
            np.add.at(total, where, values.sum(axis=0, dtype=np.float64))
            return total

        held = gather(fine.capacity_J_K[lowest])
        heat = gather(fine.capacity_J_K[lowest] * fine.rise_K[lowest])
        deep.rise_K[top] = heat / np.maximum(held, LEAST_J_K)
        deep.capacity_J_K[top] = held
        deep.volume_mm3[top] = gather(fine.volume_mm3[lowest])
        deep.conductivity_mm3[top] = gather(fine.conductivity_mm3[lowest])
        area = np.outer(fine.dy_mm, fine.dx_mm)
        deep.cover[top] = gather(fine.cover[lowest] * area) / (
            count * np.outer(deep.dy_mm, deep.dx_mm))
        for values in fine.arrays():
            values[1:-count] = values[count + 1:]
            values[-count:] = values[-1]
        fine.n -= count
        self._plate_slabs = max(0, self._plate_slabs - count)

    def _join(self) -> None:
        """Conductances of the deep cells, to the table below and to the fine cells above."""
        fine, deep, plate, grid = self._fine, self._deep, self._plate, self._grid
        connect_body(deep, plate.loss_W_mm2_K)
        area, deep_area = np.outer(fine.dy_mm, fine.dx_mm), np.outer(deep.dy_mm, deep.dx_mm)
        own, below = _resistance(fine, 1, area), _resistance(deep, deep.n, deep_area)
        where = np.ix_(grid.coarse_y, grid.coarse_x)
        covered = area * fine.cover[1]
        under = np.zeros(deep_area.shape)
        np.add.at(under, where, covered)
        # heat of a narrow part spreads over all of a deep cell, and goes only where there is one
        bears = deep_area * deep.cover[deep.n]
        below = below * np.minimum(under / np.maximum(bears, 1e-6), 1.0)
        covered = covered * np.minimum(bears / np.maximum(under, 1e-6), 1.0)[where]
        fine.up_W_K[0] = np.where(
            fine.volume_mm3[1] > 0, covered / np.maximum(own + below[where], 1e-30), 0.0)
        fine.rise_K[0] = deep.rise_K[deep.n][where]
        deep.loss_W_K[deep.n] = np.maximum(
            deep.loss_W_K[deep.n] - plate.loss_W_mm2_K * np.minimum(under, bears), 0.0)
        deep.rise_K[0] = 0.0
        deep.up_W_K[0] = 0.0
        if plate.contact_W_mm2_K > 0:
            deep.up_W_K[0] = deep_area * deep.cover[1] / (
                1 / plate.contact_W_mm2_K + _resistance(deep, 1, deep_area))
        to_fine = np.zeros(deep_area.shape)
        np.add.at(to_fine, where, fine.up_W_K[0])
        deep_stable_s, follow_s = self._deep_steps_s(to_fine)
        step_s = min(STEP_S, _FOLLOW_SHARE * follow_s)
        self._steps = (step_s, stages_of(step_s, self._stable_s()),
                       stages_of(step_s, deep_stable_s))

    def _stable_s(self) -> float:
        """Longest plain step of the fine cells: Σ G dt ≤ C, also where a layer is just begun."""
        cell, layer = self._grid.cell_mm, self._layer_mm
        slab = self._grid.layers_per_slab * layer
        upright = max(2 / slab**2, 2 / (layer * (layer + slab)))
        most = self._greatest * (4 / cell**2 + upright)
        if self._plate_slabs:
            most = max(most, self._plate.diffusivity_mm2_s * (4 / cell**2 + 2 / slab**2))
        return _STEP_SHARE / most

    def _deep_steps_s(self, under_W_K: FloatArray) -> tuple[float, float]:
        """Longest plain step of the deep cells, and time in which the top ones follow what they
        bear, whose conductances to them add up to `under_W_K`."""
        deep = self._deep
        inner = (slice(1, deep.n + 1), slice(1, -1), slice(1, -1))
        total = (deep.east_W_K[inner] + deep.east_W_K[1:deep.n + 1, 1:-1, :-2]
                 + deep.north_W_K[inner] + deep.north_W_K[1:deep.n + 1, :-2, 1:-1]
                 + deep.up_W_K[inner] + deep.up_W_K[:deep.n, 1:-1, 1:-1] + deep.loss_W_K[inner])
        rate = total * deep.inverse_K_J[inner]
        follow = under_W_K * deep.inverse_K_J[deep.n]
        return _STEP_SHARE / float(rate.max()), 1 / float(follow.max())


def _growing(total_mm: float, first_mm: float) -> list[float]:
    """Heights that sum up to a total, each twice the one before, the first up to `first_mm`."""
    heights = [first_mm]
    while sum(heights) < total_mm:
        heights.append(2 * heights[-1])
    return [height * total_mm / sum(heights) for height in heights]


def _resistance(body: CellBody, slab: int, area_mm2: FloatArray) -> FloatArray:
    """Of half a slab, over a unit of area [mm² K/W]."""
    least = 1e-30  # slivers conduct in proportion, too: no floor but against division by nothing
    volume = body.volume_mm3[slab].astype(np.float64)
    thick = volume / np.maximum(area_mm2 * body.cover[slab], least)
    return np.asarray(0.5 * thick * volume / np.maximum(body.conductivity_mm3[slab], least))


def _with_room(body: CellBody) -> CellBody:
    """The same body with room for more slabs."""
    more = empty_body(len(body.volume_mm3) - 2 + _ROOM, body.dx_mm, body.dy_mm)
    for old, new in zip(body.arrays(), more.arrays(), strict=True):
        new[:len(old)] = old
    more.n = body.n
    return more
