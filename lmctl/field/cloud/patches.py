"""The surface around every sample of a cloud: a small fitted patch.

Where a quadric explains the neighbourhood, the patch is that quadric. Where none does, an edge
runs through it, and the patch is the plane that most of the neighbours share with the sample:
a least-squares fit across an edge would round it off by the size of the neighbourhood.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.cloud.local_fits import FIT_NEIGHBOURS, fit_quadrics, fit_shared_planes
from lmctl.field.cloud.samples import CloudSamples

MIN_SHARING = 6  # of 17 samples on a plane: fewer happen by chance where edges crowd


@dataclass(frozen=True)
class FittedPatches:
    """Fitted patches; patch i is {base + t + f(t) normal}, f(t) = bend of the tangential t.

    base_mm : (n, 3) float64, the sample moved onto its fit
    normal, tangent : (n, 3) float64, unit, perpendicular to each other; the side the normal
        points to means nothing yet
    curvature_coefficients : (n, 3) float64 [1/mm], f = b0 u² + b1 u v + b2 v², u along tangent, v
    along
        normal × tangent
    is_smooth : (n,) bool, a quadric explains the whole neighbourhood
    is_trusted : (n,) bool, enough of the neighbourhood lies on the patch to believe it
    noise_mm : root mean square of the samples' distance from smooth patches
    tolerance_mm : how far from its patch a sample of the same sheet may lie
    """

    base_mm: FloatArray
    normal: FloatArray
    tangent: FloatArray
    curvature_coefficients: FloatArray
    is_smooth: NDArray[np.bool_]
    is_trusted: NDArray[np.bool_]
    noise_mm: float
    tolerance_mm: float


def fit_patches(samples: CloudSamples) -> FittedPatches:
    """Fit every sample's patch to its 16 neighbours; deterministic."""
    points, neighbours = samples.points_mm, samples.alike
    n = len(points)
    base, normal, tangent = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    bend, residual = np.empty((n, 3)), np.empty(n)
    fit_quadrics(points, neighbours, base, normal, tangent, bend, residual)
    # Edges are the minority of the neighbourhoods, so a low quantile is the noise of the rest.
    noise = max(1.3 * float(np.quantile(residual, 0.3)), 0.01 * samples.typical_spacing_mm)
    smooth = (residual < 1.6 * noise) & (
        np.abs(bend).max(axis=1) * samples.spacing_mm < 0.25
    )
    tolerance = max(4.0 * noise, 0.05 * samples.typical_spacing_mm)
    sharing = np.full(n, FIT_NEIGHBOURS, dtype=np.int64)
    fit_shared_planes(
        points, neighbours, np.flatnonzero(~smooth), tolerance, base, normal, tangent, bend, sharing
    )
    trusted = sharing >= MIN_SHARING
    return FittedPatches(base, normal, tangent, bend, smooth, trusted, noise, tolerance)
