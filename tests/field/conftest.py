"""Bodies whose distance is known exactly, as meshes and as clouds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import shapely

from lmctl.field.grid import Grid


@dataclass(frozen=True)
class Prism:
    """A polygon with holes, extruded from z = 0 to its height; its distance is exact."""

    polygon: shapely.Polygon
    height_mm: float

    def area_mm2(self) -> float:
        return float(2 * self.polygon.area + self.polygon.length * self.height_mm)

    def distance(self, grid: Grid) -> np.ndarray:
        """At the nodes of a grid, in order, positive inside: (n,)."""
        yy, xx = np.meshgrid(grid.axis_mm(1), grid.axis_mm(0), indexing="ij")
        across = shapely.distance(shapely.points(xx, yy), self.polygon.boundary)
        flat = np.where(shapely.contains_xy(self.polygon, xx, yy), across, -across)
        deep = np.minimum(grid.axis_mm(2), self.height_mm - grid.axis_mm(2))[:, None, None]
        both = np.minimum(flat, deep)
        beyond = -np.hypot(np.minimum(flat, 0), np.minimum(deep, 0))
        return np.where(both > 0, both, beyond).reshape(-1)

    def cloud(self, count: int, noise_mm: float, rng: np.random.Generator) -> np.ndarray:
        """Points strewn evenly over the whole surface, with noise along every axis."""
        lids = self.polygon.area / self.area_mm2()
        bottom, top, wall = rng.multinomial(count, [lids, lids, 1 - 2 * lids])
        parts = []
        for number, z in ((bottom, 0.0), (top, self.height_mm)):
            low, high = np.reshape(self.polygon.bounds, (2, 2))
            xy = rng.uniform(low, high, (6 * number, 2))
            xy = xy[shapely.contains_xy(self.polygon, xy[:, 0], xy[:, 1])][:number]
            parts.append(np.column_stack([xy, np.full(len(xy), z)]))
        rings = [self.polygon.exterior, *self.polygon.interiors]
        along = rng.uniform(0, self.polygon.length, wall)
        for ring in rings:
            mine = along[(along >= 0) & (along < ring.length)]
            xy = shapely.get_coordinates(shapely.line_interpolate_point(ring, mine))
            parts.append(np.column_stack([xy, rng.uniform(0, self.height_mm, len(xy))]))
            along = along - ring.length
        points = np.vstack(parts)
        return points + rng.normal(0, noise_mm, points.shape) if noise_mm else points


def gear_polygon(
    teeth: int = 20, outer: float = 30.0, root: float = 24.5, bore: float = 8.0
) -> shapely.Polygon:
    """A spur gear's outline: convex flanks, straight lands, a round bore."""
    pitch = 2 * np.pi / teeth
    rise = np.linspace(0.0, 1.0, 9)
    half = 0.5 * pitch * (0.62 + (0.28 - 0.62) * rise**1.5)
    radius = root + (outer - root) * rise
    tooth = np.concatenate([
        [[root, -pitch / 2]], np.column_stack([radius, -half]), [[outer, 0.0]],
        np.column_stack([radius, half])[::-1],
    ])
    polar = np.concatenate([tooth + np.array([0.0, n * pitch]) for n in range(teeth)])
    turn = np.linspace(0, 2 * np.pi, 128, endpoint=False)
    return shapely.Polygon(
        polar[:, :1] * np.column_stack([np.cos(polar[:, 1]), np.sin(polar[:, 1])]),
        [bore * np.column_stack([np.cos(turn), np.sin(turn)])],
    )


@pytest.fixture(scope="session")
def gear() -> Prism:
    return Prism(gear_polygon(), 20.0)


@pytest.fixture(scope="session")
def sphere_cloud() -> Callable[..., np.ndarray]:
    def points(count: int, radius: float, seed: int = 0) -> np.ndarray:
        directions = np.random.default_rng(seed).normal(size=(count, 3))
        return radius * directions / np.linalg.norm(directions, axis=1)[:, None]

    return points


@pytest.fixture(scope="session")
def sphere_mesh() -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    """A UV sphere, closed, wound outwards: vertices, triangles."""

    def build(radius: float, around: int = 96) -> tuple[np.ndarray, np.ndarray]:
        rings = around // 2
        lat = np.linspace(0, np.pi, rings + 1)[1:-1]
        lon = np.linspace(0, 2 * np.pi, around, endpoint=False)
        body = np.stack(
            [np.outer(np.sin(lat), np.cos(lon)), np.outer(np.sin(lat), np.sin(lon)),
             np.outer(np.cos(lat), np.ones(around))], axis=2,
        ).reshape(-1, 3)
        vertices = radius * np.vstack([[0.0, 0.0, 1.0], body, [0.0, 0.0, -1.0]])
        faces = []
        for i in range(around):
            j = (i + 1) % around
            faces.append([0, 1 + i, 1 + j])
            last = 1 + (rings - 2) * around
            faces.append([len(vertices) - 1, last + j, last + i])
            for r in range(rings - 2):
                a, b = 1 + r * around, 1 + (r + 1) * around
                faces += [[a + i, b + i, b + j], [a + i, b + j, a + j]]
        return vertices, np.array(faces)

    return build


@pytest.fixture(scope="session")
def box_mesh() -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    """Twelve triangles between two corners, wound outwards."""

    def build(low: list[float], high: list[float]) -> tuple[np.ndarray, np.ndarray]:
        corners = np.array([[(low, high)[bit][axis] for axis, bit in enumerate(bits)]
                            for bits in np.ndindex(2, 2, 2)], dtype=float)
        quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        return corners, np.array([t for a, b, c, d in quads for t in ([a, b, c], [a, c, d])])

    return build
