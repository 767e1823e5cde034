"""Volume rows: what strips fill of six shapes and of walls, how many starts, what is lost.

Shapes are those of the planning benchmark: 2 mm beads, overlap 0.333, layers of 0.8 mm. `uncovered`
counts as covered what lies within half a bead of a track; `built` and `double` are deposited volume
over tiles of two beads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely.affinity import rotate
from shapely.geometry import Point, Polygon, box
from shapely.ops import unary_union

import lmctl.examples
from lmctl.array_types import FloatArray
from lmctl.config.machine import load_profile
from lmctl.config.part_file import ProcessSettings
from lmctl.part.sources.slicing import MeshSlicer
from lmctl.plan.completeness import Completeness
from lmctl.plan.geometry import LayerGeometry, layer_geometry
from lmctl.plan.geometry.section_raster import section_raster
from lmctl.preflight.placement import Placement, place_part

Outline = Callable[[float], list[FloatArray]]

BEAD_MM = 2.0
PITCH_MM = BEAD_MM * (1 - 0.333)
PLATES = 50


@dataclass(frozen=True)
class Section:
    loops: list[FloatArray]
    z_mm: float


@dataclass(frozen=True)
class Prismatic:
    """What the geometry stage asks of a part, for outlines by height."""

    outline: Outline
    height_mm: float
    turning: tuple[float, ...] = ()
    process: ProcessSettings = field(default_factory=ProcessSettings)
    placement_mm: None = None
    layer_stack: None = None
    copies: tuple[()] = ()
    alloy_rules: None = None
    name: str = "benchmark"
    materials: tuple[str, ...] = ("one",)

    @property
    def turning_heights_mm(self) -> FloatArray:
        return np.array(self.turning)

    @property
    def bounds_mm(self) -> tuple[FloatArray, FloatArray]:
        points = np.vstack([loop for z in np.linspace(1e-6, self.height_mm * 0.999, 9)
                            for loop in self.outline(z)])
        return (np.array([*points.min(axis=0), 0.0]),
                np.array([*points.max(axis=0), self.height_mm]))

    def section(self, z_mm: float) -> Section:
        return Section(self.outline(z_mm) if 0 <= z_mm < self.height_mm else [], z_mm)

    def composition(self, points_mm: FloatArray) -> FloatArray:
        return np.ones((len(points_mm), 1))


def volume_rows(stl_files: dict[str, Path]) -> dict[str, Any]:
    """The rows of volume and completeness. stl_files : by name, prisms along z."""
    built, surplus, double, uncovered, starts = {}, {}, {}, {}, {}
    for name, file in stl_files.items():
        outline, height = _prism(file)
        layers, _ = _layers(Prismatic(lambda z, loops=outline: loops, height))
        slices = sum(g.figures.slice_mm2 for g in layers)
        built[name] = round(sum(g.figures.inside_mm2 for g in layers) / slices, 4)
        surplus[name] = round(sum(g.figures.outside_mm2 for g in layers) / slices, 4)
        double[name] = round(sum(g.figures.double_mm2 for g in layers) / slices, 4)
        uncovered[name] = round(float(np.mean([_uncovered(g) for g in layers])), 4)
        starts[name] = sum(g.n_tracks for g in layers)
    walls = [_wall(beads) for beads in np.arange(1.0, 8.0 + 1e-9, 0.05)]
    return {
        "built_over_design": built, "surplus": surplus, "double": double, "uncovered": uncovered,
        "starts": starts,
        "walls_worst_volume_error": round(max(error for error, _, _ in walls), 4),
        "walls_worst_tile": [round(min(low for _, low, _ in walls), 3),
                             round(max(high for _, _, high in walls), 3)],
        "lost_features_named": sum(_all_named(seed) for seed in range(PLATES)),
    }


def _profile() -> Any:
    return load_profile(Path(lmctl.examples.__file__).parent / "cell.toml")


def _prism(file: Path) -> tuple[list[FloatArray], float]:
    import trimesh

    mesh = trimesh.load(file)
    low, high = mesh.bounds[:, 2]
    slicer = MeshSlicer(np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64))
    return slicer.loops((low + high) / 2), float(high - low)


def _layers(part: Any) -> tuple[list[LayerGeometry], Placement]:
    placement = place_part(part, _profile())
    return [layer_geometry(part, placement, k) for k in range(placement.n_layers)], placement


def _uncovered(geometry: LayerGeometry) -> float:
    """Part of the slice farther than half a bead from every track."""
    raster = section_raster(geometry.loops(), BEAD_MM / 8)
    j, i = np.nonzero(raster.depth_mm > 0)
    nodes = np.stack([raster.grid.x_mm[i], raster.grid.y_mm[j]], axis=1)
    gap, _ = cKDTree(geometry.points_mm).query(nodes)
    return float((gap > BEAD_MM / 2 + 0.005).mean())


def _wall(beads: float) -> tuple[float, float, float]:
    """Volume error of a wall 60 mm long, and the least and most filled tile of its core."""
    width = beads * BEAD_MM
    (geometry,), _ = _layers(Prismatic(lambda z: _loops(box(0, 0, 60, width)), 0.8))
    error = abs(geometry.figures.strip_mm2 / (60 * width) - 1)
    tiles = _tiles(geometry, width)
    return error, float(tiles.min()), float(tiles.max())


def _tiles(geometry: LayerGeometry, width_mm: float) -> FloatArray:
    """Filling of stretches of two beads along the wall, its ends left out."""
    edges = np.arange(6.0, 54.0 + 1e-9, 2 * BEAD_MM)
    volume = np.zeros(len(edges) - 1)
    for k in range(geometry.n_tracks):
        at = geometry.track(k)
        points, strip = geometry.points_mm[at], geometry.strip_width_mm[at]
        step = np.linalg.norm(np.diff(points, axis=0), axis=1) * (strip[1:] + strip[:-1]) / 2
        volume += np.histogram((points[1:, 0] + points[:-1, 0]) / 2, edges, weights=step)[0]
    return np.asarray(volume / (2 * BEAD_MM * width_mm))


def _loops(poly: Any) -> list[FloatArray]:
    loops = []
    for piece in shapely.get_parts(poly):
        whole = shapely.orient_polygons(piece)
        loops += [np.array(ring.coords) for ring in (whole.exterior, *whole.interiors)]
    return loops


def _all_named(seed: int) -> int:
    """1 where every thin thing on a random plate has a track along it or is listed."""
    rng = np.random.default_rng(seed)
    plate = box(0, 0, 40, 30)
    height = 4.0
    things: list[tuple[Any, float, float]] = []
    for k in range(6):
        width = float(rng.uniform(0.05, 1.2)) * BEAD_MM
        low = float(rng.choice([0.0, rng.uniform(0.2, 2.0)]))
        high = float(rng.choice([height, low + rng.uniform(0.2, 1.5)]))
        kind = ("rib", "pin", "island", "cap")[k % 4]
        x = 3 + 6 * k
        if kind == "rib":
            shape = box(x, 30, x + width, 30 + rng.uniform(4, 12))
        elif kind == "pin":
            shape = Point(x, -4).buffer(width / 2)
        elif kind == "island":
            shape = rotate(box(x, -12, x + rng.uniform(1, 3) * width, -12 + width), 30)
        else:  # a cap on top of the plate, of its own layers
            shape, low, high = Point(x, 12).buffer(width / 2), height, height + rng.uniform(0.2, 3)
        things.append((shape, low, float(high)))
    tall = max(high for _, _, high in things)

    def outline(z: float) -> list[FloatArray]:
        here = [shape for shape, low, high in things if low <= z < high]
        return _loops(unary_union([*([plate] if z < height else []), *here]))

    turning = sorted({0.0, height, *(z for _, low, high in things for z in (low, high))})
    part = Prismatic(outline, tall, tuple(turning))
    layers, placement = _layers(part)
    found = Completeness(part.process, placement.layer_height_mm)
    for geometry in layers:
        found.add_layer(geometry)
    return int(all(_is_named(thing, layers, found, plate if thing[1] < height else None)
                   for thing in things))


def _covered(shape: Any, points_mm: FloatArray) -> float:
    """Part of a shape within half a bead of a track."""
    low_x, low_y, high_x, high_y = shape.bounds
    x, y = np.meshgrid(np.linspace(low_x, high_x, 25), np.linspace(low_y, high_y, 25))
    inside = shapely.contains_xy(shape, x.ravel(), y.ravel())
    places = np.stack([x.ravel(), y.ravel()], axis=1)[inside]
    gap, _ = cKDTree(points_mm).query(places)
    return float((gap <= BEAD_MM / 2 + 0.005).mean())


def _is_named(
    thing: tuple[Any, float, float], layers: list[LayerGeometry], found: Completeness,
    plate: Polygon | None,
) -> bool:
    shape, low, high = thing
    centre = np.array(shape.centroid.coords[0])
    listed = [piece for piece in found.lost
              if np.hypot(*(centre - np.array(piece.feature.at_mm))) <= BEAD_MM]
    for geometry in layers:
        half = found.layer_height_mm / 2
        if min(high, geometry.z_mm + half) - max(low, geometry.z_mm - half) < 0.5 * 2 * half:
            continue  # less than half of this layer
        covered = geometry.n_tracks > 0 and _covered(shape, geometry.points_mm) >= 0.5
        if not covered and not any(
                piece.first_layer <= geometry.layer <= piece.last_layer for piece in listed):
            return False
    seen = any(low <= geometry.z_mm < high for geometry in layers)
    hidden = plate is None  # a cap too flat for a layer of its own lies in the plate's top layer
    return seen or bool(listed) or hidden
