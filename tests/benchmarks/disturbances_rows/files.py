"""Mesh files to depths and outlines.

- `mesh_distance_worst_mm`: largest error of `Body.at` and `Body.distance` over random meshes read
  from STL files at a pitch of 0.5 mm, beside the surface, within, and up to two sizes away, against
  libigl's distances (its signs by winding numbers).
- `wrong_signs`: places whose side is wrong, among those farther from the surface than 1 µm.
- `shell_area_error`: largest relative error of the area of the sections of shells from a fifth of
  the raster's pitch to two pitches thick, of a ball, a tube, and a mesh of a block.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import igl
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))  # also without being installed

from lmctl.field.plane import loop_area_mm2
from lmctl.field.surface_files import surface_bytes
from lmctl.part.load import load_part
from lmctl.part.part import Part
from tests.field.random_meshes import random_mesh

MESHES = 200
PLACES = 500  # of each kind
PITCH_MM = 0.5
LEAST_DEPTH_MM = 1e-3  # nearer to the surface both signs are right
AGAIN = "python tests/benchmarks/disturbances_rows/files.py {seed}"

HEAD = 'name = "p"\n{keys}[[material]]\nname = "316L"\n'
MESH = '[[body]]\nname = "m"\nkind = "mesh"\nfile = "m.stl"\nunits = "mm"\n'


def rows() -> dict[str, float | int]:
    worst, wrong = 0.0, 0
    for seed in range(MESHES):
        error, bad = distances(seed)
        if error > 0.02 or bad:
            print(f"seed {seed}: {error:.3g} mm, {bad} wrong signs; {AGAIN.format(seed=seed)}",
                  file=sys.stderr)
        worst, wrong = max(worst, error), wrong + bad
    return {
        "mesh_distance_worst_mm": worst, "wrong_signs": wrong,
        "shell_area_error": shell_area_error(),
    }


def distances(seed: int) -> tuple[float, int]:
    """The largest error [mm] and the wrong signs of one random mesh."""
    rng = np.random.default_rng(seed)
    vertices, triangles = random_mesh(rng)
    vertices = vertices.astype(np.float32).astype(np.float64)  # as the file holds them
    part = part_of(HEAD.format(keys=f"pitch_mm = {PITCH_MM}\n") + MESH, vertices, triangles)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    on_it = np.einsum("nk,nkc->nc", rng.dirichlet([1.0, 1.0, 1.0], PLACES),
                      vertices[triangles[rng.integers(len(triangles), size=PLACES)]])
    near = on_it + rng.normal(size=(PLACES, 3)) * rng.choice([0.01, 0.2, 1.0], (PLACES, 1))
    far = rng.uniform(low - 2 * (high - low), high + 2 * (high - low), (PLACES, 3))
    window = part.grid.window(first := int(rng.integers(part.grid.shape[0])), first + 1)
    nodes = rng.integers(len(window.node_points()), size=PLACES)
    points = np.vstack([near, far, rng.uniform(low, high, (PLACES, 3)),
                        window.node_points()[nodes]])
    got = part.body.distance_at(points)
    stored = part.distance(window).reshape(-1)[nodes].astype(np.float64)
    got[-PLACES:] = np.where(np.abs(stored - got[-PLACES:]) > 1e-3, stored, got[-PLACES:])
    squared = igl.point_mesh_squared_distance(points, vertices, triangles)[0]
    true = np.sqrt(squared) * np.where(
        igl.fast_winding_number(vertices, triangles, points) > 0.5, 1.0, -1.0)
    doubtful = np.flatnonzero((got > 0) != (true > 0))  # the fast ones are approximate
    exact = igl.winding_number(vertices, triangles, points[doubtful]) if len(doubtful) else []
    true[doubtful] = np.abs(true[doubtful]) * np.where(np.asarray(exact) > 0.5, 1.0, -1.0)
    clear = np.abs(true) > LEAST_DEPTH_MM
    bad = int(((got > 0) != (true > 0))[clear].sum())
    return float(np.abs(np.abs(got) - np.abs(true)).max()), bad


def shell_area_error() -> float:
    """The largest relative error of sections of thin shells."""
    worst = 0.0
    for thick in (0.05, 0.1, 0.25, 0.5):
        head = HEAD.format(keys="")
        shell = f'[[body]]\nkind = "shell"\nof = "m"\nto_mm = {thick}\n'
        ball = '[[body]]\nname = "m"\nkind = "sphere"\ncentre_mm = [0.1, 0.2, 0.3]\nradius_mm = 9\n'
        tube = ('[[body]]\nname = "m"\nkind = "cylinder"\nbase_mm = [0, 0, -20]\n'
                "top_mm = [0, 0, 20]\nradius_mm = 7.3\n")
        for z in (0.37, 2.9):
            r2 = 81.0 - (z - 0.3) ** 2
            true = np.pi * (r2 - ((9.0 - thick) ** 2 - (z - 0.3) ** 2))
            worst = max(worst, abs(area(part_of(head + ball + shell), z) / true - 1))
            true = np.pi * (7.3**2 - (7.3 - thick) ** 2)
            worst = max(worst, abs(area(part_of(head + tube + shell), z) / true - 1))
        block = np.array([(x, y, z) for x in (0.0, 17.0) for y in (0.0, 12.0) for z in (0.0, 9.0)])
        quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
        part = part_of(head + MESH + shell, block, faces)
        true = 17.0 * 12.0 - (17.0 - 2 * thick) * (12.0 - 2 * thick)
        worst = max(worst, abs(area(part, 4.1) / true - 1))
    return float(worst)


def area(part: Part, z_mm: float) -> float:
    return sum(loop_area_mm2(loop) for loop in part.section(z_mm).loops)


def part_of(
    text: str, vertices: np.ndarray | None = None, triangles: np.ndarray | None = None
) -> Part:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if vertices is not None and triangles is not None:
            (folder / "m.stl").write_bytes(surface_bytes("stl", vertices, triangles))
        (folder / "part.toml").write_text(text, encoding="utf-8")
        return load_part(folder / "part.toml")


if __name__ == "__main__":
    print(distances(int(sys.argv[1])) if len(sys.argv) > 1 else rows())
