"""The mixture to feed so that what is deposited, with what it melts, is the part's.

    c_fed = (c_part − δ · c_melted) / (1 − δ)

(docs/explanation/powder-delivery.md, Dilution). Where this is no mixture, a share being below 0 or
above 1, the nearest one is fed, by least squares, and the bead deviates from the part by the rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray


def mixture_to_feed(
    designed: FloatArray, melted: FloatArray, share: FloatArray
) -> FloatArray:
    """Mixtures (n, materials) to feed, from (n, materials + 1) and δ (n,)."""
    wanted = (designed - share[:, None] * melted)[:, :-1] / (1.0 - share)[:, None]
    off = (wanted < 0).any(axis=1) | (np.abs(wanted.sum(axis=1) - 1.0) > 1e-9)
    wanted[off] = projected_to_mixtures(wanted[off])
    return np.asarray(wanted)


def projected_to_mixtures(wanted: FloatArray) -> FloatArray:
    """The mixtures nearest to (n, m) numbers of any sign, by least squares.

    All are lowered by one number, so that what stays above 0 adds up to 1 (W. Wang and M. A.
    Carreira-Perpiñán, 2013, arXiv:1309.1541).

    >>> projected_to_mixtures(np.array([[1.125, -0.125], [0.75, 0.5]])).tolist()
    [[1.0, 0.0], [0.625, 0.375]]
    """
    falling = -np.sort(-wanted, axis=1)
    excess = (np.cumsum(falling, axis=1) - 1.0) / np.arange(1, wanted.shape[1] + 1)
    kept: NDArray[np.intp] = (falling > excess).sum(axis=1)
    lower = np.take_along_axis(excess, kept[:, None] - 1, axis=1)
    return np.asarray(np.maximum(wanted - lower, 0.0))
