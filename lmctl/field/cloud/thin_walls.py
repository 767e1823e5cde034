"""Refuse or report walls thinner than the sample spacing, which normals alone cannot resolve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.field.cloud.normals import (
    MIN_FIT_COSINE,
    UnusableNormalsError,
    oriented_normals,
    outward_signs,
)
from lmctl.field.cloud.orientation_consistency import neighbour_votes
from lmctl.field.cloud.patches import FittedPatches
from lmctl.field.cloud.samples import CloudSamples
from lmctl.field.kernel import kernel

# cosine of the angle between normals; more is an edge (of 37° and blunter), which
OPPOSITE_FACING_MAX_COSINE = -0.8
# is thin along a strip only, not another face
MIN_WALL_SPACINGS = 1.1  # thinner than this, patches of one face reach past the other
MAX_SIDEWAYS_SPACINGS = 1.5  # farther aside than this a sample does not face another
SAME_FACE_SPACINGS = 0.2  # by noise and bend samples of one face are this far off each other's
MAX_THIN_FRACTION = 0.05  # of thin samples; where two faces run out in a sharp edge some always are
# share of normals unlike those around them; with more, thinness cannot be judged
MAX_STRAY_NORMAL_FRACTION = 0.2


def outward_signs_of_thick_walls(
    samples: CloudSamples, normals: FloatArray, patches: FittedPatches, sides: NDArray[np.uint8],
    gap: int
) -> tuple[NDArray[np.int8], tuple[str, ...]]:
    """As `facing_out`, without strays, for a cloud whose walls are thicker than its spacing.

    normals, sides, gap, returns : as there
    raises : InputError where faces lie nearer to each other; NormalsUnfitError
    """
    why = None
    try:
        facing, said = outward_signs(normals, patches.normal, sides, gap)
    except UnusableNormalsError as error:
        why, said = error, ()
        along = np.einsum("nc,nc->n", normals, patches.normal)
        facing = np.where(np.abs(along) > MIN_FIT_COSINE, np.sign(along), 0.0).astype(np.int8)
    stray = neighbour_votes(samples, patches, facing) * facing < 0.0
    facing[stray] = 0
    if why is not None and np.mean(facing == 0) > MAX_STRAY_NORMAL_FRACTION:
        raise why
    said += _refuse_thin(
        samples, patches.normal * facing[:, None],
        oriented_normals(normals, patches.normal, facing),
        checked=why is None)
    if why is not None:  # and not because no air comes in between faces near each other
        raise why
    return facing, said


def _refuse_thin(
    samples: CloudSamples, fitted: FloatArray, given: FloatArray, *, checked: bool = True
) -> tuple[str, ...]:
    """Look for samples with another face right behind or right in front of them.

    fitted, given : (n, 3) float64 of length 1, outwards, of patches and of the file; 0 where not
        known. Patches at an edge are fitted around it, and a file's may be tilted any way: an
        opposite face is one by both
    checked : whether they are known to be right; else opposite ones on one face may just be wrong
    returns : a remark where some are, too few to refuse the cloud
    raises : InputError where walls, or gaps between walls, are thinner than the spacing
    """
    behind = _behind_kernel(
        samples.points_mm, fitted, given, samples.neighbours, samples.spacing_mm)
    thin = np.isfinite(behind)
    if not thin.any():
        return ()
    apart = float(np.median(samples.spacing_mm[thin]))
    mm = float(np.median(np.abs(behind[thin])))
    if not checked and mm < SAME_FACE_SPACINGS * apart:
        return ()
    walls = float(np.median(behind[thin])) >= 0.0
    what = f"walls {mm:.2g} mm thick" if walls else f"gaps {mm:.2g} mm wide"
    compared = f"{'thinner' if mm < apart else 'hardly thicker'} than the samples are apart"
    near = ", ".join(f"{c:.1f}" for c in samples.points_mm[thin][0])
    if thin.mean() > MAX_THIN_FRACTION:
        raise InputError(
            f"{what} are {compared} ({apart:.2g} mm): inside and outside of the cloud cannot be "
            "told apart",
            where=f"at {int(thin.sum())} of {len(thin)} samples, the first near {near}",
            hint=f"scan more densely, at most {mm / MIN_WALL_SPACINGS:.2g} mm apart, "
            "or give a mesh",
        )
    return (
        f"{what} at {int(thin.sum())} points of the cloud, the first near {near}, are "
        f"{compared} ({apart:.2g} mm): look at the sections there",
    )


@kernel
def _behind_kernel(
    points: FloatArray, fitted: FloatArray, given: FloatArray, near: NDArray[np.int32],
    spacing: FloatArray,
) -> FloatArray:
    """Distance behind each sample to the nearest opposite one; negative in front; inf for none."""
    behind = np.full(len(points), np.inf)
    for n in range(len(points)):
        x, y, z = fitted[n, 0], fitted[n, 1], fitted[n, 2]
        for m in range(near.shape[1]):
            r = near[n, m]
            if x * fitted[r, 0] + y * fitted[r, 1] + z * fitted[r, 2] >= OPPOSITE_FACING_MAX_COSINE:
                continue
            same = 0.0
            for c in range(3):
                same += given[n, c] * given[r, c]
            if same >= OPPOSITE_FACING_MAX_COSINE:
                continue
            dx, dy = points[r, 0] - points[n, 0], points[r, 1] - points[n, 1]
            dz = points[r, 2] - points[n, 2]
            along = -(dx * x + dy * y + dz * z)
            aside = dx * dx + dy * dy + dz * dz - along * along
            if (
                abs(along) < MIN_WALL_SPACINGS * spacing[n]
                and aside < (MAX_SIDEWAYS_SPACINGS * spacing[n]) ** 2
                and abs(along) < abs(behind[n])
            ):
                behind[n] = along
    return behind
