"""Why meshes are cut from their triangles: time and error of sixty slices, as one JSON object.

`python tests/benchmarks/slicing.py`; CPU seconds. manifold3d is measured where it is installed.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh

from lmctl.field.field import sample_distance
from lmctl.field.grid import Grid
from lmctl.field.mesh.mesh_field import mesh_field
from lmctl.field.plane import PlaneGrid, section_loops
from lmctl.part.bodies.body import plane_points
from lmctl.part.bodies.mesh_solid import MeshSolid
from lmctl.part.sources.mesh_files import Mesh
from lmctl.part.sources.slicing import MeshSlicer

RADIUS_MM = 30.0
HEIGHTS_MM = np.linspace(-0.95, 0.95, 60) * RADIUS_MM


def cpu_s(work: Callable[[], object]) -> float:
    start = time.process_time()
    work()
    return round(time.process_time() - start, 3)


def main() -> None:
    ball = trimesh.creation.icosphere(7, RADIUS_MM)
    vertices, triangles = np.asarray(ball.vertices), np.asarray(ball.faces, dtype=np.int64)
    slicer = MeshSlicer(vertices, triangles)
    result: dict[str, Any] = {
        "triangles": len(triangles),
        "own_s": cpu_s(lambda: [slicer.loops(float(z)) for z in HEIGHTS_MM]),
        "trimesh_s": cpu_s(
            lambda: ball.section_multiplane([0, 0, 0], [0, 0, 1], HEIGHTS_MM)
        ),
    }
    try:
        import manifold3d
    except ImportError:
        result["manifold3d_s"] = None
    else:
        solid = manifold3d.Manifold(manifold3d.Mesh(
            vert_properties=vertices.astype(np.float32), tri_verts=triangles.astype(np.uint32),
        ))
        result["manifold3d_s"] = cpu_s(
            lambda: [solid.slice(float(z)).to_polygons() for z in HEIGHTS_MM]
        )
    result |= corner_errors()
    print(json.dumps(result, indent=2))


def corner_errors() -> dict[str, float]:
    """How far the outline of a box's section stays from its true corners [mm], pitch 0.25."""
    box = trimesh.creation.box((20.3, 15.1, 10.0))
    mesh = Mesh(np.asarray(box.vertices), np.asarray(box.faces, dtype=np.int64))
    solid = MeshSolid(mesh, Grid.enclosing(box.bounds[0], box.bounds[1], 0.25))
    plane = PlaneGrid((-12.0, -10.0), 0.25, (81, 97))
    corners = np.array([(x, y) for x in (-10.15, 10.15) for y in (-7.55, 7.55)])

    def miss(loops: list[Any]) -> float:
        outline = np.vstack(loops)
        return round(max(float(np.hypot(*(outline - c).T).min()) for c in corners), 6)

    field = mesh_field(mesh.vertices, mesh.triangles, solid.grid)
    values = sample_distance(field, plane_points(plane, 1.0)).astype(np.float32)
    values = values.reshape(plane.shape)
    return {
        "corner_miss_of_triangles_mm": miss(solid.outline_loops(1.0, plane)),
        "corner_miss_of_stored_field_mm": miss(section_loops(values, plane)),
    }


if __name__ == "__main__":
    main()
