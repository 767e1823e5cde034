"""One layer of a job in the form a run uses: lines, times, places and flows."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.job.schema import JobLayer, LineKind
from lmctl.run.program.beam_off import line_without_beam
from lmctl.run.program.layer_totals import LayerTotals


@dataclass(frozen=True)
class PathSpan:
    """A path and its lines, first and last included, counted through the whole job."""

    path: int
    layer: int
    first_line: int
    last_line: int


@dataclass(frozen=True)
class LayerProgram:
    """One layer as running uses it. Arrays hold one row a line, in order.

    start_s, end_s : (n,) program time at which each line starts and ends
    start_mm, end_mm : (n, 3) where it starts and ends
    is_feed_move : (n,) whether a feed override scales the line (G1)
    beam_off_spans : (n,) whether the beam is off
    speeds_mm_s, energies_J_mm : programmed speed and beam power over it, 0 where there is none
    feed_time_end_s : (n,) program time spent in G1 since the job began, up to each line's end
    starts_s, ends_s, corners_mm : the same as plain lists, for single values read many times a
        second; corners are the start of the first line and the end of each
    program : the text of each line, without its end
    path_starts : the first line of each path
    flow_s, flow_g_s : knots of the flow at the nozzle: times, and of each hopper its values there;
        plain lists too
    designed : (n, materials) volume fractions of the part file at each line's end, zeros where
        there is no bead
    totals : path, beam time and energy of its lines, with the powers that are sent
    planned : the same with the powers of the job
    """

    index: int
    z_mm: float
    first_line: int
    last_line: int
    start_s: FloatArray
    end_s: FloatArray
    start_mm: FloatArray
    end_mm: FloatArray
    is_feed_move: NDArray[np.bool_]
    beam_off_spans: NDArray[np.bool_]
    feed_time_end_s: FloatArray
    speeds_mm_s: list[float]
    energies_J_mm: list[float]
    starts_s: list[float]
    ends_s: list[float]
    corners_mm: list[list[float]]
    program: list[bytes]
    paths: tuple[PathSpan, ...]
    path_starts: tuple[int, ...]
    flow_s: list[float]
    flow_g_s: list[list[float]]
    designed: NDArray[np.float32]
    totals: LayerTotals
    planned: LayerTotals

    def paths_from(self, line: int, before: int) -> tuple[PathSpan, ...]:
        """The paths that begin at or after a line of this layer, and before another."""
        return self.paths[
            bisect_left(self.path_starts, line):bisect_left(self.path_starts, before)
        ]


def layer_program_of(
    layer: JobLayer, behind_mm: FloatArray, behind_fed_s: float, *, beam_off: bool
) -> LayerProgram:
    """A layer made ready to run.

    behind_mm, behind_fed_s : where the layer before it ends, and its last `fed_end_s`
    beam_off : every power is sent as zero
    """
    lines = layer.lines
    end_s = np.ascontiguousarray(lines["end_s"])
    start_s = np.concatenate([layer.flow_s[:1], end_s[:-1]])
    end_mm = np.column_stack([lines["x_mm"], lines["y_mm"], lines["z_mm"]])
    start_mm = np.concatenate([behind_mm[None], end_mm[:-1]])
    lasting_s = end_s - start_s
    fed = np.array([" G1 " in line for line in layer.program])
    fed_end_s = behind_fed_s + np.cumsum(np.where(fed, lasting_s, 0.0))
    bead = lines["kind"] == LineKind.BEAD
    program = [line.encode("ascii") for line in layer.program]
    speed_mm_s, power_W = lines["speed_mm_s"].astype(float), lines["power_W"].astype(float)
    length_mm = np.linalg.norm(end_mm - start_mm, axis=1)
    energy_J_mm = np.divide(power_W, speed_mm_s, out=power_W.copy(), where=speed_mm_s > 0.0)
    planned = totals = LayerTotals(start_s, end_s, length_mm, energy_J_mm)
    if beam_off:
        program = [line_without_beam(line) for line in program]
        energy_J_mm = np.zeros_like(energy_J_mm)
        totals = LayerTotals(start_s, end_s, length_mm, energy_J_mm)
    paths = _paths(layer.index, layer.first_line, lines["path"])
    return LayerProgram(
        layer.index, layer.z_mm, layer.first_line,
        layer.first_line + len(program) - 1, start_s, end_s, start_mm, end_mm, fed, ~bead,
        fed_end_s, speed_mm_s.tolist(), energy_J_mm.tolist(), start_s.tolist(), end_s.tolist(),
        [*start_mm[:1].tolist(), *end_mm.tolist()], program,
        paths, tuple(path.first_line for path in paths),
        layer.flow_s.tolist(), layer.flow_g_s.T.tolist(), lines["designed"].copy(), totals, planned,
    )


def _paths(layer: int, first_line: int, path: NDArray[np.int32]) -> tuple[PathSpan, ...]:
    """The runs of equal path number in a layer, in order; -1 is none."""
    changes = np.flatnonzero(np.diff(path)) + 1
    firsts = [0, *changes.tolist()]
    lasts = [*(changes - 1).tolist(), len(path) - 1]
    return tuple(
        PathSpan(int(path[first]), layer, first_line + first, first_line + last)
        for first, last in zip(firsts, lasts, strict=True)
        if path[first] >= 0
    )
