"""Parts of the planning benchmark, written as STL and part files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely
import trimesh
from shapely.affinity import rotate
from shapely.geometry import LineString, Point, Polygon, box
from shapely.ops import unary_union

THICK_MM = 4.0

#: Two materials graded by the distance to an axis along z.
GRADED = """
name = "{name}"
[[material]]
name = "316L"
[[material]]
name = "WC-12Co"
[[body]]
kind = "mesh"
file = "{name}.stl"
units = "mm"
[composition]
feature = {{ kind = "axis", point_mm = [{x:g}, {y:g}, 0], direction = [0, 0, 1] }}
[composition.profile]
kind = "table"
points = [
  {{ at_mm = 8,  of = {{ "316L" = 0.9, "WC-12Co" = 0.1 }} }},
  {{ at_mm = 30, of = {{ "316L" = 0.2, "WC-12Co" = 0.8 }} }},
]
[process]
bead_width_mm = {bead:g}
overlap = {overlap:.8g}
layer_height_mm = {layer:g}
"""


def write_graded(folder: Path, name: str, mesh: trimesh.Trimesh, bead_mm: float, overlap: float,
                 layer_mm: float) -> Path:
    """An STL and a part file beside it; returns the part file."""
    mesh.apply_translation(-mesh.bounds[0])
    mesh.export(folder / f"{name}.stl")
    x, y, _ = mesh.bounds.mean(axis=0)
    file = folder / f"{name}.toml"
    file.write_text(GRADED.format(
        name=name, x=x, y=y, bead=bead_mm, overlap=overlap, layer=layer_mm))
    return file


def prism(shape: shapely.Geometry, height_mm: float) -> trimesh.Trimesh:
    """A shape of the plane, with thickness, from z = 0."""
    soup = []
    for piece in getattr(shape, "geoms", [shape]):
        piece = shapely.geometry.polygon.orient(piece)  # the inside on the left
        flat = np.array([
            shapely.get_coordinates(shapely.geometry.polygon.orient(triangle))[:3]
            for triangle in shapely.constrained_delaunay_triangles(piece).geoms])
        for z, way in ((0.0, -1), (height_mm, 1)):
            soup.append(np.dstack([flat, np.full(flat.shape[:2], z)])[:, ::way])
        for edge in (piece.exterior, *piece.interiors):
            xy = shapely.get_coordinates(edge)
            low, high = (np.column_stack([xy, np.full(len(xy), z)]) for z in (0.0, height_mm))
            soup.append(np.stack([low[:-1], low[1:], high[1:]], axis=1))
            soup.append(np.stack([low[:-1], high[1:], high[:-1]], axis=1))
    return trimesh.Trimesh(**trimesh.triangles.to_kwargs(np.vstack(soup)))


def ring(height_mm: float) -> trimesh.Trimesh:
    """A tube, for parts of many layers."""
    circle = Point(0, 0)
    return prism(circle.buffer(12, quad_segs=16) - circle.buffer(7, quad_segs=16), height_mm)


def write_six(folder: Path) -> dict[str, Path]:
    """The six shapes: gear, star with thin points, plate with 50 holes, wall of 1.5 beads,
    text-like strokes, wedge from 10 beads to nothing (beads of 2 mm)."""
    found = {}
    for make in (_gear, _star, _plate50, _wall, _letters, _wedge):
        name = make.__name__.removeprefix("_")
        found[name] = folder / f"{name}.stl"
        mesh = prism(make(), THICK_MM)
        mesh.apply_translation(-mesh.bounds[0])
        mesh.export(found[name])
    return found


def _gear() -> shapely.Geometry:
    flank = ((24.5, -0.105), (30.0, -0.048), (30.0, 0.048), (24.5, 0.105))
    corners = [(radius * np.cos(tooth + off), radius * np.sin(tooth + off))
               for tooth in np.arange(20) * 2 * np.pi / 20 for radius, off in flank]
    return Polygon(corners) - Point(0, 0).buffer(8.0, quad_segs=32)


def _star() -> shapely.Geometry:
    base = 30.0 * np.tan(np.radians(10))
    point = Polygon([(0, -base), (30.0, 0), (0, base)])
    points = [rotate(point, 40 * k, origin=(0, 0)) for k in range(9)]
    return unary_union([*points, Point(0, 0).buffer(9.0)])


def _plate50() -> shapely.Geometry:
    holes = [Point(8 + 7.1 * i, 6 + 9 * j).buffer(2.0, quad_segs=16)
             for i in range(10) for j in range(5)]
    return box(0, 0, 80, 48) - unary_union(holes)


def _wall() -> shapely.Geometry:
    return box(0, 0, 40, 30) - box(3, 3, 37, 27)


def _letters() -> shapely.Geometry:
    strokes = [
        ([(0, 0), (0, 24)], 4.0), ([(0, 24), (14, 24)], 3.0), ([(0, 12), (10, 12)], 3.0),
        ([(0, 0), (14, 0)], 5.0), ([(22, 0), (30, 24), (38, 0)], 4.0), ([(25, 9), (35, 9)], 3.0),
        ([(46, 0), (46, 24), (58, 20), (46, 12), (60, 0)], 3.5),
    ]
    return unary_union([LineString(line).buffer(width / 2, quad_segs=8) for line, width in strokes])


def _wedge() -> shapely.Geometry:
    return Polygon([(0, -10), (60, 0), (0, 10)])
