"""What a run should have built by the model that its job believes, from its journal alone.

Executed beads are strips of the job's own width and layer height at the place and time that the
machine reported; powder is what was commanded, through each hopper's dead time and lag, with the
part file's catch efficiencies. A job that makes up for dilution is predicted with the dilution that
it believes. True growth and every error of that model are missing: it is a prediction, not a
measurement.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lmctl.array_types import FloatArray, IntArray
from lmctl.as_built.believed_dilution import LevelDilution
from lmctl.as_built.built_volume import BuiltPath, BuiltVolume
from lmctl.as_built.journal_powder import CommandedPowder
from lmctl.errors import InputError
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind

if TYPE_CHECKING:
    from lmctl.part.part import Part

#: Edge of a voxel in the plane; pieces of path are as long at most, and voxels three to a layer.
_VOXEL_MM = 0.25
_PER_LAYER = 3
#: Beads of a level layer are as high as it, up to this [mm].
_LEVEL_MM = 0.01
#: Time over which the reported pace is averaged. From one report to the next, 0.2 s later, it
#: scatters by 24 % about a steady pace on the gear that ships; over this time by 3.5 %.
_PACE_WINDOW_S = 2.0
#: A report farther from its line is of another motion: an approach has the number of the line that
#: it leads to.
_ON_PATH_MM = 3.0
#: A strip is put down in points so many to a voxel's edge.
_POINTS_PER_VOXEL = 4
_NOTE = ("predicted from commanded powder and reported places; {} not in it")


@dataclass(frozen=True)
class _Beads:
    """(n,) pieces of executed beads. machine_s, duration_s : when; width_mm : of the bead"""

    place_mm: FloatArray
    direction: FloatArray
    length_mm: FloatArray
    width_mm: FloatArray
    machine_s: FloatArray
    duration_s: FloatArray
    line: IntArray


def predicted_volume(
    job: JobReader, part: Part, runs: Iterable[Iterable[dict[str, Any]]]
) -> BuiltVolume:
    """Predict what the runs of one part built together.

    runs : the records of each run's journal, in order; a run that continues another begins where
        that one ended
    Raises InputError where no run deposited anything that was reported.
    """
    found = [one for records in runs if (one := _built_by_run(job, part, records)) is not None]
    if not found:
        raise InputError("the journal reports no bead with powder: there is nothing to predict",
                         hint="choose a run that deposited something: `lmctl jobs` lists runs")
    beads = _Beads(*(np.concatenate([getattr(one, field.name) for one, _ in found])
                     for field in fields(_Beads)))
    volume = np.concatenate([volume for _, volume in found])
    layer_mm = _layer_height_mm(job)
    strips = replace(beads, width_mm=beads.width_mm * (1 - part.process.overlap))
    # layers that follow a substrate come lower than the height they are known by
    lowest_mm = min(job.manifest.layers[0].z_mm, float(beads.place_mm[:, 2].min()) + _LEVEL_MM)
    return _strips(strips, volume, layer_mm, lowest_mm - layer_mm,
                   tuple(material.name for material in part.materials),
                   LevelDilution.of_job(job, part))


def _built_by_run(
    job: JobReader, part: Part, records: Iterable[dict[str, Any]]
) -> tuple[_Beads, FloatArray] | None:
    """A run's beads and the volume of each material in them, (n, materials) [mm³]; None where it
    reported none."""
    powder, reports = CommandedPowder(), []
    begins = (0, 0.0)
    for record in records:
        powder.take(record)
        if record["kind"] == "header" and (place := record.get("begins_at")):
            begins = int(place["line"]), float(place["share"])
        elif record["kind"] == "samples":
            reports += list(zip(*(record[name] for name in ("at", "line", "x_mm", "y_mm", "z_mm")),
                                strict=True))
    beads = _executed_beads(job, np.array(reports, dtype=np.float64).reshape(-1, 5), *begins)
    if beads is None:
        return None
    volume = np.stack([
        powder.flow_g_s(material.name, beads.machine_s)
        * material.catch_efficiency / material.density_g_mm3
        for material in part.materials], axis=1) * beads.duration_s[:, None]
    return (beads, volume) if (volume > 0).any() else None


def _layer_height_mm(job: JobReader) -> float:
    entries = job.manifest.layers
    return float(entries[1].z_mm - entries[0].z_mm if len(entries) > 1 else entries[0].z_mm)


def _executed_beads(
    job: JobReader, reports: FloatArray, begin_line: int, begin_share: float
) -> _Beads | None:
    """Pieces of every bead between the first report in the program and the last; None where no
    two reports tell of motion in it.

    reports : (m, 5) machine time, line, x, y, z
    begin_line, begin_share : where the run continues another
    """
    begin_s = -np.inf
    pieces: list[tuple[FloatArray, ...]] = []
    times: list[FloatArray] = []
    program: list[FloatArray] = []
    previous: FloatArray | None = None
    for layer in job.iterate_layers():
        lines = layer.lines
        ends = np.stack([lines[axis] for axis in ("x_mm", "y_mm", "z_mm")], axis=1)
        before = np.concatenate([ends[:1] if previous is None else previous, ends[:-1]])
        start_s = np.concatenate([layer.flow_s[:1], lines["end_s"][:-1]])
        previous = ends[-1:]
        row_of_begin = begin_line - layer.first_line
        if begin_line and 0 <= row_of_begin < len(lines):
            begin_s = float(start_s[row_of_begin] + begin_share * (
                lines["end_s"][row_of_begin] - start_s[row_of_begin]))
        mine = reports[(reports[:, 1] >= max(1, layer.first_line))
                       & (reports[:, 1] < layer.first_line + len(lines))]
        row = (mine[:, 1] - layer.first_line).astype(np.int64)
        share = _share(mine[:, 2:], before[row], ends[row])
        off_mm = np.linalg.norm(
            mine[:, 2:] - before[row] - share[:, None] * (ends[row] - before[row]), axis=1)
        on_path = off_mm <= _ON_PATH_MM
        times.append(mine[on_path, 0])
        program.append((start_s[row] + share * (lines["end_s"][row] - start_s[row]))[on_path])
        beads = np.flatnonzero(lines["kind"] == LineKind.BEAD)
        along = ends[beads] - before[beads]
        length = np.linalg.norm(along, axis=1)
        beads, along, length = beads[length > 0], along[length > 0], length[length > 0]
        count = np.ceil(length / _VOXEL_MM).astype(np.int64)
        of = np.repeat(np.arange(len(beads)), count)
        number = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
        share = (number + 0.5) / count[of]
        took = (lines["end_s"] - start_s)[beads][of]
        pieces.append((
            before[beads][of] + along[of] * share[:, None], (along / length[:, None])[of],
            (length / count)[of], lines["bead_width_mm"][beads][of].astype(np.float64),
            start_s[beads][of] + share * took, took / count[of],
            (layer.first_line + beads)[of].astype(np.float64)))
    place, direction, length, width, at_s, took_s, line = map(
        np.concatenate, zip(*pieces, strict=True))
    machine_s, program_s = np.concatenate(times), np.maximum.accumulate(np.concatenate(program))
    entered = int(np.searchsorted(program_s, begin_s, side="right"))
    if 0 < entered < len(program_s):  # from there to the first report it went as planned
        ahead_s = program_s[entered] - begin_s
        machine_s = np.concatenate([[machine_s[entered] - ahead_s], machine_s[entered:]])
        program_s = np.concatenate([[begin_s], program_s[entered:]])
    reached, first = np.unique(program_s, return_index=True)
    if len(reached) < 2:
        return None
    done = (at_s >= reached[0]) & (at_s <= reached[-1])
    seconds = machine_s[first]
    kept = np.append(np.flatnonzero(np.diff(seconds // _PACE_WINDOW_S)), len(seconds) - 1)
    kept = np.union1d(0, kept)
    begin, end = (np.interp(at_s[done] + side * took_s[done] / 2, reached[kept], seconds[kept])
                  for side in (-1, 1))
    pace = np.minimum(end - begin, 4 * took_s[done])  # a hold is no long bead
    return _Beads(place[done], direction[done], length[done], width[done], (begin + end) / 2, pace,
                  line[done].astype(np.int64))


def _share(at: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """How far along its line a reported place is, 0 to 1."""
    along = end - start
    square = np.maximum((along**2).sum(axis=1), 1e-12)
    return np.asarray(np.clip(((at - start) * along).sum(axis=1) / square, 0, 1))


def _strips(
    beads: _Beads, volume: FloatArray, layer_mm: float, plate_z_mm: float, names: tuple[str, ...],
    dilution: LevelDilution | None = None,
) -> BuiltVolume:
    """Strips put down on voxels: evenly across their width and over their layer's height.

    dilution : by which they melt the layer below, or None
    """
    voxel = np.array([_VOXEL_MM, _VOXEL_MM, layer_mm / _PER_LAYER])
    margin = float(beads.width_mm.max()) / 2 + _VOXEL_MM
    low = np.floor((beads.place_mm.min(axis=0) - margin) / voxel) * voxel
    low[2] = plate_z_mm
    high = beads.place_mm.max(axis=0) + margin
    shape = np.ceil((high - low) / voxel).astype(int)
    shape[2] = round((float(beads.place_mm[:, 2].max()) - plate_z_mm) / voxel[2]) + 1
    across = np.maximum(np.ceil(_POINTS_PER_VOXEL * beads.width_mm / _VOXEL_MM), 1).astype(np.int64)
    of = np.repeat(np.arange(len(across)), across)
    number = np.arange(len(of)) - np.repeat(np.cumsum(across) - across, across)
    beside = ((number + 0.5) / across[of] - 0.5) * beads.width_mm[of]
    top = np.round((beads.place_mm[of, 2] - plate_z_mm) / voxel[2]).astype(int)
    share = volume / (across * _PER_LAYER * _POINTS_PER_VOXEL)[:, None]
    by_top = np.zeros((len(names), int(np.prod(shape)) + shape[2]))
    for step in range(_POINTS_PER_VOXEL):
        along = ((step + 0.5) / _POINTS_PER_VOXEL - 0.5) * beads.length_mm[of]
        place = beads.place_mm[of, :2] + along[:, None] * beads.direction[of, :2]
        place += beside[:, None] * np.stack(
            [-beads.direction[of, 1], beads.direction[of, 0]], axis=1)
        # Shared between the four voxels around it: whole points would fill neighbours unevenly.
        corner, beyond = np.divmod((place - low[:2]) / _VOXEL_MM - 0.5, 1.0)
        for right, back in np.ndindex(2, 2):
            i, j = np.add(corner, (right, back)).astype(int).T
            part_of = np.abs(1 - right - beyond[:, 0]) * np.abs(1 - back - beyond[:, 1])
            cell = (i * shape[1] + j) * shape[2] + top
            for row in range(len(names)):
                by_top[row] += np.bincount(cell, share[of, row] * part_of,
                                           minlength=by_top.shape[1])
    tops = by_top[:, : int(np.prod(shape))].reshape(len(names), *shape)
    tops = np.concatenate([tops, np.zeros((1, *shape))])
    if dilution is not None:
        tops = dilution.melted_into(tops)
    voxels = np.zeros((len(names) + 1, *shape))
    for top_level in range(shape[2]):
        for below in range(1, _PER_LAYER + 1):
            voxels[:, :, :, max(top_level - below, 0)] += tops[..., top_level]
    total = volume.sum(axis=1, keepdims=True)
    delivered = np.zeros((len(volume), len(names) + 1))
    delivered[:, :-1] = np.divide(volume, total, out=np.full_like(volume, np.nan), where=total > 0)
    substrate = next(name for name in ("substrate", "substrate plate") if name not in names)
    return BuiltVolume(
        "predicted", low, voxel, (*names, substrate), "", voxels.astype(np.float32),
        voxels.sum(axis=(0, 3)) / _VOXEL_MM**2, plate_z_mm,
        BuiltPath(beads.place_mm, beads.length_mm, delivered, np.full(len(volume), np.nan),
                  beads.line),
        None, (_NOTE.format("dilution and true growth are" if dilution is None
                            else "true growth is"),))
