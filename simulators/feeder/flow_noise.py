"""Unsteadiness of a powder flow: noise correlated over a time, repeatable from a seed.

A normal process with correlation exp(−|Δt|/T), drawn on a grid of T/16 and linear between its
nodes. A node's value depends on seed and number only, not on which times are asked for, or when.
"""

from __future__ import annotations

import math

import numpy as np

from simulators.array_types import FloatArray

#: Nodes in a correlation time, and nodes drawn at once.
_NODES_PER_TIME = 16
_NODES_AT_ONCE = 4096


class CorrelatedNoise:
    """Mean 0, standard deviation 1, correlation time time_s > 0 [s].

    seed : whole numbers that the draw depends on
    """

    def __init__(self, time_s: float, *seed: int) -> None:
        self._step_s = time_s / _NODES_PER_TIME
        self._random = np.random.default_rng(seed)
        self._nodes = self._random.standard_normal(1)

    def values(self, since_s: FloatArray) -> FloatArray:
        """The noise at times since its start, any shape; before the start that of the start."""
        place = np.maximum(since_s, 0.0) / self._step_s
        self._draw_until(int(place.max(initial=0.0)) + 1)
        return np.asarray(np.interp(place, np.arange(len(self._nodes)), self._nodes))

    def _draw_until(self, node: int) -> None:
        """Have all nodes up to this one: each keeps a share of the one before."""
        if node < len(self._nodes):
            return
        from scipy.signal import lfilter

        keep = math.exp(-1.0 / _NODES_PER_TIME)
        drawn = [self._nodes]
        last, n = self._nodes[-1], len(self._nodes)
        while n <= node:
            fresh = math.sqrt(1.0 - keep**2) * self._random.standard_normal(_NODES_AT_ONCE)
            block, _ = lfilter([1.0], [1.0, -keep], fresh, zi=[keep * last])
            drawn.append(block)
            last, n = block[-1], n + len(block)
        self._nodes = np.concatenate(drawn)
