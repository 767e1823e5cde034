"""Columns of numbers as text that a page can hold: 16 or 32 bits each, compressed, in base 64."""

from __future__ import annotations

import zlib
from base64 import b64encode
from collections.abc import Mapping
from typing import Any

import numpy as np

from lmctl.array_types import FloatArray

#: Steps of a 16-bit column between its least and its greatest value.
_STEPS = 65_535


class ColumnPacker:
    """Gathers the columns of one layer; `packed` is one text with a list of what lies in it.

    Values that are not known are NaN; they become the step 65,535 of a column that has any.
    """

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._columns: list[dict[str, Any]] = []

    def add_scaled(self, name: str, values: FloatArray) -> None:
        """A column of 16-bit steps between its least and greatest value."""
        known = values[np.isfinite(values)]
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
        has_holes = len(known) < len(values)
        steps = _STEPS - has_holes
        step = (high - low) / steps if high > low else 1.0
        data = np.round((np.nan_to_num(values, nan=low) - low) / step)
        if has_holes:
            data = np.where(np.isfinite(values), data, _STEPS)
        self._add(name, data.astype("<u2"), {"low": low, "step": step, "holes": has_holes})

    def add_exact(self, name: str, values: FloatArray) -> None:
        """A column of 32-bit floats."""
        self._add(name, values.astype("<f4"), {})

    def add_small(self, name: str, values: FloatArray) -> None:
        """A column of whole numbers from 0 to 65,535."""
        self._add(name, values.astype("<u2"), {"low": 0, "step": 1, "holes": False})

    def packed(self) -> dict[str, Any]:
        """{"columns": what lies where, "data": the text}."""
        data = zlib.compress(b"".join(self._parts), 6)
        return {"columns": self._columns, "data": b64encode(data).decode("ascii")}

    def _add(self, name: str, data: np.ndarray, scale: Mapping[str, Any]) -> None:
        # Differences of neighbours compress to a third of what the values take.
        if data.dtype == np.dtype("<u2"):
            data = np.diff(data, prepend=np.zeros(1, dtype="<u2")).astype("<u2")
        at = sum(map(len, self._parts))
        padding = -at % 4
        self._parts += [b"\0" * padding, np.ascontiguousarray(data).tobytes()]
        self._columns.append({"name": name, "at": at + padding, "n": len(data),
                              "type": "f4" if data.dtype == np.dtype("<f4") else "u2",
                              **scale})
