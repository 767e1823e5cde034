"""The space a simulation lives in: a solid, a plane section, or half a section of a turned part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.design.effective_properties import ModelKind

#: Strains of each kind, as numbers into xx, yy, zz, xy, yz, xz; shears are engineering strains.
STRAIN_ROWS: dict[ModelKind, tuple[int, ...]] = {
    "plane-stress": (0, 1, 3),
    "plane-strain": (0, 1, 3),
    "axisymmetric": (0, 1, 2, 5),  # yy is the hoop direction
    "solid": (0, 1, 2, 3, 4, 5),
}

#: Normal directions in which stress acts: plane stress has none across the plane.
STRESSED_AXES: dict[ModelKind, tuple[int, ...]] = {
    "plane-stress": (0, 1),
    "plane-strain": (0, 1, 2),
    "axisymmetric": (0, 1, 2),
    "solid": (0, 1, 2),
}


@dataclass(frozen=True)
class ModelSpace:
    """How coordinates of a simulation lie in the part.

    kind : "solid"; "plane-stress" and "plane-strain" are of x and y at z = section_mm;
        "axisymmetric" is of the distance r from the z axis, and z, in the plane y = 0
    thickness_mm : of a plane model, > 0: forces and masses are of this thickness
    """

    kind: ModelKind
    section_mm: float = 0.0
    thickness_mm: float = 1.0

    @property
    def dim(self) -> int:
        """2 or 3"""
        return 3 if self.kind == "solid" else 2

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Of the model's own coordinates, which are the directions of displacement too."""
        return {"solid": ("x", "y", "z"), "axisymmetric": ("r", "z")}.get(self.kind, ("x", "y"))

    @property
    def part_axes(self) -> tuple[int, ...]:
        """The part's axis (0 x, 1 y, 2 z) along each coordinate of the model."""
        return {"solid": (0, 1, 2), "axisymmetric": (0, 2)}.get(self.kind, (0, 1))

    def part_points(self, points: FloatArray) -> FloatArray:
        """Places in the part of points (n, dim) of the model, (n, 3) float64 [mm]."""
        placed = np.full((len(points), 3), self.section_mm if self.dim == 2 else 0.0)
        if self.kind == "axisymmetric":
            placed[:, 1] = 0.0
        placed[:, self.part_axes] = points
        return placed

    def section_distance(
        self, distance: Callable[[FloatArray], FloatArray]
    ) -> Callable[[FloatArray], FloatArray]:
        """A part's distance as one of the model's own coordinates."""
        return lambda points: distance(self.part_points(points))

    def measure(self, points: FloatArray) -> FloatArray:
        """What a unit of the model's area or volume counts: thickness, 2πr, or 1; (...) [mm].

        points : (..., dim)
        """
        if self.kind == "axisymmetric":
            return np.asarray(2.0 * np.pi * points[..., 0])
        if self.kind == "solid":
            return np.ones(points.shape[:-1])
        return np.full(points.shape[:-1], self.thickness_mm)

    def box(self, low_mm: FloatArray, high_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The box around the model, of the box (3,) around the part."""
        low, high = low_mm[list(self.part_axes)], high_mm[list(self.part_axes)]
        if self.kind == "axisymmetric":
            reach = np.abs([low_mm[:2], high_mm[:2]]).max()
            low, high = np.array([0.0, low[1]]), np.array([reach, high[1]])
        return low, high

    def rigid_motions(self, points: FloatArray) -> FloatArray:
        """Displacements without strain, (n, dim, motions): 3 in a plane, 1 turned, 6 of a solid."""
        n, dim = points.shape
        if self.kind == "axisymmetric":
            return np.tile(np.array([[0.0], [1.0]]), (n, 1, 1))
        moves = np.tile(np.eye(dim), (n, 1, 1))
        away = points - points.mean(axis=0)
        x, y = away[:, 0], away[:, 1]
        if dim == 2:
            return np.concatenate([moves, np.stack([-y, x], axis=1)[:, :, None]], axis=2)
        z, none = away[:, 2], np.zeros(n)
        turns = np.stack([np.stack([none, -z, y], axis=1), np.stack([z, none, -x], axis=1),
                          np.stack([-y, x, none], axis=1)], axis=2)
        return np.concatenate([moves, turns], axis=2)

    @property
    def motion_names(self) -> tuple[str, ...]:
        """Of the columns of `rigid_motions`."""
        if self.kind == "axisymmetric":
            return ("a shift along z",)
        if self.dim == 2:
            return ("a shift along x", "a shift along y", "a turn in the plane")
        return tuple([f"a shift along {a}" for a in "xyz"] + [f"a turn about {a}" for a in "xyz"])
