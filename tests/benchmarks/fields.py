"""Distance fields against their peers: time, error and memory at 256³, as one JSON object.

`python tests/benchmarks/fields.py [--rows NAME ...] [--nodes 256]`; the peers come with
`pip install '.[bench]'`. A ratio is our CPU seconds over the peer's, both of this run, all threads
counted; kernels are compiled (or loaded) before, which is told apart as `kernels_s`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import shapely

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # also without being installed

from lmctl.examples.gear_cloud import bore_outline, gear_outline
from lmctl.field.cloud.cloud_field import cloud_field
from lmctl.field.eikonal import eikonal_distance
from lmctl.field.field import DistanceField, sample_distance
from lmctl.field.grid import Grid
from lmctl.field.mesh.mesh_field import mesh_field
from lmctl.field.primitives import box_distance, sphere_distance
from tests.field.stored_field import stored_field

CUBE_MM = 64.0
THICK_MM = 20.0
CHECKED_NODES = 20_000
REPEATS = 3  # of ours, which are short: the median counts

Mesh = tuple[np.ndarray, np.ndarray]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rows", nargs="+", choices=list(ROWS), default=list(ROWS))
    parser.add_argument("--nodes", type=int, default=256)
    parser.add_argument("--memory-only", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    grid = cube(asked.nodes)
    if asked.memory_only:
        print(peak_of_one_field(grid))
        return
    result: dict[str, Any] = {"nodes": asked.nodes, "kernels_s": cpu_s(warm_up)[0]}
    for row in asked.rows:
        try:
            result |= ROWS[row](grid)
        except ImportError as missing:
            sys.exit(f"error: {missing}\nhint: pip install '.[bench]', or leave out --rows {row}")
    print(json.dumps(result, indent=2))


def mesh_against_open3d(name: str, mesh: Mesh, grid: Grid) -> dict[str, Any]:
    own_s, field = median_cpu_s(lambda: mesh_field(*mesh, grid))
    peer_s, _ = cpu_s(lambda: open3d_distance(mesh, grid))
    rms, wrong = errors_against_libigl(mesh, field)
    return {
        f"mesh_vs_open3d_{name}": round(own_s / peer_s, 4),
        f"mesh_{name}": {
            "triangles": len(mesh[1]), "own_s": own_s, "open3d_s": peer_s,
            "rms_over_pitch": round(rms, 5), "wrong_signs": wrong,
        },
    }


def meshes_against_libigl(grid: Grid) -> dict[str, Any]:
    found = [
        errors_against_libigl(mesh, mesh_field(*mesh, grid)) for mesh in (gear_mesh(), organic())
    ]
    return {
        "mesh_rms_over_pitch": round(max(rms for rms, _ in found), 5),
        "wrong_signs": sum(wrong for _, wrong in found),
    }


def cloud_against_kdtree(grid: Grid) -> dict[str, Any]:
    """200,000 points all over the gear: walls, lids, edges."""
    from scipy.spatial import cKDTree

    points = strewn(gear_mesh(), 200_000, np.random.default_rng(0))
    own_s, field = median_cpu_s(lambda: cloud_field(points, grid))

    def every_node() -> None:
        tree = cKDTree(points)
        for window in grid.slabs(8):
            tree.query(window.node_points())

    peer_s, _ = cpu_s(every_node)
    error = (field.values - gear_distance(grid)).reshape(-1)
    near = np.abs(field.values.reshape(-1)) < grid.pitch_mm
    return {
        "cloud_vs_kdtree": round(own_s / peer_s, 4),
        "cloud_rms_mm": round(max(rms(error), rms(error[near])), 5),
        "cloud": {
            "own_s": own_s, "kdtree_s": peer_s, "rms_everywhere_mm": round(rms(error), 5),
            "rms_within_a_pitch_mm": round(rms(error[near]), 5),
            "worst_mm": round(float(np.abs(error).max()), 4),
        },
    }


def eikonal_against_skfmm(grid: Grid) -> dict[str, Any]:
    """Both of first order."""
    import skfmm

    values = sphere_distance(grid.window().node_points(), [0.3, -0.2, 0.1],
                             20.0).reshape(grid.shape)
    single = values.astype(np.float32)
    own_s, ours = median_cpu_s(lambda: eikonal_distance(single, grid.pitch_mm))
    peer_s, theirs = cpu_s(lambda: skfmm.distance(values, dx=grid.pitch_mm, order=1))
    return {
        "eikonal_vs_skfmm": round(own_s / peer_s, 4),
        "eikonal": {
            "own_s": own_s, "skfmm_s": peer_s,
            "own_rms_mm": round(rms(ours - values), 5),
            "skfmm_rms_mm": round(rms(theirs - values), 5),
        },
    }


def peak_memory(grid: Grid) -> dict[str, Any]:
    """Of a process that does nothing else but read 200k triangles and make their field."""
    command = [sys.executable, __file__, "--memory-only", "--nodes", str(grid.shape[0])]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return {"peak_mb": float(done.stdout)}


def stored_bodies(_: Grid) -> dict[str, Any]:
    """Worst distance read back at the true surface of bodies stored at a coarse pitch [mm]."""
    rng = np.random.default_rng(0)
    ways = rng.normal(size=(20_000, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    ball = stored(lambda p: sphere_distance(p, [0, 0, 0], 20.0), np.full(3, 20.0), 1.0)
    half = np.array([15.0, 11.0, 8.0])
    box = stored(lambda p: box_distance(p, -half, half), half, 1.0)
    share = rng.uniform(-1, 1, (20_000, 3))
    for axis in range(3):  # faces first, then edges, then corners
        rows = np.arange(20_000) % 7
        share[(rows >> axis) & 1 == 0, axis] = np.sign(share[(rows >> axis) & 1 == 0, axis])
    small_at = np.array([18.0, 3.0, -2.0])
    small = stored_field(
        lambda p: sphere_distance(p, small_at, 6.0),
        Grid.enclosing(small_at - 6.0, small_at + 6.0, 0.25),
    )
    both = np.vstack([20.0 * ways, small_at + 6.0 * ways])
    true = np.maximum(
        sphere_distance(both, [0, 0, 0], 20.0), sphere_distance(both, small_at, 6.0)
    )
    union = np.maximum(sample_distance(ball, both),
                       sample_distance(small, both))[np.abs(true) < 1e-9]
    return {
        "stored_sphere_mm": float(np.abs(sample_distance(ball, 20.0 * ways)).max()),
        "stored_box_mm": float(np.abs(sample_distance(box, share * half)).max()),
        "stored_union_mm": float(np.abs(union).max()),
    }


ROWS: dict[str, Callable[[Grid], dict[str, Any]]] = {
    "gear": lambda grid: mesh_against_open3d("gear", gear_mesh(), grid),
    "organic": lambda grid: mesh_against_open3d("organic", organic(), grid),
    "mesh_error": meshes_against_libigl,
    "cloud": cloud_against_kdtree,
    "eikonal": eikonal_against_skfmm,
    "memory": peak_memory,
    "stored": stored_bodies,
}


def cpu_s(work: Callable[[], Any]) -> tuple[float, Any]:
    start = time.process_time()
    done = work()
    return round(time.process_time() - start, 3), done


def median_cpu_s(work: Callable[[], Any]) -> tuple[float, Any]:
    runs = [cpu_s(work) for _ in range(REPEATS)]
    return float(np.median([seconds for seconds, _ in runs])), runs[-1][1]


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def cube(nodes: int) -> Grid:
    half = 0.5 * CUBE_MM
    return Grid((-half, -half, -half), CUBE_MM / (nodes - 1), (nodes, nodes, nodes))


def stored(distance: Callable[[np.ndarray], np.ndarray], reach: np.ndarray,
           pitch: float) -> DistanceField:
    return stored_field(distance, Grid.enclosing(-reach, reach, pitch))


def warm_up() -> None:
    small = cube(48)
    mesh_field(*gear_mesh(), small)
    cloud_field(strewn(gear_mesh(), 20_000, np.random.default_rng(1)), small)
    ball = stored(lambda p: sphere_distance(p, [0, 0, 0], 5.0), np.full(3, 5.0), 1.0)
    sample_distance(ball, np.full((1, 3), 2.8))
    eikonal_distance(ball.values, 1.0)


def gear_mesh() -> Mesh:
    """The example's gear, 20 mm thick around z = 0: about 2.8k triangles."""
    polygon = gear_polygon()
    pieces = shapely.constrained_delaunay_triangles(polygon).geoms
    flat = np.array([
        shapely.get_coordinates(shapely.geometry.polygon.orient(piece))[:3] for piece in pieces
    ])
    lids = [
        np.dstack([flat, np.full(flat.shape[:2], z)])[:, ::way]
        for z, way in ((-0.5 * THICK_MM, -1), (0.5 * THICK_MM, 1))
    ]
    walls = []
    for ring in (polygon.exterior, *polygon.interiors):
        xy = shapely.get_coordinates(ring)
        low, high = (
            np.column_stack([xy, np.full(len(xy), z)]) for z in (-0.5 * THICK_MM, 0.5 * THICK_MM)
        )
        walls.append(np.stack([low[:-1], low[1:], high[1:]], axis=1))
        walls.append(np.stack([low[:-1], high[1:], high[:-1]], axis=1))
    vertices, rows = np.unique(
        np.vstack([*lids, *walls]).reshape(-1, 3), axis=0, return_inverse=True
    )
    return vertices, rows.reshape(-1, 3)


