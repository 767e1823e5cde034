"""How the kernels of this package are compiled: once, cached on disk, dividing as numpy does.

Python's way of dividing puts a branch that can raise behind every division; no kernel here
divides by what may be zero without looking.
"""

from __future__ import annotations

from numba import njit

kernel = njit(cache=True, error_model="numpy")
