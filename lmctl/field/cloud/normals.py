"""Check the normals of a point file: whether they are usable, and which way they point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray

# cosine of the angle between a normal and its patch's; less does not decide a side
MIN_FIT_COSINE = 0.5
MIN_FITTING_FRACTION = 0.7  # share of the samples
#: By so many levels the way out is wider than through any gap where the outside is known.
KNOWN_SIDE_LEVELS = 2
MIN_KNOWN_SIDE_FRACTION = 0.05  # share of the samples
# share, of those where the outside is known, that have to point there; air comes
MIN_AGREEING_FRACTION = 0.75
# in through the gaps of a thin wall, too, so that not all will


class UnusableNormalsError(Exception):
    """The file's normals are not usable; the message gives the reason."""


def outward_signs(
    normals: FloatArray, patch_normals: FloatArray, sides: NDArray[np.uint8], gap: int
) -> tuple[NDArray[np.int8], tuple[str, ...]]:
    """Check the normals and return on which side of each patch the outside is.

    A file's normals may all point inwards. Fitted normals that were never oriented point either
    way. The check uses the air that enters from the box's faces: at nearly all samples where one
    side is wider open than any gap in the surface, the normals must point to that side.
    (Right at the surface all nodes are near a sample. There both sides are as narrow as a gap, and
    which one is wider is chance.)

    normals : (n, 3) float64 of length 1 or 0; patch_normals : (n, 3)
    sides : (n, 2) uint8, how open it is where the patch's normal points, and where it does not
    gap : how open the inside is at most, where it is reached through gaps between samples
    returns : (n,) int8, 1 where the patch's normal points outwards, −1 inwards, 0 not known;
        remarks
    raises : NormalsUnfitError
    """
    along = np.einsum("nc,nc->n", normals, patch_normals)
    fitting = np.abs(along) > MIN_FIT_COSINE
    if fitting.mean() < MIN_FITTING_FRACTION:
        raise UnusableNormalsError(
            f"the normals of the cloud fit its surface at {100.0 * fitting.mean():.0f} % of its "
            "points only: they were not used"
        )
    facing = np.where(fitting, np.sign(along), 0.0).astype(np.int8)
    opener = sides[:, 0].astype(np.int16) - sides[:, 1]
    is_known = fitting & (sides.max(axis=1) >= gap + KNOWN_SIDE_LEVELS) & (opener != 0)
    if is_known.mean() < MIN_KNOWN_SIDE_FRACTION:
        raise UnusableNormalsError(
            "the normals of the cloud could not be checked: they were not used")
    right = facing * opener > 0
    share = float(right[is_known].mean())
    remarks: tuple[str, ...] = ()
    if share < 1.0 - MIN_AGREEING_FRACTION:
        facing, right = -facing, ~right
        remarks = ("the normals of the cloud point inwards: they were turned round",)
    elif share < MIN_AGREEING_FRACTION:
        raise UnusableNormalsError(
            f"the normals of the cloud point outwards at {100.0 * share:.0f} % of its points "
            "only: they were not used"
        )
    facing[is_known & ~right] = 0  # the neighbours' vote is better there
    return facing, remarks


def oriented_normals(
    normals: FloatArray, patch_normals: FloatArray, facing: NDArray[np.int8]
) -> FloatArray:
    """The file's normals where they are usable, turned outwards; 0 elsewhere.

    facing : (n,) int8, on which side of each patch the outside is; returns : (n, 3) float64
    """
    flip = facing * np.sign(np.einsum("nc,nc->n", normals, patch_normals))
    turned: FloatArray = normals * flip[:, None]
    return turned
