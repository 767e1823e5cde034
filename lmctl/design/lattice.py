"""Background lattices of triangles and tetrahedra, from which a mesh is cut.

Squares or cubes with a node in the middle: four triangles a square, and the body-centred cubic
tetrahedra between the middles of neighbouring cubes. Their outer faces are flat.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Lattice:
    """points : (n, dim) float64 [mm]; cells : (m, dim + 1) int64, each of positive volume"""

    points: FloatArray
    cells: IntArray


def make_lattice(low: FloatArray, high: FloatArray, counts: tuple[int, ...]) -> Lattice:
    """A lattice that fills a box.

    low, high : (dim,) [mm], dim 2 or 3; counts : squares or cubes along each axis, ≥ 1
    """
    dim, n = len(counts), np.asarray(counts)
    axes = [np.linspace(a, b, k + 1) for a, b, k in zip(low, high, counts, strict=True)]
    middles = [0.5 * (axis[:-1] + axis[1:]) for axis in axes]
    corners = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dim)
    centres = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, dim)
    corner_number = np.arange(len(corners)).reshape(n + 1)
    centre_number = len(corners) + np.arange(len(centres)).reshape(n)
    cells = (_triangles(corner_number, centre_number) if dim == 2
             else _tetrahedra(corner_number, centre_number))
    points = np.concatenate([corners, centres])
    return Lattice(points, oriented(points, cells))


def _triangles(corner: IntArray, centre: IntArray) -> IntArray:
    a, b = corner[:-1, :-1].ravel(), corner[1:, :-1].ravel()
    c, d = corner[1:, 1:].ravel(), corner[:-1, 1:].ravel()
    middle = centre.ravel()
    return np.concatenate([np.stack([p, q, middle], axis=1)
                           for p, q in ((a, b), (b, c), (c, d), (d, a))])


def _tetrahedra(corner: IntArray, centre: IntArray) -> IntArray:
    found: list[IntArray] = []
    for axis in range(3):
        turned = np.moveaxis(corner, axis, 0)  # faces across `axis`: [plane, i, j]
        inner = np.moveaxis(centre, axis, 0)
        a, b = turned[:, :-1, :-1], turned[:, 1:, :-1]
        c, d = turned[:, 1:, 1:], turned[:, :-1, 1:]
        for p, q in ((a, b), (b, c), (c, d), (d, a)):
            found.append(np.stack([inner[:-1].ravel(), inner[1:].ravel(),
                                   p[1:-1].ravel(), q[1:-1].ravel()], axis=1))
        for plane, cube in ((0, 0), (-1, -1)):
            middle = inner[cube].ravel()
            pa, pb, pc, pd = (x[plane].ravel() for x in (a, b, c, d))
            found.append(np.stack([middle, pa, pb, pc], axis=1))
            found.append(np.stack([middle, pa, pc, pd], axis=1))
    return np.concatenate(found)


def oriented(points: FloatArray, cells: IntArray) -> IntArray:
    """The same cells with their corners in an order that makes every volume positive."""
    turned = cells.copy()
    negative = signed_volumes(points, cells) < 0
    turned[negative, -2:] = turned[negative, :-3:-1]
    return turned


def signed_volumes(points: FloatArray, cells: IntArray) -> FloatArray:
    """Area or volume of each simplex, negative where its corners run the wrong way round."""
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    return np.asarray(np.linalg.det(edges) / (2.0 if cells.shape[1] == 3 else 6.0))
