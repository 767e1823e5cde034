"""Interpass temperature: the planner's prediction, and its waits, against finite differences.

`revisit_within`: of all places that the planner reads, on five shapes, the share whose predicted
temperature differs from the finer solution's by no more than a tenth of its rise over the plate, or
by 5 K where the rise is below 50 K; weighted equally, a place a bead width.

`interpass_time`: program time of a plan with a limit over that of the same part with one dwell
before each layer but the first, the least (to a second) with which the finer solution keeps that
limit at all places, or what it finds for the planner's own plan where that is more. The part is a
wall of one track a layer: a layer of two would come back to its own heat, which no dwell between
layers takes away.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lmctl.job.reader import JobReader
from lmctl.job.schema import JobLayer, JobManifest
from lmctl.part.load import load_part
from lmctl.part.part import Part
from lmctl.plan.planner import plan_job
from tests.benchmarks.mixture_rows.as_built import profile
from tests.benchmarks.mixture_rows.fine_heat import FineConstants, beads_of, fine_temperatures
from tests.benchmarks.mixture_rows.revisits import planner_readings

_STEEL = '[[material]]\nname = "316L"\n'
_TWO = _STEEL + """[[material]]
name = "WC-12Co"
[composition]
feature = { kind = "coordinate", along = "x" }
[composition.profile]
kind = "linear"
near = { "316L" = 0.9, "WC-12Co" = 0.1 }
far = { "316L" = 0.2, "WC-12Co" = 0.8 }
over_mm = [0, 16]
"""
_BOX = '[[body]]\nkind = "box"\nlow_mm = [0, 0, 0]\nhigh_mm = [{}]\n'
_RING = """
[[body]]
name = "disc"
kind = "cylinder"
base_mm = [0, 0, 0]
top_mm = [0, 0, 4]
radius_mm = 10
[[body]]
name = "bore"
kind = "cylinder"
base_mm = [0, 0, -1]
top_mm = [0, 0, 5]
radius_mm = 6
[[body]]
kind = "difference"
of = ["disc", "bore"]
"""
#: Shapes of `revisit_within`: materials and bodies.
SHAPES = {
    "wall": _STEEL + _BOX.format("30, 2.668, 8"),
    "block": _STEEL + _BOX.format("16, 12, 5.6"),
    "ring": _STEEL + _RING,
    "carbide": _STEEL.replace("316L", "WC-12Co") + _BOX.format("16, 12, 4"),
    "two": _TWO + _BOX.format("16, 10, 4"),
}
_POWER_W = 800
_LIMIT_C = 400.0
#: A wall of one track, whose layers are short: it grows hot at its top.
_TALL = _STEEL + _BOX.format("20, 2, 8")
#: No dwell is tried that is longer [s].
_LONGEST_DWELL_S = 120
_LEAST_RISE_K, _TOLERANCE = 50.0, 0.1


def revisit_within(folder: Path) -> dict[str, Any]:
    """The share of places, of all shapes and of each."""
    close: dict[str, np.ndarray] = {}
    for name, text in SHAPES.items():
        part, layers, manifest = _plan(folder / f"{name}.toml", text, "interpass_max_C = 3000")
        at_s, place_mm, found_C = planner_readings(part, layers, manifest)
        fine_C = _fine(part, layers, manifest, at_s, place_mm, share_of_pitch=3)
        rise_K = np.maximum(fine_C - part.substrate.temperature_C, _LEAST_RISE_K)
        close[name] = np.abs(found_C - fine_C) <= _TOLERANCE * rise_K
    return {"revisit_within": round(float(np.concatenate(list(close.values())).mean()), 4),
            **{f"revisit_within_{name}": round(float(one.mean()), 4)
               for name, one in close.items()}}


def interpass_time(folder: Path) -> dict[str, Any]:
    """The ratio of times, and what it is made of."""
    part, layers, manifest = _plan(
        folder / "limited.toml", _TALL, f"interpass_max_C = {_LIMIT_C}")
    ours_s = float(manifest.totals["duration_s"])
    ours_C = _hottest(part, layers, manifest)
    free_part, free, free_manifest = _plan(folder / "free.toml", _TALL, "interpass_max_C = 3000")
    limit_C, free_s = max(_LIMIT_C, ours_C), float(free_manifest.totals["duration_s"])

    def is_cool(dwell_s: int) -> bool:
        return _hottest(free_part, _dwelling(free, dwell_s), free_manifest) <= limit_C

    predicted = manifest.totals["predicted_heat"]
    dwell_s = _least_dwell_s(is_cool, round(max(one["wait_s"] for one in predicted["by_layer"])))
    dwelling_s = free_s + dwell_s * (len(free) - 1)
    return {"interpass_time": round(ours_s / dwelling_s, 3), "interpass_fixed_dwell_s": dwell_s,
            "interpass_fine_C": round(ours_C, 1), "interpass_limit_C": _LIMIT_C,
            "interpass_predicted_C": predicted["interpass_C"]}


def _least_dwell_s(is_cool: Callable[[int], bool], guess_s: int) -> float:
    """The least dwell that keeps the part cool, in whole seconds; infinite where none up to
    `_LONGEST_DWELL_S` does. Longer dwells are cooler: found in few trials near the guess."""
    step, cool, hot = 1, None, -1
    at = guess_s
    while cool is None or cool - hot > 1:
        if is_cool(at):
            cool = at
        else:
            hot = at
        if cool is None:
            if hot >= _LONGEST_DWELL_S:
                return float("inf")
            at, step = min(hot + step, _LONGEST_DWELL_S), 2 * step
        elif hot < 0:
            at, step = max(cool - step, 0), 2 * step
            if cool == 0:
                return 0.0
        else:
            at = (cool + hot) // 2
    return float(cool)


def _plan(file: Path, text: str, process: str) -> tuple[Part, list[JobLayer], JobManifest]:
    file.write_text(f'name = "{file.stem}"\n{text}[process]\npower_W = {_POWER_W}\n{process}\n')
    part, job = load_part(file), file.with_suffix(".lmj")
    plan_job(part, profile(), job)
    with JobReader(job) as reader:
        return part, list(reader.iterate_layers()), reader.manifest


def _dwelling(layers: list[JobLayer], dwell_s: float) -> list[JobLayer]:
    """The same layers, each but the first so much later than the one before."""
    result = []
    for number, layer in enumerate(layers):
        lines = layer.lines.copy()
        lines["end_s"] += number * dwell_s
        result.append(replace(layer, lines=lines, flow_s=layer.flow_s + number * dwell_s))
    return result


def _hottest(part: Part, layers: list[JobLayer], manifest: JobManifest) -> float:
    at_s, place_mm, _ = planner_readings(part, layers, manifest)
    return float(_fine(part, layers, manifest, at_s, place_mm, share_of_pitch=2).max())


def _fine(
    part: Part, layers: list[JobLayer], manifest: JobManifest, at_s: np.ndarray,
    place_mm: np.ndarray, share_of_pitch: int,
) -> np.ndarray:
    """The finer solution at places and times, with cells of such a part of the pitch."""
    heat = part.build_heat
    assert heat is not None
    plate, process = heat.plate, part.process
    constants = FineConstants(
        heat.conductivity_W_mm_K, heat.capacity_J_mm3_K, heat.absorptivity,
        plate.conductivity_W_mm_K, plate.capacity_J_mm3_K, plate.thickness_mm, plate.at_C,
        plate.contact_W_mm2_K, plate.loss_W_mm2_K, plate.ambient_C)
    pitch_mm = process.bead_width_mm * (1 - process.overlap)
    return fine_temperatures(
        beads_of(layers, process.overlap), constants, manifest.totals["layer_height_mm"],
        process.bead_width_mm, at_s, place_mm, pitch_mm / share_of_pitch)
