"""Find the outer side of every sample by advancing the outside from the box's faces.

After the tagging of Zhao, Osher & Fedkiw ("Fast surface reconstruction using the level set
method", VLSM 2001): the exterior advances over descending distance to the samples. Here every
node stores the *narrowest place* on its widest way out, in units of the local sample spacing.
The air outside has wide ways; the inside of a closed cloud is reached only through the gaps
between samples. So no threshold is needed to separate them, and the widest gap is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.field.cloud.neighbour_search import nearest_samples
from lmctl.field.cloud.normals import oriented_normals
from lmctl.field.cloud.orientation_consistency import propagate_orientation
from lmctl.field.cloud.patches import FittedPatches
from lmctl.field.cloud.samples import MAX_DROPPED_FRACTION, CloudSamples
from lmctl.field.cloud.thin_walls import outward_signs_of_thick_walls
from lmctl.field.grid import Grid
from lmctl.field.kernel import kernel
from lmctl.field.priority_flood import LEVEL_COUNT
from lmctl.field.sweep import propagate_closest_points

Sources = NDArray[np.int32]

LEVELS_PER_SPACING = 8
# levels: nearer to a sample than this, a node's own fit decides its side
OFF_SURFACE_LEVELS = 2
FACING_CANDIDATES = 8  # samples next to one that a place lies behind
FACING_MIN_COSINE = 0.5  # cosine of the angle to its normal within which a sample faces a place
# 10⁵ randomly placed samples leave empty circles of up to 2.2 spacings: anything wider is an
# opening.
MAX_GAP_SPACINGS = 3.0
MAX_GAP_LEVELS = MAX_GAP_SPACINGS * LEVELS_PER_SPACING
WELL_CLEAR_SPACINGS = 5.0  # places on the way out wider than this count as equally wide


@dataclass(frozen=True)
class SampleOrientation:
    """Which side of each sample is inside.

    inward_sign : (n,) int8, ±1: the patch's normal, times this, points inwards; 0: sample dropped
    side_tags : (nz, ny, nx) int8 on `deep_grid`, −1 at nodes the outside reaches by ways wider than
        any gap, +1 at nodes well away from all samples that it does not reach, 0 elsewhere; with
        normals also the nodes right above or below a sample, by the side its normal points to
    gap_mm : diameter of the widest gap the inside is reached through
    remarks : what was dropped
    """

    inward_sign: NDArray[np.int8]
    side_tags: NDArray[np.int8]
    side_tag_grid: Grid
    gap_mm: float
    remarks: tuple[str, ...]


def orient_samples(samples: CloudSamples, patches: FittedPatches,
                   pitch_mm: float) -> SampleOrientation:
    """Separate inside from outside at every sample.

    raises : InputError where the cloud is open: air reaches both sides of it, or its walls are
        too thin to be resolved by normals; NormalsUnfitError
    """
    typical = samples.typical_spacing_mm
    grid = _tagging_grid(samples, pitch_mm)
    sources = nearest_samples(
        samples.points_mm, np.full(len(samples.points_mm), 1.5 * grid.pitch_mm), grid
    )
    # A wall of samples is no thinner than the grid can show.
    spacing = np.maximum(samples.spacing_mm, 1.2 * grid.pitch_mm)
    distance = propagate_closest_points(
        sources, samples.points_mm, grid, WELL_CLEAR_SPACINGS * float(spacing.max())
    )
    clear = np.empty(grid.shape, dtype=np.uint8)
    _clear_kernel(distance, sources, LEVELS_PER_SPACING / spacing, clear)
    del distance
    widest_opening = np.zeros(grid.shape, dtype=np.uint8)
    for axis in range(3):
        for end in (0, -1):
            np.moveaxis(widest_opening, axis, 0)[end] = np.moveaxis(clear, axis, 0)[end]
    while _widen_kernel(clear.reshape(-1), widest_opening.reshape(-1), *grid.shape):
        pass
    relative = np.ascontiguousarray(
        (samples.points_mm - np.asarray(grid.origin_mm)) / grid.pitch_mm
    )
    sides = np.zeros((len(relative), 2), dtype=np.uint8)
    _sides_kernel(widest_opening, sources, relative, patches.normal, sides)
    narrow, wide = sides.min(axis=1), sides.max(axis=1)
    floating = narrow > MAX_GAP_LEVELS
    facing = np.zeros(len(sides), dtype=np.int8)
    remarks: list[str] = []
    if samples.normals is not None:
        gap = int(narrow[~floating].max(initial=0))
        facing, said = outward_signs_of_thick_walls(samples, samples.normals, patches, sides, gap)
        remarks += said
        within = np.where(facing > 0, sides[:, 1], sides[:, 0])
        narrow = np.where(facing == 0, narrow, within)
        floating = narrow > MAX_GAP_LEVELS
    _refuse_open(floating, narrow, typical)
    if floating.any():
        remarks.append(f"{int(floating.sum())} points with air all around were dropped as outliers")
    gap = int(narrow[~floating].max())
    # Air on the side the normal points to: the other side is inside.
    by_air = np.where(sides[:, 0] > sides[:, 1], -1, 1)
    sure = ~floating & ((facing != 0) | (wide > gap + 1))
    inward = np.where(sure, np.where(facing == 0, by_air, -facing), 0).astype(np.int8)
    propagate_orientation(inward, floating, samples, patches)
    lost = (inward == 0) & ~floating
    if lost.mean() > MAX_DROPPED_FRACTION:
        raise InputError(
            "inside and outside of the point cloud cannot be distinguished everywhere",
            where=f"at {int(lost.sum())} of {len(lost)} samples, "
            f"the first near {', '.join(f'{c:.1f}' for c in samples.points_mm[lost][0])}",
            hint="scan more evenly and from all around; leave out closed cavities, and walls "
            f"thinner than the samples are apart ({typical:.2g} mm)",
        )
    if lost.any():
        remarks.append(f"{int(lost.sum())} points whose side could not be found were dropped")
    known_side: NDArray[np.int8] | None = None
    if samples.normals is not None:
        known_side = np.zeros(grid.shape, dtype=np.int8)
        out = oriented_normals(samples.normals, patches.normal, facing)
        _by_normals_kernel(
            clear, sources, relative, patches.normal, out, facing, samples.neighbours, known_side)
        # The inside between two samples may be reached by a wider way than that right below one.
        gap = max(gap, int(widest_opening[known_side > 0].max(initial=0)))
    deep = np.where(widest_opening > gap, -1, np.where(clear > 1.5 * gap, 1, 0)).astype(np.int8)
    if known_side is not None:
        deep = np.where(known_side != 0, known_side, deep)
    return SampleOrientation(
        inward, deep, grid, 2.0 * gap / LEVELS_PER_SPACING * typical, tuple(remarks)
    )


def _tagging_grid(samples: CloudSamples, pitch_mm: float) -> Grid:
    """A grid just fine enough for the gaps between samples, with air all around."""
    points, typical = samples.points_mm, samples.typical_spacing_mm
    pitch = max(pitch_mm, 0.75 * typical)
    margin = int(np.ceil(4.0 * typical / pitch)) + 2
    return Grid.enclosing(points.min(axis=0), points.max(axis=0), pitch, margin)


def _refuse_open(
    floating: NDArray[np.bool_], narrow: NDArray[np.uint8], typical_mm: float
) -> None:
    if floating.mean() > MAX_DROPPED_FRACTION:
        width = 2.0 * typical_mm * float(np.median(narrow[floating])) / LEVELS_PER_SPACING
        raise InputError(
            "the point cloud is open: the outside reaches both sides of its surface",
            where=f"{len(narrow)} samples, typically {typical_mm:.2g} mm apart; "
            f"an opening at least {width:.2g} mm wide",
            hint="scan the missing side, or close the opening; gaps of up to "
            f"{2.0 * MAX_GAP_SPACINGS * typical_mm:.2g} mm are bridged",
        )


@kernel
def _clear_kernel(
    distance: NDArray[np.float32], sources: Sources, levels_per_mm: FloatArray,
    clear: NDArray[np.uint8],
) -> None:
    """How far every node is from its sample, in levels."""
    nz, ny, nx = sources.shape
    for k in range(nz):
        for j in range(ny):
            for i in range(nx):
                level = LEVEL_COUNT - 1.0
                if sources[k, j, i] >= 0:
                    level = min(level, distance[k, j, i] * levels_per_mm[sources[k, j, i]])
                clear[k, j, i] = np.uint8(level)


@kernel
def _widen_kernel(
    clear: NDArray[np.uint8], widest_opening: NDArray[np.uint8], nz: int, ny: int, nx: int
) -> bool:
    """Carry the way in from node to node, forwards and back in array order; whether it widened.

    widest_opening : how wide the narrowest place is on the widest way found so far; at most `clear`
    """
    plane, widened = ny * nx, False
    for direction in range(2):
        step = 1 - 2 * direction
        n = -1 if step > 0 else widest_opening.size
        for k in range(nz):
            for j in range(ny):
                for i in range(nx):
                    # On the backward pass i, j, k count from the end.
                    n += step
                    if widest_opening[n] == clear[n]:
                        continue
                    widest = widest_opening[n]
                    if i > 0:
                        widest = max(widest, widest_opening[n - step])
                    if j > 0:
                        widest = max(widest, widest_opening[n - step * nx])
                    if k > 0:
                        widest = max(widest, widest_opening[n - step * plane])
                    widest = min(widest, clear[n])
                    if widest > widest_opening[n]:
                        widest_opening[n] = widest
                        widened = True
    return widened


@kernel
def _by_normals_kernel(
    clear: NDArray[np.uint8], sources: Sources, points: FloatArray, normal: FloatArray,
    out: FloatArray, facing: NDArray[np.int8], near: NDArray[np.int32],
    known_side: NDArray[np.int8],
) -> None:
    """Write the side of nodes right above or below a sample to `known_side`.

    Uses the patch's normal and the sample's own: at a sharp edge the patch is fitted around the
    edge. Near a sharp edge a place in the air may lie behind one of the faces, so a place counts
    as inside only if no nearby sample faces it.
    """
    nz, ny, nx = clear.shape
    for k in range(nz):
        for j in range(ny):
            for i in range(nx):
                n = sources[k, j, i]
                if n < 0 or facing[n] == 0 or clear[k, j, i] < OFF_SURFACE_LEVELS:
                    continue
                x, y, z = i - points[n, 0], j - points[n, 1], k - points[n, 2]
                off2 = x * x + y * y + z * z
                along = x * normal[n, 0] + y * normal[n, 1] + z * normal[n, 2]
                along *= facing[n]
                beyond = x * out[n, 0] + y * out[n, 1] + z * out[n, 2]
                if along * along <= 0.64 * off2 or along * beyond <= 0.4 * off2:
                    continue
                known_side[k, j, i] = -1 if along > 0.0 else 1
                for m in range(FACING_CANDIDATES if along < 0.0 else 0):
                    r = near[n, m]
                    x, y, z = i - points[r, 0], j - points[r, 1], k - points[r, 2]
                    front = x * out[r, 0] + y * out[r, 1] + z * out[r, 2]
                    if front > FACING_MIN_COSINE * np.sqrt(x * x + y * y + z * z):
                        known_side[k, j, i] = 0
                        break


@kernel
def _sides_kernel(
    level: NDArray[np.uint8], sources: Sources, points: FloatArray, normal: FloatArray,
    sides: NDArray[np.uint8],
) -> None:
    """The best level among the nodes nearest to each sample, on each side of its patch."""
    nz, ny, nx = level.shape
    for k in range(nz):
        for j in range(ny):
            for i in range(nx):
                n = sources[k, j, i]
                if n < 0:
                    continue
                x, y, z = i - points[n, 0], j - points[n, 1], k - points[n, 2]
                along = x * normal[n, 0] + y * normal[n, 1] + z * normal[n, 2]
                if along * along > 0.64 * (x * x + y * y + z * z):
                    side = 0 if along > 0.0 else 1
                    sides[n, side] = max(sides[n, side], level[k, j, i])
