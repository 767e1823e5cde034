"""Refine the field of a cloud until its estimated surface error is within the tolerance.

The error is estimated from the samples: how far the surface lies from the middle of each sample's
neighbours, along its slope. Noise evens out in that middle; what does not is the surface's error,
and what the noise of so few neighbours leaves is added to it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.field.field import DistanceField, sample_distance
from lmctl.part.resolution import (
    MEMORY_LIMIT_VARIABLE,
    checked_grid,
    finest_pitch_for_nodes,
    max_stored_nodes,
)

#: Samples whose residuals are averaged, and the most places at which that is done.
_NEIGHBOURS = 12
_MOST_PLACES = 20_000
#: The part of the places at which the error is no more than the estimate.
_QUANTILE = 0.95
#: Each pitch tried is so much finer; a finer one has to lower the error by this part to go on.
_FINER, _LEAST_GAIN = 0.5, 0.1
_MOST_TRIES = 5


@dataclass(frozen=True)
class CloudSurface:
    """error_mm : estimated, at 95 % of the surface"""

    stored: DistanceField
    error_mm: float


def surface_error_mm(stored: DistanceField, points_mm: FloatArray) -> float:
    """How far the surface of a field is from the samples (n, 3) it was made of, estimated [mm]."""
    from scipy.spatial import cKDTree

    residual = sample_distance(stored, points_mm)
    stride = max(1, len(points_mm) // _MOST_PLACES)
    count = min(_NEIGHBOURS, len(points_mm))
    _, near = cKDTree(points_mm).query(points_mm[::stride], k=count)
    around = residual[near.reshape(-1, count)]
    noise = around.std(axis=1) / np.sqrt(count)
    return float(np.quantile(np.abs(around.mean(axis=1)) + noise, _QUANTILE))


def cloud_within_tolerance(
    points_mm: FloatArray, normals: FloatArray | None, pitch_mm: float, tolerance_mm: float, *,
    is_fixed: bool,
) -> CloudSurface:
    """The field of a cloud (n, 3) whose surface is within the tolerance.

    pitch_mm : tried first, and alone where it `is_fixed`
    Raises InputError: what memory or samples cannot give, with the tolerance that they can; what
    `cloud_field` finds wrong with the cloud at the first pitch.
    """
    from lmctl.field.cloud.cloud_field import cloud_field

    low, high = points_mm.min(axis=0), points_mm.max(axis=0)
    finest = finest_pitch_for_nodes(low, high, max_stored_nodes())
    best: CloudSurface | None = None
    limit = "pitch_mm is given" if is_fixed else "its samples"
    for _ in range(1 if is_fixed else _MOST_TRIES):
        try:
            stored = cloud_field(
                points_mm, checked_grid(low, high, pitch_mm, stored=True), normals)
        except InputError:
            if best is None:
                raise
            break
        found = CloudSurface(stored, surface_error_mm(stored, points_mm))
        if found.error_mm <= tolerance_mm:
            return found
        is_better = best is None or found.error_mm < (1 - _LEAST_GAIN) * best.error_mm
        best = found if best is None or found.error_mm < best.error_mm else best
        if not is_better:
            break
        if pitch_mm <= finest:
            limit = f"the memory allowed ({MEMORY_LIMIT_VARIABLE})"
            break
        pitch_mm = max(_FINER * pitch_mm, finest)
    assert best is not None
    raise InputError(
        f"the surface of the cloud cannot be had within tolerance_mm = {tolerance_mm:g}",
        where=f"the least error, estimated from {len(points_mm):,} samples, is "
              f"{best.error_mm:.3g} mm, at a pitch of {best.stored.grid.pitch_mm:.3g} mm; what "
              f"limits it: {limit}",
        hint=f"give a tolerance_mm of at least {best.error_mm * 1.05:.2g}, or better samples")
