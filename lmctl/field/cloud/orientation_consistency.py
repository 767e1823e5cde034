"""Propagate orientation: neighbouring samples agree on which side is outside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.cloud.patches import FittedPatches
from lmctl.field.cloud.samples import CloudSamples
from lmctl.field.kernel import kernel


def propagate_orientation(
    inward: NDArray[np.int8], floating: NDArray[np.bool_], samples: CloudSamples,
    patches: FittedPatches
) -> None:
    """Carry orientation to the samples that have none, in place, the surest first.

    Two samples agree when their normals mirror each other in the plane halfway between them:
    on flat ground that is the same normal, across a sharp edge it still is the right one
    (König & Gumhold, "Consistent propagation of normal orientations in point clouds", 2009).
    """
    normal, points = patches.normal, samples.points_mm
    near = np.ascontiguousarray(samples.neighbours[:, :10])
    rows = np.flatnonzero((inward == 0) & ~floating)
    agreement = np.empty((len(rows), near.shape[1]))
    _agreement_kernel(points, normal, near, rows, agreement)
    needed = 2.0
    while len(rows) and needed > 1e-3:
        vote = np.einsum("nm,nm->n", agreement, inward[near[rows]])
        decided = np.abs(vote) >= needed
        if decided.any():
            inward[rows[decided]] = np.sign(vote[decided]).astype(np.int8)
            rows, agreement = rows[~decided], agreement[~decided]
        else:
            needed *= 0.5


def neighbour_votes(
    samples: CloudSamples, patches: FittedPatches, facing: NDArray[np.int8]
) -> FloatArray:
    """Vote of each sample's similar neighbours on the side its patch faces, (n,) float64."""
    near = samples.alike
    agreement = np.empty(near.shape)
    rows = np.arange(len(near))
    _agreement_kernel(samples.points_mm, patches.normal, near, rows, agreement)
    votes: FloatArray = np.einsum("nm,nm->n", agreement, facing[near].astype(np.float64))
    return votes


@kernel
def _agreement_kernel(
    points: FloatArray, normal: FloatArray, near: NDArray[np.int32], rows: NDArray[np.int64],
    agreement: FloatArray,
) -> None:
    for n in range(len(rows)):
        for m in range(near.shape[1]):
            one, two, same, apart = rows[n], near[rows[n], m], 0.0, 0.0
            own_slope, other_slope = 0.0, 0.0
            for c in range(3):
                offset = points[two, c] - points[one, c]
                same += normal[one, c] * normal[two, c]
                own_slope += normal[one, c] * offset
                other_slope += normal[two, c] * offset
                apart += offset * offset
            agreement[n, m] = same - 2.0 * own_slope * other_slope / apart