def gear_polygon() -> shapely.Polygon:
    return shapely.geometry.polygon.orient(
        shapely.Polygon(gear_outline(per_flank=7), [bore_outline(100)])
    )


def gear_distance(grid: Grid) -> np.ndarray:
    """Exact distance to the gear's mesh, (nz, ny, nx), positive inside."""
    polygon = gear_polygon()
    yy, xx = np.meshgrid(grid.axis_mm(1), grid.axis_mm(0), indexing="ij")
    boundary = polygon.boundary
    shapely.prepare((polygon, boundary))
    across = shapely.distance(boundary, shapely.points(xx, yy))
    flat = np.where(shapely.contains_xy(polygon, xx, yy), across, -across)
    deep = (0.5 * THICK_MM - np.abs(grid.axis_mm(2)))[:, None, None]
    both = np.minimum(flat, deep)
    return np.where(both > 0, both, -np.hypot(np.minimum(flat, 0), np.minimum(deep, 0)))


def organic() -> Mesh:
    """A UV sphere, displaced, 60 mm across, of about 200k triangles."""
    rings, around = 224, 448
    tilt = np.linspace(0, np.pi, rings + 1)[1:-1, None]
    turn = np.linspace(0, 2 * np.pi, around, endpoint=False)[None]
    body = np.stack(
        [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt) + 0 * turn], axis=2
    )
    ways = np.vstack([[0.0, 0.0, 1.0], body.reshape(-1, 3), [0.0, 0.0, -1.0]])
    x, y, z = ways.T
    bumps = 0.08 * np.sin(15 * x) * np.cos(12 * y) + 0.05 * np.sin(18 * z)
    vertices = ways * (1 + bumps)[:, None]
    first = 1 + around * np.arange(rings - 2)[:, None]
    here, there = np.arange(around)[None], (np.arange(around)[None] + 1) % around
    quads = np.stack(
        [first + here, first + around + here, first + around + there, first + there], axis=2
    ).reshape(-1, 4)
    last = 1 + (rings - 2) * around
    top = np.stack([0 * here, 1 + here, 1 + there], axis=2).reshape(-1, 3)
    bottom = np.stack(
        [0 * here + len(ways) - 1, last + there, last + here], axis=2
    ).reshape(-1, 3)
    triangles = np.vstack([top, bottom, quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return vertices * (30.0 / np.abs(vertices).max()), triangles


def strewn(mesh: Mesh, count: int, rng: np.random.Generator) -> np.ndarray:
    """Points evenly at random over a mesh, without noise."""
    corners = mesh[0][mesh[1]]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    which = rng.choice(len(corners), count, p=area / area.sum())
    return np.einsum("nk,nkc->nc", rng.dirichlet([1.0, 1.0, 1.0], count), corners[which])


def open3d_distance(mesh: Mesh, grid: Grid) -> None:
    import open3d

    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        open3d.core.Tensor(mesh[0].astype(np.float32)),
        open3d.core.Tensor(mesh[1].astype(np.uint32)),
    )
    for window in grid.slabs(1):
        nodes = window.node_points().astype(np.float32)
        scene.compute_signed_distance(open3d.core.Tensor(nodes)).numpy()


def errors_against_libigl(mesh: Mesh, field: DistanceField) -> tuple[float, int]:
    """Of random nodes, rms in pitches and wrong signs, by the pseudonormal distance."""
    import igl

    nodes = np.random.default_rng(0).integers(0, field.grid.shape[0], (CHECKED_NODES, 3))
    points = nodes * field.grid.pitch_mm + np.asarray(field.grid.origin_mm)
    exact = -igl.signed_distance(
        points, mesh[0], mesh[1], sign_type=igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
    )[0]
    got = field.values[nodes[:, 2], nodes[:, 1], nodes[:, 0]]
    reported = np.abs(exact) > 1e-6  # on the surface itself both signs are right
    return rms(got - exact) / field.grid.pitch_mm, int(((got > 0) != (exact > 0))[reported].sum())


def peak_of_one_field(grid: Grid) -> float:
    """In MB. Not from getrusage, which hands a parent's peak on to its children."""
    mesh = organic()
    mesh_field(*mesh, grid)
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return round(int(status.split("VmHWM:")[1].split()[0]) / 1024.0, 1)


if __name__ == "__main__":
    main()
