"""A mesh of curved quadratic elements whose boundary lies on the part's own surface.

A lattice is cut where the distance changes its sign; then nodes in the middle of boundary edges are
moved onto the surface. Flat faces of the box around the part, and the edges where they meet curved
ones, are exact. Other sharp edges are met to within a fraction of an element.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from skfem import FacetBasis, MeshTet, MeshTet2, MeshTri, MeshTri2

from lmctl.array_types import BoolArray, FloatArray, IntArray
from lmctl.design.lattice import Lattice, make_lattice, signed_volumes
from lmctl.design.simplex_cutting import cut_lattice
from lmctl.errors import InputError

Distance = Callable[[FloatArray], FloatArray]

#: A box's face is a face of the part where this many lattice nodes of it are on the surface.
_NODES_ON_A_FACE = 3
_FACE_TOLERANCE = 1e-6

#: On such a face the distance is asked this share of an element inside it.
_INWARD_SHARE = 1e-3
_LATERAL_SHARE = 0.2

#: A piece with less than this share of the volume is a crumb of the cutting, not a body.
_CRUMB_SHARE = 1e-3

#: An edge bends by no more than this share of its length, and an element's mapping shrinks nowhere
#: below this share of that in its middle; others stay straight.
_MOST_BEND, _LEAST_TURN = 0.15, 0.25

_SMOOTHING_SWEEPS = 4
_PROJECTIONS = 4


@dataclass(frozen=True, eq=False)
class FittedMesh:
    """A mesh of the solid.

    mesh : six-node triangles or ten-node tetrahedra, coordinates [mm]
    size_mm : mean edge length; dropped_share : of the volume, in crumbs that were left out
    """

    mesh: MeshTri2 | MeshTet2
    size_mm: float
    dropped_share: float

    @property
    def n_elements(self) -> int:
        """Number of triangles or tetrahedra."""
        return int(self.mesh.t.shape[1])


@dataclass(frozen=True, eq=False)
class _Box:
    """low, high : (dim,) [mm]; flat : (2, dim), which faces of it the part has"""

    low: FloatArray
    high: FloatArray
    flat: BoolArray

    def inset(self, points: FloatArray, by_mm: float) -> FloatArray:
        """Points on flat faces moved inwards."""
        low = np.where(self.flat[0], self.low + by_mm, -np.inf)
        high = np.where(self.flat[1], self.high - by_mm, np.inf)
        return np.clip(points, low, high)

    def on_faces(self, points: FloatArray, within_mm: float) -> BoolArray:
        """(n, dim): which coordinates lie on a flat face."""
        found: BoolArray = ((np.abs(points - self.low) < within_mm) & self.flat[0]) | (
            (np.abs(points - self.high) < within_mm) & self.flat[1])
        return found


def fit_mesh(
    distance: Distance, low_mm: FloatArray, high_mm: FloatArray, size_mm: float,
    flat_low: tuple[bool, ...] = (),
) -> FittedMesh:
    """The mesh of what a distance is positive in.

    distance : points (n, dim) -> (n,) [mm], positive inside, dim 2 or 3; near the surface its size
        matters, elsewhere its sign
    low_mm, high_mm : (dim,), a box around the solid
    size_mm : edge length wanted, > 0
    flat_low : for each axis, whether the box's low face bounds the mesh whatever the distance says,
        as the axis of a turned part does

    Raises InputError where the mesh is too coarse to hold the part, or the part is in pieces.
    """
    box = _flat_faces(distance, low_mm, high_mm, size_mm, flat_low)
    cell = size_mm * (1.15 if len(low_mm) == 3 else 1.2)
    low = np.where(box.flat[0], low_mm, low_mm - cell)
    high = np.where(box.flat[1], high_mm, high_mm + cell)
    counts = tuple(int(n) for n in np.maximum(np.rint((high - low) / cell), 1))
    lattice = make_lattice(low, high, counts)
    inward = _INWARD_SHARE * cell
    faces = box.on_faces(lattice.points, 1e-9 * float((high - low).max()))
    cut = cut_lattice(lattice, lambda p: distance(box.inset(p, inward)), faces)
    if len(cut.cells) == 0:
        raise InputError("the mesh misses the part", where=f"elements of {size_mm:g} mm",
                         hint="lower mesh_mm")
    cut, dropped = _one_piece(cut, size_mm)
    points = _smoothed(cut)
    mesh = _curved(points, cut.cells, distance, box, cell)
    edges = points[cut.cells] - points[np.roll(cut.cells, 1, axis=1)]
    return FittedMesh(mesh, float(np.linalg.norm(edges, axis=2).mean()), dropped)


def _flat_faces(
    distance: Distance, low: FloatArray, high: FloatArray, size_mm: float,
    flat_low: tuple[bool, ...],
) -> _Box:
    dim = len(low)
    flat = np.zeros((2, dim), dtype=bool)
    extent = float((high - low).max())
    axes = [np.linspace(a, b, max(8, int((b - a) / size_mm)) + 1)
            for a, b in zip(low, high, strict=True)]
    for axis in range(dim):
        for side, place in enumerate((low[axis], high[axis])):
            across = [place if k == axis else axes[k] for k in range(dim)]
            grid = np.stack(np.meshgrid(*across, indexing="ij"), axis=-1).reshape(-1, dim)
            on = np.abs(distance(grid)) < _FACE_TOLERANCE * extent
            inside = grid[on]
            inside[:, axis] += (1 - 2 * side) * _INWARD_SHARE * size_mm
            flat[side, axis] = on.any() and (
                distance(inside) > 0.5 * _INWARD_SHARE * size_mm).sum() >= _NODES_ON_A_FACE
    if flat_low:
        flat[0] |= np.array(flat_low)
    return _Box(np.asarray(low, dtype=float), np.asarray(high, dtype=float), flat)


def _one_piece(cut: Lattice, size_mm: float) -> tuple[Lattice, float]:
    """The lattice without crumbs. Raises InputError where there are several bodies."""
    size, n = cut.cells.shape[1], len(cut.points)
    rows, columns = cut.cells[:, :-1].ravel(), cut.cells[:, 1:].ravel()
    links = coo_array((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    count, piece = connected_components(links, directed=False)
    if count == 1:
        return cut, 0.0
    of_cell = piece[cut.cells[:, 0]]
    volume = np.bincount(of_cell, signed_volumes(cut.points, cut.cells), minlength=count)
    share = volume / volume.sum()
    large = np.flatnonzero(share > _CRUMB_SHARE)
    if len(large) > 1:
        middles = [cut.points[piece == k].mean(axis=0) for k in large]
        raise InputError(
            f"the body is in {len(large)} pieces",
            where=[f"{share[k]:.1%} of it around ({', '.join(f'{v:.4g}' for v in m)}) mm"
                   for k, m in zip(large, middles, strict=True)],
            hint="loads do not pass between pieces; join them, simulate one of them, or lower "
            f"mesh_mm ({size_mm:g}) if they are joined by something thinner")
    kept = cut.cells[of_cell == large[0]]
    used, numbers = np.unique(kept, return_inverse=True)
    return (Lattice(cut.points[used], numbers.reshape(-1, size)), float(1.0 - share[large[0]]))


def _boundary_edges(cells: IntArray) -> IntArray:
    """(k, 2): edges of faces that belong to one cell only, each once."""
    size = cells.shape[1]
    faces = np.concatenate([np.delete(cells, k, axis=1) for k in range(size)])
    ordered = np.sort(faces, axis=1)
    unique, counts = np.unique(ordered, axis=0, return_counts=True)
    outer = unique[counts == 1]
    if size == 3:
        return np.asarray(outer)
    pairs = np.concatenate([outer[:, [0, 1]], outer[:, [1, 2]], outer[:, [0, 2]]])
    return np.asarray(np.unique(pairs, axis=0))


def _quality(points: FloatArray, cells: IntArray) -> FloatArray:
    """Volume over the cube (square) of the root mean square edge: 0 for flat cells."""
    size = cells.shape[1]
    square = sum(((points[cells[:, a]] - points[cells[:, b]]) ** 2).sum(axis=1)
                 for a in range(size) for b in range(a + 1, size))
    return np.asarray(signed_volumes(points, cells) / np.asarray(square) ** ((size - 1) / 2))


def _smoothed(cut: Lattice) -> FloatArray:
    """Inner points moved to the middle of their neighbours wherever no cell gets worse for it."""
    points, cells, size = cut.points.copy(), cut.cells, cut.cells.shape[1]
    fixed = np.zeros(len(points), dtype=bool)
    fixed[_boundary_edges(cells).ravel()] = True
    pairs = np.concatenate([cells[:, [a, b]] for a in range(size) for b in range(size) if a != b])
    count = np.bincount(pairs[:, 0], minlength=len(points))
    for _ in range(_SMOOTHING_SWEEPS):
        target = np.stack([np.bincount(pairs[:, 0], points[pairs[:, 1], k], len(points))
                           for k in range(points.shape[1])], axis=1) / count[:, None]
        before = _quality(points, cells)
        least = np.full(len(points), np.inf)
        np.minimum.at(least, cells.ravel(), np.repeat(before, size))
        moved = np.where(fixed[:, None], points, target)
        going = ~fixed
        for _ in range(8):  # points of cells that got worse than their worst neighbour go back
            worse = _quality(moved, cells) < least[cells].min(axis=1)
            back = np.zeros(len(points), dtype=bool)
            back[cells[worse].ravel()] = True
            back &= going
            if not back.any():
                break
            moved[back], going = points[back], going & ~back
        else:
            continue
        points = moved
    return points


def _curved(
    points: FloatArray, cells: IntArray, distance: Distance, box: _Box, cell_mm: float
) -> MeshTri2 | MeshTet2:
    """Quadratic elements whose middle nodes on the boundary lie on the surface."""
    dim = points.shape[1]
    linear, curved = ((MeshTri, MeshTri2) if dim == 2 else (MeshTet, MeshTet2))
    flat_mesh = linear(np.ascontiguousarray(points.T), np.ascontiguousarray(cells.T))
    mesh = curved.from_mesh(flat_mesh)
    edges = flat_mesh.facets if dim == 2 else flat_mesh.edges
    outer = _boundary_edges(flat_mesh.t.T)
    n = np.int64(len(points))
    keys = np.minimum(*edges) * n + np.maximum(*edges)
    rows = np.flatnonzero(np.isin(keys, outer.min(axis=1) * n + outer.max(axis=1)))
    places = mesh.doflocs.copy()
    first = flat_mesh.p.shape[1]
    straight = places[:, first + rows].T.copy()
    bent = project_to_surface(straight, distance, box, cell_mm)
    length = np.linalg.norm(flat_mesh.p[:, edges[0, rows]] - flat_mesh.p[:, edges[1, rows]], axis=0)
    far = np.linalg.norm(bent - straight, axis=1) > _MOST_BEND * length
    bent[far] = straight[far]
    places[:, first + rows] = bent.T
    mesh = curved(places, flat_mesh.t)
    for _ in range(4):
        bad = _folded(mesh)
        if not bad.any():
            return mesh if _is_invertible(mesh) else curved.from_mesh(flat_mesh)
        of = (flat_mesh.t2f if dim == 2 else flat_mesh.t2e)[:, bad].ravel()
        again = np.isin(rows, of)
        places = mesh.doflocs.copy()
        places[:, first + rows[again]] = straight[again].T
        mesh = curved(places, flat_mesh.t)
    return curved.from_mesh(flat_mesh)


def _is_invertible(mesh: MeshTri2 | MeshTet2) -> bool:
    """Whether scikit-fem finds the places of facets in the elements behind them."""
    try:
        FacetBasis(mesh, mesh.elem(), facets=mesh.boundary_facets(), intorder=4)
    except Exception as error:  # it raises nothing narrower
        if "Newton" not in str(error):
            raise
        return False
    return True


def _folded(mesh: MeshTri2 | MeshTet2) -> BoolArray:
    """Elements whose mapping turns over somewhere, judged at their nodes and middle."""
    dim = mesh.p.shape[0]
    corners = np.concatenate([np.zeros((dim, 1)), np.eye(dim)], axis=1)
    middles = [0.5 * (corners[:, a] + corners[:, b])
               for a in range(dim + 1) for b in range(a + 1, dim + 1)]
    places = np.concatenate([corners, np.stack(middles, axis=1),
                             np.full((dim, 1), 1.0 / (dim + 1))], axis=1)
    element, nodes = mesh.elem(), mesh.dofs.element_dofs
    turn = sum(mesh.doflocs[:, of].T[:, :, None, None] * element.lbasis(places, k)[1][None, None]
               for k, of in enumerate(nodes))  # (n, dim, dim, places)
    turning = np.linalg.det(np.moveaxis(np.asarray(turn), 3, 1))
    middle = turning[:, -1:]
    folded: BoolArray = (turning * np.sign(middle) < _LEAST_TURN * np.abs(middle)).any(axis=1)
    return folded


def project_to_surface(
    points: FloatArray, distance: Distance, box: _Box, cell_mm: float
) -> FloatArray:
    """Points near the surface moved onto it along the slope; those on flat faces stay in them."""
    points, step = points.copy(), 1e-5 * cell_mm
    on = box.on_faces(points, 1e-6 * cell_mm)
    inset_mm = _LATERAL_SHARE * cell_mm
    planar = np.asarray(on.any(axis=1))

    def depth(p: FloatArray) -> FloatArray:
        return distance(np.where(planar[:, None], box.inset(p, inset_mm), p))

    for _ in range(_PROJECTIONS):
        value = depth(points)
        slope = np.stack([
            (depth(points + step * axis) - depth(points - step * axis)) / (2 * step)
            for axis in np.eye(points.shape[1])], axis=1)
        slope[on] = 0.0
        square = (slope**2).sum(axis=1)
        # In the middle of a flat face the depth is that of the face itself: nothing to move.
        move = (square > 0.04) & ~(planar & (value > 0.98 * inset_mm))
        ratio = np.where(move, value / np.where(move, square, 1.0), 0.0)
        points -= ratio[:, None] * slope
    return points
