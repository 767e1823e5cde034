"""A tree of twelve primitives over 1000³ cells: memory and time. Prints one JSON object.

    python tests/benchmarks/tree_memory.py [--planes N]

--planes : planes to evaluate, in slabs of eight spread evenly over the grid; all by default. Memory
    does not depend on it (each slab is dropped before the next); `full_cpu_s` is scaled to all.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from lmctl.part.load import load_part

SIDE_MM = 100.0
CELLS = 1000
SLAB_PLANES = 8


def part_text() -> str:
    """A block with pins, holes, a ring and a rounded end: twelve primitives, three booleans."""
    bodies = [
        'name = "block"\nkind = "box"\nlow_mm = [0.1, 0.1, 10]\nhigh_mm = [99.9, 99.9, 60]',
        'name = "dome"\nkind = "sphere"\ncentre_mm = [50, 50, 60]\nradius_mm = 30',
        'name = "ring"\nkind = "torus"\ncentre_mm = [50, 50, 60]\nradius_mm = 36\n'
        "tube_radius_mm = 6",
        'name = "horn"\nkind = "cone"\nbase_mm = [50, 50, 80]\ntop_mm = [50, 50, 99]\n'
        "base_radius_mm = 12\ntop_radius_mm = 3",
    ]
    pins = [(20, 20), (80, 20), (20, 80), (80, 80)]
    bodies += [f'name = "pin {n}"\nkind = "cylinder"\nbase_mm = [{x}, {y}, -1.4]\n'
               f"top_mm = [{x}, {y}, 40]\nradius_mm = 6" for n, (x, y) in enumerate(pins)]
    holes = [(50, 30), (30, 50), (70, 50)]
    bodies += [f'name = "hole {n}"\nkind = "cylinder"\nbase_mm = [{x}, {y}, 0]\n'
               f"top_mm = [{x}, {y}, 100]\nradius_mm = 5" for n, (x, y) in enumerate(holes)]
    bodies += ['name = "below"\nkind = "half-space"\npoint_mm = [0, 0, 98]\noutward = [0, 0, 1]']
    solid = '["block", "dome", "ring", "horn", "pin 0", "pin 1", "pin 2", "pin 3"]'
    bodies += [
        f'name = "solid"\nkind = "union"\nof = {solid}',
        'name = "drilled"\nkind = "difference"\nof = ["solid", "hole 0", "hole 1", "hole 2"]',
        'kind = "intersection"\nof = ["drilled", "below"]',
    ]
    head = f'name = "twelve"\npitch_mm = {SIDE_MM / CELLS}\n[[material]]\nname = "316L"\n'
    return head + "".join(f"[[body]]\n{body}\n" for body in bodies)


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--planes", type=int)
    planes = parser.parse_args(arguments).planes
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "twelve.toml"
        path.write_text(part_text(), encoding="utf-8")
        start = time.process_time()
        part = load_part(path)
        load_s = time.process_time() - start
    loaded_mb = peak_mb()
    start = time.process_time()
    slabs = part.grid.slabs(SLAB_PLANES)
    count = len(slabs) if planes is None else -(-planes // SLAB_PLANES)
    chosen = np.unique(np.linspace(0, len(slabs) - 1, count).astype(int))
    done, deepest = 0, -np.inf
    for number in chosen:
        values = part.distance(slabs[number])
        done += len(values)
        deepest = max(deepest, float(values.max()))
    cpu_s = time.process_time() - start
    print(json.dumps({
        "nodes": part.grid.n_nodes,
        "planes": done,
        "load_cpu_s": round(load_s, 2),
        "cpu_s": round(cpu_s, 2),
        "full_cpu_s": round(cpu_s * part.grid.shape[0] / done, 1),
        "deepest_mm": round(deepest, 3),
        "loaded_mb": round(loaded_mb, 1),
        "peak_mb": round(peak_mb(), 1),
    }))


if __name__ == "__main__":
    main(sys.argv[1:])
