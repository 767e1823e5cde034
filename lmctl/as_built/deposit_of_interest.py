"""The part of a build that one design is compared with: over its substrate, around one copy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.as_built.built_volume import BuiltPath, BuiltVolume

if TYPE_CHECKING:
    from lmctl.part.part import Part


@dataclass(frozen=True)
class OfInterest:
    """A build and the part to compare it with, in coordinates that both know."""

    built: BuiltVolume
    part: Part


def over_substrate(built: BuiltVolume, part: Part, offset_mm: FloatArray) -> OfInterest:
    """Without what is below a substrate with a shape, of the build and of the part.

    Voxels whose middle is below the surface count as plate, and so does what was melted into them.
    Heights of surfaces along the path are counted from the substrate.
    offset_mm : (3,) machine coordinates of the part's origin
    """
    if part.substrate_surface is None:
        return OfInterest(built, part)
    from lmctl.part.substrate.above_surface import BodyAboveSurface  # late: few parts have one

    heights = part.substrate_surface.heights
    nx, ny, nz = built.deposited_mm3.shape[1:]
    x, y, z = (built.origin_mm[axis] - offset_mm[axis] + (np.arange(count) + 0.5)
               * built.voxel_mm[axis] for axis, count in enumerate((nx, ny, nz)))
    places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=2).reshape(-1, 2)
    surface = heights.height_mm(places).reshape(nx, ny, 1)
    deposited = np.where(z[None, None, :] > surface, built.deposited_mm3, np.float32(0))
    path = built.path
    under = heights.height_mm(path.place_mm[:, :2] - offset_mm[:2]) + offset_mm[2]
    met = path.surface_mm - (under - built.plate_z_mm)
    return OfInterest(
        replace(built, deposited_mm3=deposited, path=replace(path, surface_mm=met)),
        replace(part, body=BodyAboveSurface(part.body, heights)))


def around_part(built: BuiltVolume, part: Part, offset_mm: FloatArray) -> BuiltVolume:
    """The voxels and pieces of path in the part's box and two beads around it, without powder use.

    offset_mm : (3,) machine coordinates of the part's origin
    """
    low, high = (np.asarray(corner, dtype=np.float64)[:2] for corner in part.bounds_mm)
    margin = 2 * part.process.bead_width_mm
    low, high = low + offset_mm[:2] - margin, high + offset_mm[:2] + margin
    shape = np.array(built.deposited_mm3.shape[1:3])
    first, last = (
        np.clip(round_to((corner - built.origin_mm[:2]) / built.voxel_mm[:2]).astype(int), 0, shape)
        for round_to, corner in ((np.floor, low), (np.ceil, high)))
    path = built.path
    near = ((path.place_mm[:, :2] >= low) & (path.place_mm[:, :2] <= high)).all(axis=1)
    window = slice(int(first[0]), int(last[0])), slice(int(first[1]), int(last[1]))
    return replace(
        built, deposited_mm3=built.deposited_mm3[:, *window], height_mm=built.height_mm[window],
        origin_mm=np.array([*(built.origin_mm[:2] + first * built.voxel_mm[:2]),
                            built.origin_mm[2]]),
        path=BuiltPath(path.place_mm[near], path.beam_on_mm[near], path.delivered[near],
                       path.surface_mm[near], path.line[near]),
        powder=None)
