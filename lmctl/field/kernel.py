"""How the kernels of this package are compiled: once, cached on disk, dividing as numpy does.

Python-style division adds a branch that can raise to every division; the kernels here check for
zero themselves.

Half the compile time of a small function goes into its entry points for callers. C never calls
these functions, and only kernels, not Python, call an `inner` function.

The compiler loads the whole of scipy.linalg to see whether there is a BLAS, for convolutions alone.
No kernel here has one, and that takes as long as planning a small part: here it sees none.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any, TypeVar

from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])

_BLAS = "scipy.linalg.cython_blas"
if _BLAS not in sys.modules:
    sys.modules[_BLAS] = None  # type: ignore[assignment]  # so Python says that it is not there
    try:
        import_module("numba.np.arraymath")  # which asks once, as it is loaded
    finally:
        del sys.modules[_BLAS]


def kernel(function: Function) -> Function:
    """Compile a function that is called from Python."""
    return _compiled(function, no_cfunc_wrapper=True)


def inner_kernel(function: Function) -> Function:
    """Compile a function that only kernels call."""
    return _compiled(function, no_cfunc_wrapper=True, no_cpython_wrapper=True)


def _compiled(function: Function, **doors: Any) -> Function:
    compiled: Function = njit(cache=True, error_model="numpy", **doors)(function)
    return compiled
