"""Small jobs made without the planner: lines with a place and a duration, flows with knots."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from lmctl.job.manifest_json import part_digest
from lmctl.job.schema import (
    JobHopper,
    JobLayer,
    JobManifest,
    LayerEntry,
    LineKind,
    line_dtype,
)
from lmctl.job.writer import JobWriter
from lmctl.run.program.job_window import JobWindow

START_MM = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class _Line:
    kind: LineKind
    end_mm: tuple[float, float, float]
    lasting_s: float
    path: int = -1
    words: str = "M4 S0"

    def text(self, number: int, lasting_mm: float) -> str:
        x, y, z = self.end_mm
        if self.kind is LineKind.SETUP:
            return f"N{number} {self.words}"
        if self.kind is LineKind.DWELL:
            return f"N{number} G4 P{self.lasting_s:.3f}"
        if self.kind is LineKind.TRAVEL:
            return f"N{number} G0 X{x:.3f} Y{y:.3f} Z{z:.3f}"
        power = 500 if self.kind is LineKind.BEAD else 0
        feed = lasting_mm / self.lasting_s * 60
        return f"N{number} G1 X{x:.3f} Y{y:.3f} Z{z:.3f} F{feed:.1f} S{power}"


@dataclass(frozen=True)
class SmallJob:
    manifest: JobManifest
    layers: tuple[JobLayer, ...]

    def window(self, **options: object) -> JobWindow:
        return JobWindow(self.manifest, self.layers.__getitem__, START_MM, **options)


def build(
    layers: Sequence[Sequence[tuple[object, ...]]],
    flow: Sequence[tuple[float, tuple[float, float]]] | None = None,
    mode: str = "lead",
    start_mm: tuple[float, float, float] = START_MM,
) -> SmallJob:
    """A job of these layers; `flow` are its knots (program time, flows) in g/s.

    A line is (kind, (x, y, z) at its end, seconds, path), the path left out where there is none.
    """
    ends, entries, made = [], [], []
    s, first, at = 0.0, 0, np.array(start_mm)
    for index, rows in enumerate(layers):
        start_s = s
        table = np.zeros(len(rows), line_dtype(2))
        table["fractions"] = (0.5, 0.5)
        texts = []
        for i, row in enumerate(map(_line, rows)):
            s += row.lasting_s
            lasting_mm = float(np.linalg.norm(np.array(row.end_mm) - at))
            texts.append(row.text(first + i, lasting_mm))
            if row.kind not in (LineKind.SETUP, LineKind.DWELL):
                table[i]["speed_mm_s"] = lasting_mm / row.lasting_s
            at = np.array(row.end_mm)
            table[i]["end_s"], table[i]["path"], table[i]["kind"] = s, row.path, row.kind
            table[i]["power_W"] = 1500 if row.kind is LineKind.BEAD else 0
            table[i]["designed"] = (0.6, 0.4) if row.kind is LineKind.BEAD else 0
            table[i]["x_mm"], table[i]["y_mm"], table[i]["z_mm"] = row.end_mm
        knots = [k for k in flow or [] if start_s < k[0] < s]
        times = np.array([start_s, *[k[0] for k in knots], s])
        flows = np.array([_at(flow, t) for t in times])
        made.append(JobLayer(index, 0.5, first, tuple(texts), table, times, flows))
        paths = sorted(set(table["path"].tolist()) - {-1})
        entries.append(LayerEntry(index, 0.5, first, len(rows), paths[0] if paths else 0,
                                  len(paths), start_s, s, "ab" * 32))
        ends.append(s)
        first += len(rows)
    manifest = JobManifest(
        part_name="test", part_sha256="cd" * 32, sources={}, machine="bench",
        profile_digest="ef" * 32, software="lmctl test", powder_mode=mode, s_max=1000,
        max_power_W=3000.0, send_horizon_s=1.0, materials=("316L", "WC-12Co"),
        hoppers=(JobHopper("A", "316L", 3.0, 1.0, 60.0), JobHopper("B", "WC-12Co", 2.0, 0.5, 60.0)),
        bounds_mm=((0, 0, 0), (100, 100, 10)), totals={"duration_s": s}, verdict=(),
        layers=tuple(entries),
    )
    return SmallJob(manifest, tuple(made))


def _line(row):
    kind, *rest = row
    return _Line(LineKind[kind.upper()], *rest)


def _at(flow, t):
    if not flow:
        return (0.1, 0.1)
    times = [k[0] for k in flow]
    return tuple(float(np.interp(t, times, [k[1][h] for k in flow])) for h in range(2))


def squares(layers=2, per_layer=2, side_mm=4.0, speed_mm_s=10.0, start_mm=(10.0, 10.0, 20.0)):
    """A program as planning makes them: from the purge position, squares of beads, and back.

    Lines of a quarter of the send horizon at most; travel by G1 without beam at 50 mm/s.
    """
    made, path, at = [], 0, np.array(start_mm)

    def go(rows, kind, to, speed, path=-1):
        nonlocal at
        to = np.array(to, dtype=float)
        length = float(np.linalg.norm(to - at))
        n = max(1, int(np.ceil(length / speed / 0.25 - 1e-9)))
        for i in range(1, n + 1):
            place = tuple(np.round(at + (to - at) * i / n, 3).tolist())
            rows.append((kind, place, length / speed / n, path))
        at = to

    for layer in range(layers):
        z = 0.5 * (layer + 1)
        rows = [] if layer else [("setup", start_mm, 0.0, -1, "G21 G90 G94"),
                                 ("setup", start_mm, 0.0, -1, "M4 S0")]
        for k in range(per_layer):
            x, y = 30.0 + 10.0 * k, 30.0
            go(rows, "lead", (x - 1, y, z + 5), 50.0)
            go(rows, "lead", (x - 1, y, z), 50.0)
            go(rows, "lead", (x, y, z), speed_mm_s, path)
            for corner in ((1, 0), (1, 1), (0, 1), (0, 0)):
                go(rows, "bead", (x + corner[0] * side_mm, y + corner[1] * side_mm, z),
                   speed_mm_s, path)
            go(rows, "lead", (x - 1, y, z), speed_mm_s, path)
            go(rows, "lead", (x - 1, y, z + 5), 50.0)
            path += 1
        if layer == layers - 1:
            go(rows, "lead", start_mm, 50.0)
            rows.append(("setup", start_mm, 0.0, -1, "M5"))
        made.append(rows)
    return made


def write_job(path, profile, layers=None, *, flow=None, mode="lead", peaks=None,
              text="a part made for tests", mixtures=()):
    """A job file for a profile; by default two layers of two squares at a steady flow.

    peaks : of power and flow, as the manifest's totals name them, and other totals; text : of the
        part file in it; mixtures : of its layers
    """
    small = build(layers or squares(), flow or [(0.0, (0.1, 0.1)), (1e6, (0.1, 0.1))], mode,
                  start_mm=profile.motion.purge_mm)
    ends = np.concatenate([layer.lines for layer in small.layers])
    bounds = tuple(
        tuple(float(extreme(ends[axis])) for axis in ("x_mm", "y_mm", "z_mm"))
        for extreme in (np.min, np.max)
    )
    manifest = replace(
        small.manifest, machine=profile.name, profile_digest=profile.planning_digest(),
        part_sha256=part_digest(text), layers=(), mixtures=mixtures,
        bounds_mm=bounds, totals={**small.manifest.totals, **(peaks or {})},
    )
    with JobWriter(path) as writer:
        for layer in small.layers:
            bead_z_mm = layer.lines["z_mm"][layer.lines["kind"] == LineKind.BEAD]
            writer.add_layer(replace(layer, z_mm=float(bead_z_mm.max(initial=0.5))))
        return writer.finish(manifest, text)


@pytest.fixture(scope="session")
def job_file():
    """Writes job files; `job_file.squares` makes layers for them."""
    write_job.squares = squares
    return write_job


@pytest.fixture(scope="session")
def job() -> Callable[..., SmallJob]:
    return build
