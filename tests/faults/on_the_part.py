"""What lies on a part, along its paths, by the simulators' record of beam, motion and powder.

It knows the job only as the lines that a part is made of: where they are and which are bead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.job.reader import JobReader
from lmctl.run.program.job_lines import rows_between
from lmctl.run.program.place import ProgramPlace
from simulators.bench import Bench

#: The beam's path is looked at in pieces so long [mm].
STEP_MM = 0.05
#: A gap shorter than this leaves no less than 0.9 of the deposit in two millimetres [mm].
LEAST_GAP_MM = 0.2
#: Bead that may be deposited twice where a path is entered again [mm].
OVERLAP_MM = 0.5
#: Deposit is weighed over windows so long, within so much of an entry [mm].
WINDOW_MM, AROUND_MM = 2.0, 3.0
#: Mixture is compared over so much new path [mm].
MIXTURE_MM = 50.0
_GRID_MM = 0.1


@dataclass(frozen=True)
class _Pieces:
    """Pieces of bead along one path, in the order of time. begin_mm, end_mm : (n,) along it

    volume_mm3 : (n, materials) deposited
    """

    begin_mm: FloatArray
    end_mm: FloatArray
    volume_mm3: FloatArray


@dataclass(frozen=True)
class Deposit:
    """What lies along each path: its beads' length [mm], and its pieces."""

    length_mm: dict[int, float]
    pieces: dict[int, _Pieces]

    def along(self, path: int, edges_mm: FloatArray) -> FloatArray:
        """(k − 1, materials) volume between neighbouring places along a path."""
        one = self.pieces[path]
        length = np.maximum(one.end_mm - one.begin_mm, 1e-9)
        share = np.clip((edges_mm[:, None] - one.begin_mm) / length, 0.0, 1.0)
        return np.diff(share @ one.volume_mm3, axis=0)


@dataclass(frozen=True)
class OnThePart:
    """A part after its last run.

    missing_mm : bead that lies nowhere, gaps below LEAST_GAP_MM left out
    largest_gap_mm : the longest stretch without bead
    repeated_mm : bead that lies twice, beyond OVERLAP_MM of each doubled stretch
    largest_overlap_mm : the longest doubled stretch
    off_path_mm : farthest that the beam was from the line it was to draw
    entries : where paths were entered again: (path, along it [mm])
    """

    deposit: Deposit
    missing_mm: float
    largest_gap_mm: float
    repeated_mm: float
    largest_overlap_mm: float
    off_path_mm: float
    entries: tuple[tuple[int, float], ...]
    starts: dict[int, tuple[int, float]]  # of each bead line: its path, and where along it
    designed: dict[int, tuple[FloatArray, FloatArray]]  # of each path: ends of its lines, mixtures

    def deposited_mm(self, job: JobReader, place: ProgramPlace, until: ProgramPlace) -> float:
        """How far the bead goes from one place on, as an operator sees it who looks at the part."""
        total_mm = 0.0
        for rows in rows_between(job, place.line, until.line):
            for row in np.flatnonzero(rows.is_bead).tolist():
                line, length_mm = int(rows.line[row]), float(rows.length_mm[row])
                path, start_mm = self.starts[line]
                from_mm = start_mm + length_mm * (
                    place.line_fraction if line == place.line else 0.0)
                to_mm = start_mm + length_mm * (until.line_fraction if line == until.line else 1.0)
                one = self.deposit.pieces.get(path)
                if one is not None and to_mm > from_mm:
                    total_mm += _covered(one, from_mm, to_mm)
        return total_mm

    def entry_deposit(self, whole: Deposit) -> tuple[float, float]:
        """Least and most deposit in two millimetres around an entry, over that of a whole bead."""
        shares = [1.0]
        for path, at_mm in self.entries:
            low = max(0.0, at_mm - AROUND_MM - WINDOW_MM)
            high = min(whole.length_mm[path], at_mm + AROUND_MM + WINDOW_MM)
            edges = np.arange(low, high + 1e-9, _GRID_MM)
            wide = round(WINDOW_MM / _GRID_MM)
            if len(edges) <= wide:
                continue
            mine, theirs = (_windows(one.along(path, edges).sum(axis=1), wide)
                            for one in (self.deposit, whole))
            shares += (mine / theirs).tolist()
        return min(shares), max(shares)

    def entry_mixture_error(self) -> float:
        """Greatest difference of a volume fraction from the job's on the new path, by 1 mm."""
        worst = 0.0
        for path, at_mm in self.entries:
            high = min(self.deposit.length_mm[path], at_mm + MIXTURE_MM)
            edges = np.arange(at_mm, high, 1.0)
            if len(edges) < 2:
                continue
            ends_mm, fractions = self.designed[path]
            inside = edges[:-1, None] + np.linspace(0.05, 0.95, 10)
            wanted = fractions[np.searchsorted(ends_mm, inside)].mean(axis=1)
            off = _fractions(self.deposit.along(path, edges)) - wanted
            worst = max(worst, float(np.abs(off).max()))
        return worst


