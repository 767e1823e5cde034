"""Where a job resumes after a hold or a crash, and how the nozzle returns to the path.

The part is entered a little before the place where deposition ended, so that the new bead meets
the old one without a gap and without a hump (`overlap_mm`). Earlier lines are not run again. In
front of that place is a run-up along the path itself with the beam off, so that the beam comes on
at full speed and with the programmed powder flow: on the run-up the flow follows the program,
before it the flow is constant. The approach starts at the purge position: up, across at clearance
height, down.

Lines keep their numbers in the job. The lines of the approach, which the job does not have, take
the numbers just below that of the first line with beam, so that counting stays the same everywhere.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.config.machine import MotionSettings
from lmctl.job.schema import JobLayer, JobManifest, LineKind
from lmctl.run.program.approach import (
    ApproachMove,
    acceleration_time_loss_s,
    travel_moves,
)
from lmctl.run.program.layer_track import MIN_MOVE_MM, LayerTrack, TrackPoint
from lmctl.run.program.place import ProgramPlace

#: Bead deposited twice where a path is entered in the middle [mm]: more than the place where it
#: ended is uncertain, and far less than a melt pool.
OVERLAP_MM = 0.2

#: Least run-up with the beam off before a path is entered [mm]; it is longer where the nozzle
#: needs more to reach its speed.
RUN_UP_MM = 2.0
_OF_RAMP = 1.5

#: N words of the approach; a job of fewer lines than this has none of them.
_FIRST_N = 9_990_000

_WORD = re.compile(r"([FS])([0-9.]+)")


@dataclass(frozen=True)
class Reentry:
    """How a job resumes from a place.

    layer : the layer entered, the approach replaces its beginning; its program time begins with it
    beam_on_line : line of the job with which the beam comes on again
    repeated_mm : bead that is deposited again
    """

    place: ProgramPlace
    layer: JobLayer
    beam_on_line: int
    repeated_mm: float


@dataclass(frozen=True)
class ReentryPreview:
    """A re-entry as people look at it before they resume. Positions in program coordinates.

    layer : index; beam_on_line : line of the job with which the beam comes on again
    repeated_mm : bead that is deposited again
    run_up_mm : length of path before that, driven with the beam off
    approach_mm : corners of the way from the purge position to where the beam comes on
    """

    layer: int
    beam_on_line: int
    repeated_mm: float
    run_up_mm: float
    approach_mm: tuple[tuple[float, float, float], ...]


def preview_of(entry: Reentry) -> ReentryPreview:
    """What a planned re-entry will do."""
    rows = entry.layer.lines[: entry.beam_on_line - entry.layer.first_line]
    corners = np.column_stack([rows["x_mm"], rows["y_mm"], rows["z_mm"]])
    lead = rows["kind"] == LineKind.LEAD
    legs_mm = np.linalg.norm(np.diff(corners, axis=0, prepend=corners[:1]), axis=1)
    return ReentryPreview(
        entry.layer.index, entry.beam_on_line, entry.repeated_mm, float(legs_mm[lead].sum()),
        tuple((float(x), float(y), float(z)) for x, y, z in corners))


def plan_reentry(
    manifest: JobManifest, read_layer: Callable[[int], JobLayer], place: ProgramPlace,
    motion: MotionSettings
) -> Reentry | None:
    """How to resume from a place; None where no bead is left to deposit.

    A place on a bead is entered `overlap_mm` before it, but not before its path's first bead. One
    in a travel, or on a path's run-up or run-out, resumes with the next bead's path from its
    beginning.
    """
    index = layer_of(manifest, place.line)
    row, share = place.line - manifest.layers[index].first_line, place.line_fraction
    while index < len(manifest.layers):
        layer = read_layer(index)
        track = LayerTrack(layer, _start_of(manifest, read_layer, index, motion))
        found = track.next_bead(row, share)
        if found is not None:
            reached = TrackPoint(found, share if found == row else 0.0)
            return _entry(track, reached, place, motion)
        index, row, share = index + 1, 0, 0.0
    return None


def overlap_mm(speed_mm_s: float, acceleration_mm_s2: float) -> float:
    """How much of a bead is deposited again where it is entered at this speed [mm].

    A bead whose nozzle braked to a stop has more powder at its end: it came at the same rate while
    the nozzle went slower, as much more as the braking distance v²/2a. So less is deposited again,
    or nothing: any two millimetres then hold 0.9 to 1.3 times the powder of a whole bead, up to
    20 mm/s at 500 mm/s².
    """
    return max(0.0, OVERLAP_MM - speed_mm_s**2 / (4.0 * acceleration_mm_s2))


def _entry(
    track: LayerTrack, reached: TrackPoint, place: ProgramPlace, motion: MotionSettings
) -> Reentry:
    layer, path_row = track.layer, track.first_of_path(reached.row)
    beads = np.flatnonzero(track.kind[path_row : reached.row + 1] == LineKind.BEAD)
    speed_mm_s = float(layer.lines["speed_mm_s"][reached.row])
    acceleration = track.acceleration(reached.row, motion)
    beam_on = track.back(reached, overlap_mm(speed_mm_s, acceleration), path_row + int(beads[0]))
    ramp_mm = speed_mm_s**2 / (2.0 * acceleration)
    start = track.back(beam_on, max(RUN_UP_MM, _OF_RAMP * ramp_mm), path_row)
    beam_on_s = track.at_s(beam_on)
    run_up, program_s = _run_up(track, start, beam_on, motion)
    purge = np.array(motion.purge_mm, dtype=np.float64)
    moves = [
        *travel_moves(purge, _across(purge, track.at_mm(start), motion), motion, MIN_MOVE_MM),
        *run_up,
    ]
    texts, table = _lines(moves, purge, beam_on_s, layer.lines.dtype)
    rest = layer.lines[beam_on.row :].copy()
    x, y, z = (_number(value) for value in track.end_mm[beam_on.row])
    words = _modal_words(layer.program[path_row : beam_on.row + 1])
    first_line = layer.first_line + beam_on.row
    number = layer.program[beam_on.row].split()[0]
    beam_on_text = f"{number} G1 X{x} Y{y} Z{z} F{words['F']} S{words['S']}"
    approach_s = table["end_s"][len(table) - len(run_up) - 1 :]
    flow_s, flow_g_s = _flow(layer, program_s, approach_s, float(table["end_s"][0]))
    entered = JobLayer(
        layer.index, layer.z_mm, first_line - len(texts),
        (*texts, beam_on_text, *layer.program[beam_on.row + 1 :]), np.concatenate([table, rest]),
        flow_s, flow_g_s,
    )
    return Reentry(place, entered, first_line, track.between_mm(beam_on, reached))


def _across(purge: FloatArray, to: FloatArray, motion: MotionSettings) -> list[FloatArray]:
    """From the purge position up, across at clearance height, and down to where the run-up begins.
    """
    height = max(purge[2], min(to[2] + motion.clearance_mm, motion.travel_mm.z[1]))
    return [np.array([*purge[:2], height]), np.array([*to[:2], height]), to]


def _run_up(
    track: LayerTrack, start: TrackPoint, beam_on: TrackPoint, motion: MotionSettings
) -> tuple[list[ApproachMove], list[float]]:
    """The path from rest at one point to another, and the program time at the ends of its legs.

    Each leg goes at its row's own speed and lasts as planned, corners included; the first ones
    take longer, since the nozzle starts at rest. A lead's planned time is that of another start.
    """
    run_up_moves: list[ApproachMove] = []
    program_s = [track.at_s(start)]
    at_mm, covered_mm, extra_s = track.at_mm(start), 0.0, 0.0
    acceleration = track.acceleration(start.row, motion)
    first_mm_s = float(track.layer.lines["speed_mm_s"][start.row])
    longest_s = motion.send_horizon_s / 4.0
    for row in range(start.row, beam_on.row + 1):
        from_share = start.share if row == start.row else 0.0
        to_share = beam_on.share if row == beam_on.row else 1.0
        share = to_share - from_share
        length_mm = share * float(track.length_mm[row])
        if length_mm < MIN_MOVE_MM:
            continue
        speed_mm_s = float(track.layer.lines["speed_mm_s"][row])
        planned_s = share * float(track.end_s[row] - track.start_s[row])
        if track.kind[row] != LineKind.BEAD:
            planned_s = length_mm / speed_mm_s
        parts = max(1, math.ceil((planned_s + first_mm_s / acceleration) / longest_s))
        for k in range(1, parts + 1):
            end = TrackPoint(row, from_share + share * k / parts)
            covered_mm += length_mm / parts
            before_s = extra_s
            extra_s = acceleration_time_loss_s(covered_mm, first_mm_s, acceleration)
            end_mm = np.round(track.at_mm(end), 3)
            run_up_moves.append(ApproachMove(at_mm, end_mm, speed_mm_s,
                                     planned_s / parts + extra_s - before_s,
                                     is_run_up=True))
            program_s.append(track.at_s(end))
            at_mm = end_mm
    program_s[-1] = track.at_s(beam_on)
    return run_up_moves, program_s


def _lines(
    moves: list[ApproachMove], start_mm: FloatArray, end_s: float, dtype: np.dtype[np.void]
) -> tuple[list[str], NDArray[np.void]]:
    """The approach as program text and lines of a job, timed to end at end_s."""
    table = np.zeros(len(moves) + 1, dtype)
    table["path"], table["kind"] = -1, LineKind.TRAVEL
    table["kind"][0] = LineKind.SETUP
    lasting_s = np.array([0.0, *(move.duration_s for move in moves)])
    table["end_s"] = end_s - lasting_s[::-1].cumsum()[::-1] + lasting_s
    texts = [f"N{_FIRST_N} G21 G90 G94 M4 S0"]
    table[0]["x_mm"], table[0]["y_mm"], table[0]["z_mm"] = start_mm
    for i, move in enumerate(moves, start=1):
        table[i]["x_mm"], table[i]["y_mm"], table[i]["z_mm"] = move.end_mm
        table[i]["speed_mm_s"] = move.speed_mm_s
        if move.is_dwell:
            table[i]["kind"] = LineKind.DWELL
            texts.append(f"N{_FIRST_N + i} G4 P{move.duration_s:g}")
            continue
        x, y, z = (_number(value) for value in move.end_mm)
        texts.append(f"N{_FIRST_N + i} G1 X{x} Y{y} Z{z} F{_number(move.speed_mm_s * 60)} S0")
        if move.is_run_up:
            table[i]["kind"] = LineKind.LEAD
    return texts, table


def _flow(
    layer: JobLayer, program_s: list[float], approach_s: FloatArray, start_s: float
) -> tuple[FloatArray, FloatArray]:
    """Flow at the nozzle: steady on the travel, on the run-up and after it the program's own.

    program_s : the program's times at the start of the run-up and at the end of each of its legs;
    approach_s : the times of the approach there; start_s : when the approach begins
    """
    inside = (layer.flow_s > program_s[0]) & (layer.flow_s < program_s[-1])
    knots_s = np.concatenate([program_s[:1], layer.flow_s[inside], program_s[-1:]])
    times = np.interp(knots_s, program_s, approach_s)
    later = layer.flow_s > program_s[-1]
    known_s = np.concatenate([knots_s, layer.flow_s[later]])
    times = np.concatenate([times, layer.flow_s[later]])
    flows = np.column_stack([np.interp(known_s, layer.flow_s, flow) for flow in layer.flow_g_s.T])
    if start_s < times[0]:
        times = np.concatenate([[start_s], times])
        flows = np.concatenate([flows[:1], flows])
    kept = np.concatenate([[True], np.diff(times) > 0.0])
    return times[kept], flows[kept]


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
    manifest: JobManifest, read_layer: Callable[[int], JobLayer], index: int, motion: MotionSettings
) -> FloatArray:
    """Where a layer's first line starts."""
    if index == 0:
        return np.array(motion.purge_mm, dtype=np.float64)
    last = read_layer(index - 1).lines[-1]
    return np.array([last["x_mm"], last["y_mm"], last["z_mm"]])


def _number(value: float) -> str:
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
