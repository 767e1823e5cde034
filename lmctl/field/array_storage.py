"""Where a field's arrays are kept: small ones in memory, large ones in a file mapped into it.

A field holds eight bytes at every node while its part is in use. The operating system can write
mapped arrays out and read them back when memory gets short; unmapped arrays stay in memory. The
file is unnamed from the start, so nothing is left behind, however the program ends.
"""

from __future__ import annotations

import mmap
import os
import shutil
import tempfile
from math import prod
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from lmctl.errors import InputError

#: Arrays of more bytes than this are mapped: a field of about 400 nodes along each axis.
MAX_BYTES_IN_MEMORY = 256_000_000


def allocate_array(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Allocate an uninitialised array for a field's kept values; use it like any other array.

    raises : InputError where the folder for temporary files has no room for it
    """
    size = prod(shape) * np.dtype(dtype).itemsize
    if not is_stored_on_disk(size):
        return np.empty(shape, dtype=dtype)
    return np.ndarray(shape, dtype=dtype, buffer=_mapped(size))


def is_stored_on_disk(size: float) -> bool:
    """Whether a kept array of so many bytes takes disk instead of memory."""
    return size > MAX_BYTES_IN_MEMORY


def mapped_storage_space() -> tuple[str, float]:
    """The folder mapped files go to, and the bytes free there; "" and 0 where there is none."""
    try:
        folder = tempfile.gettempdir()
        return folder, float(shutil.disk_usage(folder).free)
    except OSError:
        return "", 0.0


def storage_full_message(size: float, why: str = "") -> InputError:
    """The error for a folder for temporary files that has no room for so many bytes."""
    folder, free = mapped_storage_space()
    gigabytes = f"{size / 1e9:.3g} GB"
    if not folder:
        return InputError(
            f"there is no folder for {gigabytes} of temporary files", where=why,
            hint="set TMPDIR to a folder on a disk with that much free",
        )
    return InputError(
        f"{folder} has no room for {gigabytes} of a part's fields",
        where=[f"free there: {free / 1e9:.3g} GB", *([why] if why else [])],
        hint=f"free {gigabytes} in {folder}, or set TMPDIR to a folder on a disk with that much, "
        "or give a larger pitch_mm",
    )


def _mapped(size: int) -> mmap.mmap:
    """Map a file with all its disk space reserved, so that no later write runs out of space."""
    try:
        with tempfile.TemporaryFile(prefix="lmctl-field-") as file:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, size)
            else:
                os.ftruncate(file.fileno(), size)
            return mmap.mmap(file.fileno(), size)
    except OSError as why:
        raise storage_full_message(size, why.strerror or str(why)) from None