def measured(
    bench: Bench, job_path: Path, entered: Sequence[ProgramPlace], zero_mm: Sequence[float]
) -> OnThePart:
    """What a bench has made of a job so far.

    entered : where it was entered again; zero_mm : program zero, in machine coordinates
    """
    drawn = bench.record.beam_on_path(STEP_MM)
    position_mm = drawn.position_mm - np.asarray(zero_mm)
    lengths: dict[int, float] = {}
    pieces: dict[int, list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]]] = {}
    starts: dict[int, tuple[int, float]] = {}
    mixtures: dict[int, list[tuple[float, FloatArray]]] = {}
    off_path_mm = 0.0
    with JobReader(job_path) as job:
        assert job.manifest.materials == drawn.materials
        wanted = np.concatenate([layer.lines["fractions"] for layer in job.iterate_layers()])
        n_lines = sum(entry.n_lines for entry in job.manifest.layers)
        for rows in rows_between(job, 0, n_lines - 1):
            for row in np.flatnonzero(rows.is_bead).tolist():
                path, line = int(rows.path[row]), int(rows.line[row])
                start_mm, length_mm = lengths.get(path, 0.0), float(rows.length_mm[row])
                starts[line] = path, start_mm
                lengths[path] = start_mm + length_mm
                mixtures.setdefault(path, []).append((start_mm + length_mm, wanted[line]))
                mine = np.flatnonzero(drawn.line == line)
                along = (rows.end_mm[row] - rows.start_mm[row]) / length_mm
                from_start = position_mm[mine] - rows.start_mm[row]
                at_mm = from_start @ along
                if len(mine):
                    off = np.linalg.norm(from_start - at_mm[:, None] * along, axis=1)
                    beyond = np.maximum(np.maximum(-at_mm, at_mm - length_mm), 0.0)
                    off_path_mm = max(off_path_mm, float(np.hypot(off, beyond).max()))
                half = drawn.length_mm[mine] / 2
                volume = drawn.deposit_mm3_s[mine] * drawn.duration_s[mine, None]
                pieces.setdefault(path, []).append(
                    (start_mm + at_mm - half, start_mm + at_mm + half, volume, drawn.time_s[mine]))
        entries = tuple(
            (path, at_mm + place.line_fraction * _length(job, place))
            for place in entered if place.line in starts
            for path, at_mm in [starts[place.line]]
        )
    strangers = ~np.isin(drawn.line, list(starts))
    if strangers.any():
        off_path_mm = float("inf")
    joined = {path: _joined(parts) for path, parts in pieces.items()}
    gaps, doubled = [], []
    for path, one in joined.items():
        path_gaps, path_doubled = _gaps_and_doubled(one, lengths[path])
        gaps += path_gaps
        doubled += path_doubled
    return OnThePart(
        Deposit(lengths, joined),
        missing_mm=sum(gap for gap in gaps if gap > LEAST_GAP_MM),
        largest_gap_mm=max(gaps, default=0.0),
        repeated_mm=sum(max(0.0, one - OVERLAP_MM) for one in doubled),
        largest_overlap_mm=max(doubled, default=0.0),
        off_path_mm=off_path_mm, entries=entries, starts=starts,
        designed={
            path: (np.array([end for end, _ in lines]), np.array([of for _, of in lines]))
            for path, lines in mixtures.items()
        },
    )


def _length(job: JobReader, place: ProgramPlace) -> float:
    return float(next(rows_between(job, place.line, place.line)).length_mm[0])


def _joined(parts: list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]]) -> _Pieces:
    begin, end, volume, _ = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return _Pieces(begin, end, volume)


def _covered(one: _Pieces, from_mm: float, to_mm: float) -> float:
    """Length between two places along a path where bead lies."""
    covered, reached = 0.0, from_mm
    for i in np.argsort(one.begin_mm):
        begin, end = max(float(one.begin_mm[i]), reached), min(float(one.end_mm[i]), to_mm)
        if end > begin:
            covered += end - begin
        reached = max(reached, end)
    return covered


def _gaps_and_doubled(one: _Pieces, length_mm: float) -> tuple[list[float], list[float]]:
    """Lengths of the stretches of a path with no bead, and of those with more than one."""
    events = np.concatenate([one.begin_mm, one.end_mm])
    step = np.concatenate([np.ones(len(one.begin_mm)), -np.ones(len(one.end_mm))])
    # Pieces that follow on each other differ by rounding: a thousandth is neither gap nor doubled.
    events = np.clip(np.round(events, 3), 0.0, length_mm)
    order = np.lexsort((step, events))
    places = np.concatenate([[0.0], events[order], [length_mm]])
    count = np.concatenate([[0.0], np.cumsum(step[order])])
    return _runs(places, count <= 0), _runs(places, count >= 2)


def _runs(places: FloatArray, is_so: NDArray[np.bool_]) -> list[float]:
    """Lengths of the connected stretches where it is so, those of 2 µm left out."""
    found: list[float] = []
    since: float | None = None
    last = 0.0
    for begin, end, so in zip(places[:-1], places[1:], is_so, strict=True):
        if end - begin < 2e-3:
            continue
        if so:
            since = float(begin) if since is None else since
            last = float(end)
        elif since is not None:
            found.append(last - since)
            since = None
    if since is not None:
        found.append(last - since)
    return found


def _fractions(volumes: FloatArray) -> FloatArray:
    return np.asarray(volumes / np.maximum(volumes.sum(axis=1, keepdims=True), 1e-12))


def _windows(volumes: FloatArray, wide: int) -> FloatArray:
    return np.convolve(volumes, np.ones(wide), mode="valid")
