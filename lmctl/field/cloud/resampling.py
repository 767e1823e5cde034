"""Samples even enough for patches: not in dense lines, and farther apart than their noise."""

from __future__ import annotations

import numpy as np

from lmctl.field.cloud.local_fits import FIT_NEIGHBOURS
from lmctl.field.cloud.patches import FittedPatches, fit_patches
from lmctl.field.cloud.samples import CloudSamples, average_in_cells

MAX_NOISE_SPACINGS = 0.2  # noise beyond this hides the surface between neighbours
# of the lesser to the greater spread of a neighbourhood, squared: 1 is even
LINE_LIKE_SPREAD_RATIO = 0.1
MAX_RESAMPLING_ROUNDS = 3
COARSEST_PITCHES = 2.0


def fit_resampled_patches(samples: CloudSamples, pitch_mm: float) -> tuple[CloudSamples,
                                                                           FittedPatches]:
    """Fit patches; where the samples are unsuitable, average them in growing cells first.

    A line scanner samples densely along its lines and sparsely across: all neighbours of a
    sample then lie on its own line and do not define the surface. Noise as large as the spacing
    does the same in all directions.
    """
    patches = fit_patches(samples)
    even, cell = samples, 0.0
    for _ in range(MAX_RESAMPLING_ROUNDS):
        wanted = 4.0 * patches.noise_mm
        if patches.noise_mm < MAX_NOISE_SPACINGS * even.typical_spacing_mm:
            wanted = 0.0
        if _line_like(even):
            wanted = max(wanted, 2.0 * cell, 2.0 * even.typical_spacing_mm)
        wanted = min(wanted, COARSEST_PITCHES * pitch_mm)
        if wanted <= 1.05 * cell:
            break
        cell = wanted
        even = average_in_cells(samples, cell)
        patches = fit_patches(even)
    return even, patches


def _line_like(samples: CloudSamples) -> bool:
    """Whether most neighbourhoods spread along one direction only."""
    rows = np.arange(0, len(samples.points_mm), max(1, len(samples.points_mm) // 2000))
    around = samples.points_mm[samples.alike[rows, :FIT_NEIGHBOURS]]
    around = around - around.mean(axis=1, keepdims=True)
    spread = np.linalg.eigvalsh(around.transpose(0, 2, 1) @ around)
    return bool(np.median(spread[:, 1] / spread[:, 2]) < LINE_LIKE_SPREAD_RATIO)
