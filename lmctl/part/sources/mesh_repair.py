"""Find what is wrong with a mesh, repair what needs no guess, and refuse the rest.

Order matters: corners are joined first (an STL repeats every corner in every triangle), copies go,
edges are cut where they pass corners, fins go, and holes are closed where the mesh shows how. What
is still open after that is refused. Then triangles are made to face one way, and shells one solid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.errors import InputError
from lmctl.field.mesh.triangle_tree import TriangleTree
from lmctl.part.sources.mesh_files import Mesh
from lmctl.part.sources.mesh_holes import close_holes
from lmctl.part.sources.mesh_junctions import split_at_junctions
from lmctl.part.sources.mesh_orientation import orient_consistently
from lmctl.part.sources.mesh_shared_edges import split_at_shared_edges
from lmctl.part.sources.mesh_solids import unite_shells
from lmctl.part.sources.mesh_topology import (
    connected_components,
    connected_patches,
    edge_counts,
    edge_numbers,
    merge_equal_vertices,
    odd_count_edges,
)

#: Corners this near each other on open edges are one corner: seams of rounded exports.
SEAM_MM = 1e-3

#: At most this share of the triangles (but always ten) may be fins that are cut away.
FIN_SHARE = 0.01

#: Places on the surface that are looked at, and how far outside of it as a share of the size.
SURFACE_PLACES = 20_000
OUTSIDE_SHARE = 1e-6


def repair_mesh(mesh: Mesh, name: str, hole_mm: float) -> tuple[Mesh, tuple[str, ...]]:
    """A closed mesh, and what was done to make it one.

    hole_mm : holes up to this size are closed: smaller than a bead, they cannot be deposited
    returns : the mesh, every edge in an even number of triangles, every corner in one;
        warnings, each naming `name`
    raises : InputError where the mesh is open, encloses nothing, or overlaps itself
    """
    remarks: list[str] = []
    vertices, triangles = merge_equal_vertices(mesh.vertices, mesh.triangles)
    triangles = _without_collapsed(triangles, remarks)
    triangles = _without_copies(triangles, remarks)
    if (edge_counts(triangles) != 2).any():
        vertices, triangles = _seams_joined(vertices, triangles, remarks)
        triangles = _cut_at_junctions(vertices, triangles, remarks)
        triangles = _without_fins(triangles, remarks)
        vertices, triangles = close_holes(vertices, triangles, name, hole_mm, remarks)
    if len(triangles) == 0:
        raise InputError(f"the mesh {name} encloses nothing", hint="export it again as a solid")
    triangles, turned = orient_consistently(vertices, triangles, name)
    if turned.any():
        remarks.append(
            f"{_count(turned, 'triangle')} faced the other way than those beside; turned")
    vertices, triangles = split_at_shared_edges(vertices, triangles)
    vertices, triangles = unite_shells(vertices, triangles, turned, name, hole_mm, remarks)
    vertices, triangles = merge_equal_vertices(vertices, triangles)
    counts = edge_counts(triangles)
    if (counts > 2).any():
        remarks.append(f"{_count(counts > 2, 'edge')} with more than two triangles: solids touch "
                    "along edges there, and no more")
    _check_overlap(vertices, triangles, name, hole_mm)
    used = np.zeros(len(vertices), dtype=bool)
    used[triangles] = True
    intact = Mesh(vertices[used], (np.cumsum(used) - 1)[triangles])
    return intact, tuple(f"mesh {name}: {text}" for text in remarks)


def _without_collapsed(triangles: IntArray, remarks: list[str]) -> IntArray:
    """Without triangles of fewer than three corners: their neighbours meet without them."""
    a, b, c = triangles.T
    intact = (a != b) & (b != c) & (c != a)
    if not intact.all():
        remarks.append(f"{_count(~intact, 'triangle')} without area left out")
    kept: IntArray = triangles[intact]
    return kept


def _without_copies(triangles: IntArray, remarks: list[str]) -> IntArray:
    """One of each triangle; of a pair facing opposite ways neither, where that stays closed.

    Such a pair is the common wall of two solids that were put together without being united.
    """
    ordered = np.sort(triangles, axis=1)
    order = np.lexsort(ordered.T)
    new = np.ones(len(order), dtype=bool)
    new[1:] = np.any(ordered[order[1:]] != ordered[order[:-1]], axis=1)
    if new.all():
        return triangles
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.cumsum(new) - 1
    even = np.array([(0, 1, 2), (1, 2, 0), (2, 0, 1)])
    ranks = np.argsort(np.argsort(triangles, axis=1), axis=1)
    facing = np.where((ranks[:, None, :] == even[None]).all(axis=2).any(axis=1), 1, -1)
    balance = np.bincount(number, weights=facing)
    first = np.zeros(len(triangles), dtype=bool)
    first[np.unique(number, return_index=True)[1]] = True
    remarks.append(f"{_count(~first, 'triangle')} there more than once left out")
    one_each: IntArray = triangles[first]
    united: IntArray = triangles[first & (balance != 0)[number]]
    return united if len(united) and not len(odd_count_edges(united)) else one_each


def _seams_joined(
    vertices: FloatArray, triangles: IntArray, remarks: list[str]
) -> tuple[FloatArray, IntArray]:
    """Corners of open edges joined where they differ by rounding only."""
    rim = np.unique(odd_count_edges(triangles))
    if len(rim) == 0:
        return vertices, triangles
    from scipy.spatial import cKDTree  # late: only meshes with open edges need it

    pairs = cKDTree(vertices[rim]).query_pairs(SEAM_MM, output_type="ndarray")
    if len(pairs) == 0:
        return vertices, triangles
    group = connected_components(pairs, len(rim))
    _, first = np.unique(group, return_index=True)
    number = np.arange(len(vertices))
    number[rim] = rim[first[group]]
    joined = number[triangles]
    a, b, c = joined.T
    moved = number != np.arange(len(number))
    remarks.append(f"seams up to {SEAM_MM:g} mm wide joined at {_count(moved, 'corner')}")
    return vertices, joined[(a != b) & (b != c) & (c != a)]


def _cut_at_junctions(vertices: FloatArray, triangles: IntArray, remarks: list[str]) -> IntArray:
    cut, edges = split_at_junctions(vertices, triangles, SEAM_MM)
    if edges:
        remarks.append(f"T-junctions: {edges} edge{'s' if edges > 1 else ''} cut at corners of "
                    "neighbours")
    return cut


def _without_fins(triangles: IntArray, remarks: list[str]) -> IntArray:
    """Without small patches that hang on a surface by an edge, float alone, or wall inside.

    A patch is what hangs together by edges of exactly two triangles. The smallest that does not
    belong goes first, and the rest is looked at anew.
    """
    most = max(10, int(FIN_SHARE * len(triangles)))
    kept = triangles
    while len(kept):
        patch, sizes = connected_patches(kept)
        number, counts = edge_numbers(kept)
        per_edge = counts[number].reshape(-1, 3)
        stray = np.zeros(len(sizes), dtype=bool)
        stray[patch[(per_edge == 1).any(axis=1)]] = True
        inner = np.ones(len(sizes), dtype=bool)
        inner[patch[((per_edge != 2) & (per_edge != 3)).any(axis=1)]] = False
        inner[np.setdiff1d(np.arange(len(sizes)), patch[(per_edge == 3).any(axis=1)])] = False
        stray |= inner
        stray[np.argmax(sizes)] = False
        if not stray.any():
            break
        smallest = int(np.flatnonzero(stray)[np.argmin(sizes[stray])])
        kept = kept[patch != smallest]
        if len(triangles) - len(kept) > most:
            return triangles
    cut = len(triangles) - len(kept)
    if cut:
        remarks.append(
            f"{cut} triangle{'s' if cut > 1 else ''} too many, bounding nothing, left out")
    return kept


def _check_overlap(
    vertices: FloatArray, triangles: IntArray, name: str, bead_mm: float
) -> None:
    """Raises InputError where more of a surface than a bead's section lies inside the solid.

    Random points just outside the surface must not be inside the mesh. They are where a shell cuts
    through itself; nothing shows which part of it is meant.
    """
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1)
    rng = np.random.default_rng(0)  # the same places each time
    which = rng.choice(len(triangles), SURFACE_PLACES, p=size / size.sum())
    place = np.einsum("nk,nkc->nc", rng.dirichlet([1.0, 1.0, 1.0], SURFACE_PLACES), corners[which])
    off = OUTSIDE_SHARE * float(np.ptp(vertices, axis=0).max())
    outside = place + off * normal[which] / size[which, None]
    hidden = np.flatnonzero(TriangleTree.of(corners).is_inside(outside))
    area = 0.5 * float(size.sum()) * len(hidden) / SURFACE_PLACES
    if len(hidden) < 2 or area < 0.25 * bead_mm**2:
        return
    at = ", ".join(f"{v:.2f}" for v in place[hidden[0]])
    raise InputError(
        f"the mesh {name} overlaps itself",
        where=f"about {area:.2g} mm² of its surface lie inside of it, near ({at}) mm",
        hint="unite its solids in the program it came from",
    )


def _count(which: NDArray[np.bool_], noun: str) -> str:
    n = int(np.count_nonzero(which))
    return f"{n:,} {noun}{'' if n == 1 else 's'}"
