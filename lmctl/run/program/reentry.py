"""Where a job goes on after a hold or a crash, and how the nozzle gets back to it.

The part is entered a few millimetres before the place that was reached, so that the new bead
laps the old one (process.md 5.5), with a dark run-up in front of that, so that the beam comes on
at speed. What lies before is not run again. The way in starts at the purge position: up, across
at clearance height, down.

Lines keep their numbers in the job. The lines of the way in, which the job does not have, take
the numbers just below that of the first lit line, so that counting stays the same everywhere.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.config.machine import Motion
from lmctl.job.schema import JobLayer, JobManifest, LineKind
from lmctl.run.program.way_in import Leg, legs

FloatArray = NDArray[np.float64]

#: Bead laid twice where a path is entered in the middle, and dark run-up before it [mm].
OVERLAP_MM = 3.0
RUN_UP_MM = 2.0

#: What is shorter is not worth a line: the firmware makes no block of less than a motor step [mm].
_LEAST_MM = 0.02

#: N words of the way in; a job of fewer lines than this has none of them.
_FIRST_N = 9_990_000

_WORD = re.compile(r"([FS])([0-9.]+)")


@dataclass(frozen=True, order=True)
class Place:
    """How far a job has been executed: all lines before `line`, and this share of its length."""

    line: int = 0
    share: float = 0.0


START = Place()


@dataclass(frozen=True)
class Entry:
    """How a job goes on from a place.

    layer : the layer entered, its head replaced by the way in; its program time begins with that
    lit_line : line of the job with which the beam comes on again
    repeated_mm : bead that is laid twice
    """

    place: Place
    layer: JobLayer
    lit_line: int
    repeated_mm: float


@dataclass(frozen=True)
class _Point:
    """A point on a row of a layer. row : index into its lines; share : of the row's length."""

    row: int
    share: float


class _Track:
    """One layer as a polyline to go back along."""

    def __init__(self, layer: JobLayer, start_mm: FloatArray) -> None:
        lines = layer.lines
        self.layer = layer
        self.kind, self.path = lines["kind"], lines["path"]
        self.end_mm = np.column_stack([lines["x_mm"], lines["y_mm"], lines["z_mm"]])
        self.start_mm = np.concatenate([start_mm[None], self.end_mm[:-1]])
        self.length_mm = np.linalg.norm(self.end_mm - self.start_mm, axis=1)
        self.end_s = lines["end_s"]
        self.start_s = np.concatenate([layer.flow_s[:1], self.end_s[:-1]])

    def next_bead(self, row: int, share: float) -> int | None:
        """The first row from here on with bead left to lay."""
        if row < len(self.kind) and self.length_mm[row] * (1.0 - share) < _LEAST_MM:
            row += 1
        beads = np.flatnonzero(self.kind[row:] == LineKind.BEAD)
        return row + int(beads[0]) if len(beads) else None

    def first_of_path(self, row: int) -> int:
        while row > 0 and self.path[row - 1] == self.path[row]:
            row -= 1
        return row

    def back(self, point: _Point, by_mm: float, first_row: int) -> _Point:
        """The point so much further back along the lines, but not before a row's start."""
        row, share = point.row, point.share
        while True:
            here_mm = self.length_mm[row] * share
            if here_mm >= by_mm:
                return _Point(row, share - by_mm / self.length_mm[row] if by_mm else share)
            if row == first_row:
                return _Point(row, 0.0)
            by_mm -= here_mm
            row, share = row - 1, 1.0

    def at_mm(self, point: _Point) -> FloatArray:
        start = self.start_mm[point.row]
        return np.asarray(start + point.share * (self.end_mm[point.row] - start))

    def at_s(self, point: _Point) -> float:
        start_s = float(self.start_s[point.row])
        return start_s + point.share * (float(self.end_s[point.row]) - start_s)

    def between_mm(self, before: _Point, after: _Point) -> float:
        """Length of way from one point to a later one."""
        whole = float(self.length_mm[before.row : after.row].sum())
        return (whole - before.share * float(self.length_mm[before.row])
                + after.share * float(self.length_mm[after.row]))


def enter(
    manifest: JobManifest, read_layer: Callable[[int], JobLayer], place: Place, motion: Motion
) -> Entry | None:
    """How to go on from a place; None where no bead is left to lay.

    A place on a bead is entered OVERLAP_MM before it, but not before its path's first bead. One
    in a travel, or on a path's run-up or run-out, goes on with the next bead's path from its
    beginning.
    """
    index = layer_of(manifest, place.line)
    row, share = place.line - manifest.layers[index].first_line, place.share
    while index < len(manifest.layers):
        layer = read_layer(index)
        track = _Track(layer, _start_of(manifest, read_layer, index, motion))
        found = track.next_bead(row, share)
        if found is not None:
            reached = _Point(found, share if found == row else 0.0)
            return _entry(track, reached, place, motion)
        index, row, share = index + 1, 0, 0.0
    return None


