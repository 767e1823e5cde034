"""Signs of noisy clouds: scans of the example's gear, other seeds each, as one JSON object.

`python tests/benchmarks/cloud_signs.py [--seeds N] [--first N] [--points N] [--noise MM]
[--pitch MM] [--thick MM]`; a node counts as wrong when its sign is, farther from the true surface
than 1.5 times the samples' spacing √(area / number).
"""

from __future__ import annotations

import argparse
import json
import time
from unittest import mock

import numpy as np
import shapely

from lmctl.examples import gear_cloud
from lmctl.field.cloud.cloud_field import cloud_field
from lmctl.field.grid import Grid


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--points", type=int, default=20_000)
    parser.add_argument("--noise", type=float, default=0.02)
    parser.add_argument("--pitch", type=float, default=0.25)
    parser.add_argument("--thick", type=float, default=gear_cloud.THICKNESS_MM)
    asked = parser.parse_args()
    outline = shapely.Polygon(gear_cloud.gear_outline(), [gear_cloud.bore_outline()])
    area = 2 * outline.area + outline.length * asked.thick
    spacing = float(np.sqrt(area / asked.points))
    wrong, deepest, rms, cpu = [], [], [], []
    for seed in range(asked.first, asked.first + asked.seeds):
        with mock.patch.object(gear_cloud, "THICKNESS_MM", asked.thick):
            points = gear_cloud.gear_cloud(asked.points, asked.noise, seed)
        grid = Grid.enclosing(points.min(axis=0), points.max(axis=0), asked.pitch)
        start = time.process_time()
        values = cloud_field(points, grid).values
        cpu.append(time.process_time() - start)
        true = true_distance(outline, asked.thick, grid)
        off = (values > 0) != (true > 0)
        depth = np.where(off, np.abs(true), 0.0)
        wrong.append(int((depth > 1.5 * spacing).sum()))
        deepest.append(float(depth.max()))
        near = np.abs(true) < asked.pitch
        rms.append(float(np.sqrt(np.mean((values - true)[near] ** 2))))
    print(json.dumps({
        "points": asked.points, "noise_mm": asked.noise, "pitch_mm": asked.pitch,
        "thick_mm": asked.thick, "spacing_mm": round(spacing, 4),
        "first_seed": asked.first, "wrong_nodes": wrong, "wrong_in_all": sum(wrong),
        "deepest_wrong_mm": [round(d, 3) for d in deepest],
        "deepest_wrong_spacings": round(max(deepest) / spacing, 3),
        "rms_near_surface_mm": round(float(np.mean(rms)), 4),
        "cpu_s_each": round(float(np.median(cpu)), 2),
    }, indent=2))


def true_distance(
    outline: shapely.Polygon, thick_mm: float, grid: Grid
) -> np.ndarray:
    """Signed distance to the upright prism, (nz, ny, nx), positive inside."""
    yy, xx = np.meshgrid(grid.axis_mm(1), grid.axis_mm(0), indexing="ij")
    shapely.prepare(outline)
    boundary = outline.boundary
    shapely.prepare(boundary)
    across = shapely.distance(shapely.points(xx, yy), boundary)
    flat = np.where(shapely.contains_xy(outline, xx, yy), across, -across)
    deep = np.minimum(grid.axis_mm(2), thick_mm - grid.axis_mm(2))[:, None, None]
    both = np.minimum(flat, deep)
    beyond = -np.hypot(np.minimum(flat, 0), np.minimum(deep, 0))
    return np.where(both > 0, both, beyond)


if __name__ == "__main__":
    main()
