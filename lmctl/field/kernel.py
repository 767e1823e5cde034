"""How the kernels of this package are compiled: once, cached on disk, dividing as numpy does.

Python's way of dividing puts a branch that can raise behind every division; no kernel here
divides by what may be zero without looking.

Half the time it takes to compile a small function goes into the doors by which others call it:
no caller uses these from C, and only kernels call an `inner` function, not Python either.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compile a function that is called from Python."""
    return _compiled(function, no_cfunc_wrapper=True)


def inner_kernel(function: Function) -> Function:
    """Compile a function that only kernels call."""
    return _compiled(function, no_cfunc_wrapper=True, no_cpython_wrapper=True)


def _compiled(function: Function, **doors: Any) -> Function:
    compiled: Function = njit(cache=True, error_model="numpy", **doors)(function)
    return compiled