def _entry(track: _Track, reached: _Point, place: Place, motion: Motion) -> Entry:
    layer, path_row = track.layer, track.first_of_path(reached.row)
    beads = np.flatnonzero(track.kind[path_row : reached.row + 1] == LineKind.BEAD)
    lit = track.back(reached, OVERLAP_MM, path_row + int(beads[0]))
    start = track.back(lit, RUN_UP_MM, path_row)
    words = _modal_words(layer.program[path_row : lit.row + 1])
    way = _way(track, start, lit, float(words["F"]) / 60.0, motion)
    lit_s = track.at_s(lit)
    texts, table = _lines(way, lit_s, layer.lines.dtype, words["F"])
    rest = layer.lines[lit.row :].copy()
    x, y, z = (_number(value) for value in track.end_mm[lit.row])
    first_line = layer.first_line + lit.row
    lit_text = f"{layer.program[lit.row].split()[0]} G1 X{x} Y{y} Z{z} F{words['F']} S{words['S']}"
    flow_s, flow_g_s = _flow_from(layer, lit_s, float(table["end_s"][0]))
    entered = JobLayer(
        layer.index, layer.z_mm, first_line - len(texts),
        (*texts, lit_text, *layer.program[lit.row + 1 :]), np.concatenate([table, rest]),
        flow_s, flow_g_s,
    )
    return Entry(place, entered, first_line, track.between_mm(lit, reached))


def _way(
    track: _Track, start: _Point, lit: _Point, feed_mm_s: float, motion: Motion
) -> list[Leg]:
    """From the purge position to above the run-up, down to it, and along it."""
    purge, to = np.array(motion.purge_mm, dtype=np.float64), track.at_mm(start)
    height = max(purge[2], min(to[2] + motion.clearance_mm, motion.travel_mm.z[1]))
    across = [np.array([*purge[:2], height]), np.array([*to[:2], height]), to]
    run_up = [track.end_mm[row] for row in range(start.row, lit.row)] + [track.at_mm(lit)]
    speed, acceleration = min(motion.max_speed_mm_s), min(motion.acceleration_mm_s2)
    longest_s = motion.send_horizon_s / 4.0
    return [
        *legs(purge, across, speed, acceleration, longest_s, _LEAST_MM),
        *legs(to, run_up, feed_mm_s, acceleration, longest_s, _LEAST_MM, in_one=True),
    ]


def _lines(
    way: list[Leg], end_s: float, dtype: np.dtype[np.void], feed: str
) -> tuple[list[str], NDArray[np.void]]:
    """The way in as program text and lines of a job, timed to end at end_s."""
    table = np.zeros(len(way) + 1, dtype)
    table["path"], table["kind"] = -1, LineKind.TRAVEL
    table["kind"][0] = LineKind.SETUP
    lasting_s = np.array([0.0, *(leg.lasting_s for leg in way)])
    table["end_s"] = end_s - lasting_s[::-1].cumsum()[::-1] + lasting_s
    texts = [f"N{_FIRST_N} G21 G90 G94 M4 S0"]
    for i, leg in enumerate(way, start=1):
        x, y, z = (_number(value) for value in leg.end_mm)
        table[i]["x_mm"], table[i]["y_mm"], table[i]["z_mm"] = leg.end_mm
        table[i]["speed_mm_s"] = leg.speed_mm_s
        texts.append(f"N{_FIRST_N + i} G1 X{x} Y{y} Z{z} F{_number(leg.speed_mm_s * 60)} S0")
        if leg.in_one:
            table[i]["kind"] = LineKind.LEAD
    first = way[0].start_mm if way else np.zeros(3)
    table[0]["x_mm"], table[0]["y_mm"], table[0]["z_mm"] = first
    return texts, table


def _flow_from(
    layer: JobLayer, from_s: float, start_s: float
) -> tuple[FloatArray, FloatArray]:
    """Flow at the nozzle from here on; on the way in it already is what it will be here."""
    here = np.array([np.interp(from_s, layer.flow_s, flow) for flow in layer.flow_g_s.T])
    later = layer.flow_s > from_s
    times = [start_s, from_s] if start_s < from_s else [from_s]
    flows = np.concatenate([np.tile(here, (len(times), 1)), layer.flow_g_s[later]])
    return np.concatenate([times, layer.flow_s[later]]), flows


def _modal_words(program: tuple[str, ...]) -> dict[str, str]:
    """Feed and power in force at the end of these lines; a path states both at its start."""
    words: dict[str, str] = {}
    for line in program:
        words.update(_WORD.findall(line))
    return words


def layer_of(manifest: JobManifest, line: int) -> int:
    """The layer that holds a line; the first one for a line before the job."""
    firsts = [entry.first_line for entry in manifest.layers]
    return max(bisect_right(firsts, line) - 1, 0)


def _start_of(
    manifest: JobManifest, read_layer: Callable[[int], JobLayer], index: int, motion: Motion
) -> FloatArray:
    """Where a layer's first line starts."""
    if index == 0:
        return np.array(motion.purge_mm, dtype=np.float64)
    last = read_layer(index - 1).lines[-1]
    return np.array([last["x_mm"], last["y_mm"], last["z_mm"]])


def _number(value: float) -> str:
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
