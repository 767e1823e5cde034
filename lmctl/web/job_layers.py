"""The layers of a run's job for the live page: tracks, and the mixture planned along them."""

from __future__ import annotations

from bisect import bisect_right
from collections import OrderedDict
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from lmctl.errors import LmctlError, UsageError
from lmctl.job.reader import JobReader
from lmctl.job.schema import JobLayer, LineKind
from lmctl.report.job_viewer.columns import ColumnPacker
from lmctl.report.part_report import JobOfPart, job_of_part
from lmctl.report.reported_values import PartScales

_LAYERS_KEPT = 3


class JobLayers:
    """The job beside a journal. Methods read files: call them from a thread, not from the loop.

    header : first record of the journal
    problem : why the job cannot be shown, "" where it can
    """

    def __init__(self, path: Path, header: dict[str, Any]) -> None:
        self._lock = Lock()
        self._layers: OrderedDict[int, JobLayer] = OrderedDict()
        self._reader: JobReader | None = None
        self._job: JobOfPart = job_of_part(path, str(header.get("job", "")))
        self._header = header
        self.problem = self._job.problem
        manifest = self._job.manifest
        self._first_lines = [] if manifest is None else [e.first_line for e in manifest.layers]
        self.materials = () if manifest is None else manifest.materials
        if manifest is not None:
            self._reader = JobReader(path).__enter__()

    def close(self) -> None:
        """Close the job file."""
        if self._reader is not None:
            self._reader.__exit__(None, None, None)

    def scales(self) -> PartScales:
        """What turns reported numbers into power and mixture."""
        return self._job.scales(self._header)

    def planned_fractions(self, line: int) -> list[float] | None:
        """Volume fractions (materials,) planned for a bead line; None between beads, or unknown."""
        return self._fractions("fractions", line)

    def designed_fractions(self, line: int) -> list[float] | None:
        """Volume fractions (materials,) of the part file on a bead line; None as above."""
        found = self._fractions("designed", line)
        return found if found is not None and any(found) else None

    def _fractions(self, column: str, line: int) -> list[float] | None:
        at = bisect_right(self._first_lines, line) - 1
        try:
            layer = self._layer(at) if at >= 0 else None
        except LmctlError:
            return None
        row = 0 if layer is None else line - layer.first_line
        if layer is None or row >= len(layer.lines):
            return None
        if layer.lines["kind"][row] != LineKind.BEAD:
            return None
        return [round(float(one), 4) for one in layer.lines[column][row]]

    def layer_as_json(self, number: int) -> dict[str, Any]:
        """Tracks of a layer. number : from 1

        returns : first_line, start_mm (where its first line starts, None: not known), z_mm, and
            packed columns x, y [mm, end of each line], kind, width [mm], planned fractions
        Raises UsageError where the job has no such layer; JobError.
        """
        if not 1 <= number <= len(self._first_lines):
            raise UsageError(f"the job has no layer {number}",
                             where=self.problem or f"it has {len(self._first_lines)} layers",
                             hint="choose one of its layers")
        layer = self._layer(number - 1)
        assert layer is not None
        lines, packer = layer.lines, ColumnPacker()
        packer.add_scaled("x", lines["x_mm"].astype(np.float64))
        packer.add_scaled("y", lines["y_mm"].astype(np.float64))
        packer.add_small("kind", lines["kind"].astype(np.float64))
        packer.add_scaled("width", lines["bead_width_mm"].astype(np.float64))
        for at in range(len(self.materials)):
            packer.add_scaled(f"planned{at}", lines["fractions"][:, at].astype(np.float64))
        before = self._layer(number - 2) if number > 1 else None
        return {
            "layer": number, "first_line": layer.first_line, "z_mm": round(layer.z_mm, 4),
            "start_mm": None if before is None else [
                round(float(before.lines[axis][-1]), 3) for axis in ("x_mm", "y_mm")],
            **packer.packed(),
        }

    def _layer(self, index: int) -> JobLayer | None:
        if self._reader is None:
            return None
        with self._lock:
            if index not in self._layers:
                self._layers[index] = self._reader.read_layer(index)
                while len(self._layers) > _LAYERS_KEPT:
                    self._layers.popitem(last=False)
            self._layers.move_to_end(index)
            return self._layers[index]
