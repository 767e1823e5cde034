"""Colours of mixtures: one perceptually even scale for two materials, mixed anchors for more.

The anchors stay apart for the colour-blind and in grey: every pair differs in lightness, and no two
fall together under protanopia, deuteranopia or tritanopia (held by a test). Mixtures of up to four
mix them, so that each mixture has a colour of its own. With more materials the colour is that of
the largest share, paler the smaller it is.
"""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from lmctl.array_types import FloatArray

#: Two materials read best on one perceptually even scale.
TWO_MATERIAL_COLOURMAP = "viridis"
#: From dark to light; four are far enough from one plane of colour to distinguish mixtures.
ANCHOR_COLOURS = ("#20205a", "#c8321e", "#2fa8d8", "#f5e642", "#7a4fa0", "#8fd19e")
#: Light enough for what is drawn over it.
_ONE_MATERIAL = "#8fa9c4"
#: Most materials whose mixtures have colours of their own.
MAX_MIXED_MATERIALS = 4


def composition_colours(fractions: NDArray[np.floating]) -> FloatArray:
    """Colours of volume fractions, (n, n_materials) -> (n, 3) float64 in [0, 1]."""
    values = np.asarray(fractions, dtype=np.float64)
    count = values.shape[1]
    if count == 1:
        return np.tile(to_rgb(_ONE_MATERIAL), (len(values), 1))
    if count == 2:
        shades: FloatArray = colormaps[TWO_MATERIAL_COLOURMAP](values[:, 1])
        return np.asarray(shades[:, :3], dtype=np.float64)
    anchors = np.array([to_rgb(ANCHOR_COLOURS[i % len(ANCHOR_COLOURS)]) for i in range(count)])
    if count <= MAX_MIXED_MATERIALS:
        return np.asarray(np.clip(values @ anchors, 0.0, 1.0))
    largest = values.argmax(axis=1)
    share = values[np.arange(len(values)), largest][:, None]
    return np.asarray(np.clip(share * anchors[largest] + (1 - share), 0.0, 1.0))


def material_colours(count: int) -> FloatArray:
    """Colours of the pure materials, (count, 3)."""
    return composition_colours(np.eye(count))
