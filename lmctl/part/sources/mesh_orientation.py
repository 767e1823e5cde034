"""Make triangles face the same way all over each patch, then out of the solid.

The file's own facing is kept where its triangles agree: a shell that faces inwards inside another
is a cavity. Where they do not agree, each patch is turned as far as neighbours decide it.
"""

from __future__ import annotations

import numpy as np

from lmctl.array_types import BoolArray, FloatArray, IntArray
from lmctl.errors import InputError
from lmctl.part.sources.mesh_topology import connected_components, directed_edges, edge_numbers


def orient_consistently(
    vertices: FloatArray, triangles: IntArray, name: str
) -> tuple[IntArray, BoolArray]:
    """Triangles turned so that neighbours over edges of two face the same way.

    Of each patch the smaller area is turned.

    triangles : (m, 3), every edge in an even number of them
    returns : triangles (m, 3); which of them were turned (m,)
    raises : InputError, with a place, where a patch cannot face one way (it has one side only)
    """
    pairs, opposed = _neighbours(triangles)
    if not opposed.any():
        return triangles, np.zeros(len(triangles), dtype=bool)
    # Each triangle twice, as it is and turned; what must go together is linked.
    count = len(triangles)
    one, other = pairs.T
    links = np.vstack([
        np.stack([one, other + count * opposed], axis=1),
        np.stack([one + count, other + count * ~opposed], axis=1),
    ])
    label = connected_components(links, 2 * count)
    as_is, turned = label[:count], label[count:]
    both = np.flatnonzero(as_is == turned)
    if len(both):
        at = ", ".join(f"{v:.2f}" for v in vertices[triangles[both[0]]].mean(axis=0))
        raise InputError(
            f"the mesh {name} has a surface with one side only",
            where=f"inside and outside cannot be distinguished near ({at}) mm",
            hint="export it again as a solid",
        )
    patch = np.minimum(as_is, turned)
    flip = as_is > turned
    area = _areas(vertices, triangles)
    flipped = np.bincount(patch, weights=np.where(flip, area, -area), minlength=2 * count)
    flip ^= (flipped > 0.0)[patch]
    result = triangles.copy()
    result[flip] = result[flip, ::-1]
    return result, flip


def shell_numbers(vertices: FloatArray, triangles: IntArray) -> IntArray:
    """The number of the shell of each triangle (m,): what hangs together over edges."""
    shell: IntArray = connected_components(directed_edges(triangles),
                                           len(vertices))[triangles[:, 0]]
    return np.unique(shell, return_inverse=True)[1].reshape(-1)


def signed_tetrahedron_volumes(vertices: FloatArray, triangles: IntArray) -> FloatArray:
    """Of the tetrahedron that each triangle spans with the mesh's middle, (m,) [mm³]."""
    a, b, c = (vertices[triangles[:, k]] - vertices.mean(axis=0) for k in range(3))
    volumes: FloatArray = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    return volumes


def orient_by_parity(vertices: FloatArray, triangles: IntArray) -> IntArray:
    """Patches turned so that what is inside by parity is behind them.

    For a shell whose patches meet in edges of more than two triangles, where no neighbour decides
    how the next patch faces.
    """
    pairs, _ = _neighbours(triangles)
    patch = connected_components(pairs, len(triangles))
    area = _areas(vertices, triangles)
    corners = vertices[triangles]
    result = triangles.copy()
    for number in np.unique(patch).tolist():
        own = np.flatnonzero(patch == number)
        largest = own[int(np.argmax(area[own]))]
        a, b, c = corners[largest]
        normal = np.cross(b - a, c - a) / max(2.0 * float(area[largest]), 1e-300)
        # Beside the middle, so that the ray meets no edge of a regular mesh.
        place = 0.29 * a + 0.33 * b + 0.38 * c
        crossed = _crossed(np.delete(corners, largest, axis=0), place, normal)
        if crossed % 2 == 1:
            result[own] = result[own, ::-1]
    return result


def _crossed(corners: FloatArray, place: FloatArray, direction: FloatArray) -> int:
    """How many triangles (m, 3, 3) a ray meets."""
    across = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(direction, across), direction], axis=1)
    local = (corners - place) @ axes
    x, y, z = local[..., 0], local[..., 1], local[..., 2]
    sides = [
        x[:, k] * y[:, (k + 1) % 3] - x[:, (k + 1) % 3] * y[:, k] for k in range(3)
    ]
    turn = sides[0] + sides[1] + sides[2]
    within = np.all([side * np.sign(turn) > 0 for side in sides], axis=0) & (turn != 0)
    height = (sides[1] * z[:, 0] + sides[2] * z[:, 1] + sides[0] * z[:, 2])[within] / turn[within]
    return int(np.count_nonzero(height > 0.0))


def _neighbours(triangles: IntArray) -> tuple[IntArray, BoolArray]:
    """Pairs (k, 2) of triangles with an edge that no third has; whether they face opposite ways."""
    number, counts = edge_numbers(triangles)
    order = np.argsort(number, kind="stable")
    paired = order[(counts == 2)[number[order]]].reshape(-1, 2)
    edges = directed_edges(triangles)
    return paired // 3, edges[paired[:, 0], 0] == edges[paired[:, 1], 0]


def _areas(vertices: FloatArray, triangles: IntArray) -> FloatArray:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    areas: FloatArray = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return areas
