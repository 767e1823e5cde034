"""What is wrong with a mesh, what of it can be mended without guessing, and what cannot.

Order matters: corners are joined first (an STL repeats every corner in every triangle), then copies
and fins go, then small holes are closed; what is still open after that is refused. Orientation is
not trusted: inside and outside are decided by parity.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.errors import InputError
from lmctl.field.plane import loop_area_mm2
from lmctl.part.sources.mesh_files import Mesh
from lmctl.part.sources.mesh_topology import (
    components,
    directed_edges,
    edge_numbers,
    join_corners,
    odd_edges,
    patches,
)
from lmctl.part.sources.slicing import Slicer, crossings

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]

#: Corners this near each other on open edges are one corner: seams of rounded exports.
SEAM_MM = 1e-3

#: At most this share of the triangles (but always ten) may be fins that are cut away.
FIN_SHARE = 0.01

OPPOSITE = "face opposite ways"

#: Solid by parity and by orientation may differ by this share before the mesh is refused.
OVERLAP_SHARE = 0.01


def mend(mesh: Mesh, name: str, hole_mm: float) -> tuple[Mesh, tuple[str, ...]]:
    """A closed mesh, and what was done to make it one.

    hole_mm : holes up to this size are closed: smaller than a bead, they cannot be deposited
    returns : the mesh, every edge in an even number of triangles, every corner in one;
        warnings, each naming `name`
    raises : InputError where the mesh is open, encloses nothing, or overlaps itself
    """
    said: list[str] = []
    vertices, triangles = join_corners(mesh.vertices, mesh.triangles)
    triangles = _without_collapsed(triangles, said)
    triangles = _without_copies(triangles, said)
    if (edge_numbers(triangles)[1] != 2).any():
        vertices, triangles = _seams_joined(vertices, triangles, said)
        triangles = _without_fins(triangles, said)
        vertices, triangles = _holes_closed(vertices, triangles, name, hole_mm, said)
    if len(triangles) == 0:
        raise InputError(f"the mesh {name} encloses nothing", hint="export it again as a solid")
    triangles = _facing_out(vertices, triangles, said)
    _check_overlap(vertices, triangles, name, said)
    used = np.zeros(len(vertices), dtype=bool)
    used[triangles] = True
    whole = Mesh(vertices[used], (np.cumsum(used) - 1)[triangles])
    return whole, tuple(f"mesh {name}: {text}" for text in said)


def _without_collapsed(triangles: IntArray, said: list[str]) -> IntArray:
    """Without triangles of fewer than three corners: their neighbours meet without them."""
    a, b, c = triangles.T
    whole = (a != b) & (b != c) & (c != a)
    if not whole.all():
        said.append(f"{_count(~whole, 'triangle')} without area left out")
    kept: IntArray = triangles[whole]
    return kept


def _without_copies(triangles: IntArray, said: list[str]) -> IntArray:
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
    said.append(f"{_count(~first, 'triangle')} there more than once left out")
    one_each: IntArray = triangles[first]
    united: IntArray = triangles[first & (balance != 0)[number]]
    return united if len(united) and not len(odd_edges(united)) else one_each


def _seams_joined(
    vertices: FloatArray, triangles: IntArray, said: list[str]
) -> tuple[FloatArray, IntArray]:
    """Corners of open edges joined where they differ by rounding only."""
    rim = np.unique(odd_edges(triangles))
    if len(rim) == 0:
        return vertices, triangles
    from scipy.spatial import cKDTree  # late: only meshes with open edges need it

    pairs = cKDTree(vertices[rim]).query_pairs(SEAM_MM, output_type="ndarray")
    if len(pairs) == 0:
        return vertices, triangles
    group = components(pairs, len(rim))
    _, first = np.unique(group, return_index=True)
    number = np.arange(len(vertices))
    number[rim] = rim[first[group]]
    joined = number[triangles]
    a, b, c = joined.T
    moved = number != np.arange(len(number))
    said.append(f"seams up to {SEAM_MM:g} mm wide joined at {_count(moved, 'corner')}")
    return vertices, joined[(a != b) & (b != c) & (c != a)]


def _without_fins(triangles: IntArray, said: list[str]) -> IntArray:
    """Without small patches that hang on a surface by an edge, float alone, or wall inside.

    A patch is what hangs together by edges of exactly two triangles. The smallest that does not
    belong goes first, and the rest is looked at anew.
    """
    most = max(10, int(FIN_SHARE * len(triangles)))
    kept = triangles
    while len(kept):
        patch, sizes = patches(kept)
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
        said.append(f"{cut} triangle{'s' if cut > 1 else ''} too many, bounding nothing, left out")
    return kept


def _holes_closed(
    vertices: FloatArray, triangles: IntArray, name: str, hole_mm: float, said: list[str]
) -> tuple[FloatArray, IntArray]:
    """Every open rim closed by a fan to its middle; refused where one is larger than a bead."""
    rim = odd_edges(triangles)
    if len(rim) == 0:
        return vertices, triangles
    group_of_rim = components(rim, len(vertices))[rim[:, 0]]
    middles, fans, sizes = [], [], []
    for number, which in enumerate(np.unique(group_of_rim)):
        edges = rim[group_of_rim == which]
        corners = vertices[np.unique(edges)]
        sizes.append(float(np.linalg.norm(np.ptp(corners, axis=0))))
        middles.append(corners.mean(axis=0))
        middle = np.full(len(edges), len(vertices) + number)
        fans.append(np.stack([edges[:, 1], edges[:, 0], middle], axis=1))
    largest = int(np.argmax(sizes))
    if sizes[largest] > hole_mm:
        at = ", ".join(f"{v:.2f}" for v in middles[largest])
        raise InputError(
            f"the mesh {name} is open",
            where=(
                f"{len(sizes)} hole{'s' if len(sizes) > 1 else ''}, {len(rim)} open edges of "
                f"{len(triangles)} triangles",
                f"the largest hole is {sizes[largest]:.3g} mm across, near ({at}) mm; up to "
                f"{hole_mm:g} mm (a bead) is closed here",
            ),
            hint="close it in a mesh program, or export the solid again",
        )
    said.append(f"{len(sizes)} hole{'s' if len(sizes) > 1 else ''} closed, the largest "
                f"{sizes[largest]:.2g} mm across")
    return np.vstack([vertices, *middles]), np.vstack([triangles, *fans])


def _facing_out(vertices: FloatArray, triangles: IntArray, said: list[str]) -> IntArray:
    """Shells that face inwards turned, unless they are cavities; what cannot be turned is said."""
    undirected, counts = edge_numbers(triangles)
    if (counts > 2).any():
        said.append(f"{_count(counts > 2, 'edge')} with more than two triangles; "
                    "solids that only touch keep a seam between them")
    edges = directed_edges(triangles)
    forward = np.where(edges[:, 0] < edges[:, 1], 1, -1)
    balance = np.bincount(undirected, weights=forward, minlength=len(counts))
    if (balance != 0).any():
        said.append(f"{_count(balance != 0, 'edge')} whose triangles {OPPOSITE}; "
                    "inside is decided by parity")
        return triangles
    shell = components(edges, len(vertices))[triangles[:, 0]]
    volume = np.bincount(shell, weights=_volumes(vertices, triangles))
    turned = triangles.copy()
    for number in np.flatnonzero(volume < 0):
        own = shell == number
        if not _is_within(vertices, triangles[own], triangles[~own]):
            turned[own] = turned[own, ::-1]
            said.append(f"a shell of {_count(own, 'triangle')} is inside out; it was turned")
    return turned


def _is_within(vertices: FloatArray, shell: IntArray, others: IntArray) -> bool:
    """Whether a shell lies inside the solid that the other triangles bound, by parity."""
    heights = vertices[np.unique(shell), 2]
    z = float(0.5 * (heights.min() + heights.max()))
    loops = Slicer(vertices, shell).loops(z)
    around = Slicer(vertices, others).loops(z)
    return bool(loops) and sum(crossings(loops[0][0], p[:-1], p[1:]) for p in around) % 2 == 1


def _check_overlap(
    vertices: FloatArray, triangles: IntArray, name: str, said: list[str]
) -> None:
    """Compare the volume its orientation encloses with what is solid by parity.

    They differ where solids overlap or a cavity faces the wrong way. Parity is measured on a few
    slices, so small differences are not seen; without agreeing orientation there is no telling.
    """
    if any(OPPOSITE in text for text in said):
        return
    slicer = Slicer(vertices, triangles)
    low, high = vertices[:, 2].min(), vertices[:, 2].max()
    for share in (0.05, 0.23, 0.41, 0.5, 0.59, 0.77, 0.95):
        z = float(low + share * (high - low))
        by_parity = sum(map(loop_area_mm2, slicer.loops(z)))
        facing = slicer.facing_area_mm2(z)
        if abs(by_parity - facing) > OVERLAP_SHARE * max(by_parity, facing):
            raise InputError(
                f"the mesh {name} overlaps itself",
                where=f"at z = {z:.2f} mm outlines cross, or lie in one another with no cavity "
                "between",
                hint="unite its solids in the program it came from",
            )


def _volumes(vertices: FloatArray, triangles: IntArray) -> FloatArray:
    """Signed volume of the tetrahedron each triangle spans with the mesh's middle [mm³]."""
    a, b, c = (vertices[triangles[:, k]] - vertices.mean(axis=0) for k in range(3))
    volumes: FloatArray = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    return volumes


def _count(which: NDArray[np.bool_], noun: str) -> str:
    n = int(np.count_nonzero(which))
    return f"{n:,} {noun}{'' if n == 1 else 's'}"
