"""The work offset of a run, found from where its program lines were executed."""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.as_built.built_volume import BuiltVolume
from lmctl.job.reader import JobReader

#: Beads compared at least, where there are so many.
_ENOUGH_LINES = 500
#: A smaller offset is none: pieces stand for their middles only.
_NONE_MM = 0.05


def work_offset_mm(built: BuiltVolume, job: JobReader) -> FloatArray:
    """Machine coordinates less program coordinates, (3,); 0 where no line can be compared.

    The pieces of a straight bead have their mean, weighted by length, in its middle.
    """
    path = built.path
    lines, piece_of = np.unique(path.line, return_inverse=True)
    length = np.bincount(piece_of, path.beam_on_mm)
    mean = np.stack([
        np.bincount(piece_of, path.beam_on_mm * path.place_mm[:, axis]) / length
        for axis in range(3)], axis=1)
    found = np.zeros((0, 3))
    for layer in job.iterate_layers():
        ends = np.stack([layer.lines[axis] for axis in ("x_mm", "y_mm", "z_mm")], axis=1)
        numbers = layer.first_line + np.arange(1, len(ends))
        rows = np.flatnonzero(np.isin(numbers, lines))
        middles = (ends[rows] + ends[rows + 1]) / 2
        found = np.concatenate([found, mean[np.searchsorted(lines, numbers[rows])] - middles])
        if len(found) >= _ENOUGH_LINES:
            break
    if not len(found):
        return np.zeros(3)
    offset = np.median(found, axis=0)
    return np.asarray(np.where(np.abs(offset) < _NONE_MM, 0.0, offset))
