"""Quadratic elements on a fitted mesh: places and weights of integration, shapes, assembly.

scikit-fem gives mappings, shapes and numbering; element matrices are formed in blocks, and added
into a pattern that is found once, because an optimisation assembles the same mesh many times.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from scipy.optimize import brentq
from scipy.sparse import bsr_array, csr_array
from skfem import Basis, ElementTetP2, ElementTriP2
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTri

from lmctl.array_types import FloatArray, IntArray
from lmctl.design.effective_properties import EffectiveProperties
from lmctl.design.fitted_mesh import FittedMesh
from lmctl.design.model_space import STRAIN_ROWS, STRESSED_AXES, ModelSpace


def _tetrahedron_rule() -> tuple[FloatArray, FloatArray]:
    """Eight places, exact for cubics, all inside and of positive weight.

    Two orbits (a, a, a, 1 - 3a); any a of the first gives the second, here from the exact means of
    λ² (1/10) and λ³ (1/20). Curved elements need cubics, and norms need positive weights.
    """
    first = 0.05

    def means(a: float) -> tuple[float, float]:
        return (3 * a**2 + (1 - 3 * a) ** 2) / 4, (3 * a**3 + (1 - 3 * a) ** 3) / 4

    def weight(a: float) -> float:
        return (0.1 - means(a)[0]) / (means(first)[0] - means(a)[0])

    def off(a: float) -> float:
        w = weight(a)
        return w * means(first)[1] + (1 - w) * means(a)[1] - 0.05

    second = float(brentq(off, 0.28, 0.34, xtol=1e-15))
    places, weights = [], []
    for a, share in ((first, weight(second)), (second, 1 - weight(second))):
        for k in range(4):
            of = np.full(4, a)
            of[k] = 1 - 3 * a
            places.append(of[1:])
            weights.append(share / 24)
    return np.array(places).T, np.array(weights)


#: Places (dim, q) and weights (q,) of integration on the unit element, exact for quartics in 2D and
#: for cubics in 3D.
QUADRATURE: dict[int, tuple[FloatArray, FloatArray]] = {
    2: get_quadrature(RefTri, 4), 3: _tetrahedron_rule()}

#: Elements whose matrices are formed at a time: tens of megabytes.
ELEMENTS_AT_ONCE = 2000


class Discretisation:
    """Elements, nodes and integration of one mesh in one model space.

    nodes_mm : (n_nodes, dim); element_nodes : (n_elements, a), a = 6 or 10
    places_mm : (n_elements, q, dim), where properties are wanted
    weights : (n_elements, q), volume [mm³] that each place stands for
    shapes : (q, a); slopes : (n_elements, q, a, dim), of the shapes by the coordinates
    """

    def __init__(self, fitted: FittedMesh, space: ModelSpace) -> None:
        self.fitted, self.space = fitted, space
        self.element = ElementTriP2() if space.dim == 2 else ElementTetP2()
        basis = Basis(fitted.mesh, self.element, quadrature=QUADRATURE[space.dim])
        self.nodes_mm: FloatArray = np.ascontiguousarray(basis.doflocs.T)
        self.element_nodes: IntArray = np.ascontiguousarray(basis.element_dofs.T, dtype=np.int64)
        self.places_mm: FloatArray = np.moveaxis(np.asarray(basis.global_coordinates()), 0, -1)
        self.weights: FloatArray = basis.dx * space.measure(self.places_mm)
        values = [np.asarray(field[0]) for field in basis.basis]
        self.shapes: FloatArray = np.stack([value[0] for value in values], axis=1)
        self.slopes: FloatArray = np.ascontiguousarray(np.moveaxis(
            np.stack([np.asarray(field[0].grad) for field in basis.basis], axis=0),
            (0, 1), (2, 3)))

    @property
    def n_nodes(self) -> int:
        """Nodes of the mesh."""
        return len(self.nodes_mm)

    @cached_property
    def part_places_mm(self) -> FloatArray:
        """`places_mm` in the part, (n_elements · q, 3) float64."""
        return self.space.part_points(self.places_mm.reshape(-1, self.space.dim))

    def strain_shapes(self, rows: slice) -> FloatArray:
        """(elements, q, strains, a · dim): strains of each nodal displacement."""
        return strain_operator(self.space, self.slopes[rows], self.shapes, self.places_mm[rows])

    def blocks(self) -> Iterator[slice]:
        """Elements in pieces that are worked on at once."""
        count = len(self.element_nodes)
        for first in range(0, count, ELEMENTS_AT_ONCE):
            yield slice(first, min(first + ELEMENTS_AT_ONCE, count))

    def conduction_matrix(self, conductivity: FloatArray) -> csr_array:
        """Σ k ∇Nᵢ·∇Nⱼ; conductivity : (n_elements, q) [W/(mm K)]"""
        weight = self.weights * conductivity
        local = np.empty((*self.element_nodes.shape, self.element_nodes.shape[1]))
        for rows in self.blocks():
            g = self.slopes[rows]
            flat = np.moveaxis(g, 2, 3).reshape(len(g), -1, g.shape[2])
            scaled = (g * weight[rows][:, :, None, None])
            local[rows] = np.moveaxis(scaled, 2, 3).reshape(flat.shape).swapaxes(1, 2) @ flat
        return self._pattern.scalar_matrix(local)

    def stiffness_matrix(self, properties: EffectiveProperties) -> bsr_array:
        """Σ Bᵀ D B in blocks of one node; properties at `places_mm`."""
        dim, a = self.space.dim, self.element_nodes.shape[1]
        local = np.empty((len(self.element_nodes), a * dim, a * dim))
        for rows in self.blocks():
            b = self.strain_shapes(rows)
            stress = apply_elasticity(
                self.space, b, properties.lame_MPa[rows][..., None],
                properties.shear_MPa[rows][..., None], axis=2)
            stress *= self.weights[rows][:, :, None, None]
            count = len(b)
            local[rows] = b.reshape(count, -1, a * dim).swapaxes(1, 2) @ stress.reshape(
                count, -1, a * dim)
        return self._pattern.block_matrix(local, dim)

    def strains(self, displacement: FloatArray) -> FloatArray:
        """(n_elements, q, strains) at `places_mm`; displacement : (n_nodes, dim) [mm]"""
        found = np.empty((*self.weights.shape, len(STRAIN_ROWS[self.space.kind])))
        for rows in self.blocks():
            of = displacement[self.element_nodes[rows]].reshape(found[rows].shape[0], 1, -1, 1)
            found[rows] = (self.strain_shapes(rows) @ of)[..., 0]
        return found

    def strain_load(self, stress: FloatArray) -> FloatArray:
        """Nodal forces (n_nodes, dim) whose work is that of a stress: Σ w Bᵀ σ.

        stress : (n_elements, q, strains), in the rows of the strains
        """
        dim = self.space.dim
        local = np.empty((*self.element_nodes.shape, dim))
        for rows in self.blocks():
            b = self.strain_shapes(rows)
            weighted = stress[rows] * self.weights[rows][..., None]
            local[rows] = np.einsum("eqri,eqr->ei", b, weighted, optimize=True).reshape(
                local[rows].shape)
        return np.stack([self.add_up(local[..., k]) for k in range(dim)], axis=1)

    def at_places(self, nodal: FloatArray) -> FloatArray:
        """Nodal values (n_nodes,) at `places_mm`, (n_elements, q)."""
        return np.asarray(nodal[self.element_nodes] @ self.shapes.T)

    def slopes_of(self, nodal: FloatArray) -> FloatArray:
        """Gradient at `places_mm` of nodal values (n_nodes,), (n_elements, q, dim)."""
        of = nodal[self.element_nodes]
        return np.asarray(np.einsum("eqad,ea->eqd", self.slopes, of, optimize=True))

    def spread(self, density: FloatArray) -> FloatArray:
        """Nodal loads (n_nodes,) of a density at `places_mm` (n_elements, q)."""
        return self.add_up((density * self.weights) @ self.shapes)

    def add_up(self, local: FloatArray) -> FloatArray:
        """Values of elements' nodes (n_elements, a) added up at the nodes, (n_nodes,)."""
        return np.asarray(np.bincount(
            self.element_nodes.ravel(), local.ravel(), self.n_nodes), dtype=np.float64)

    @cached_property
    def _pattern(self) -> _NodePattern:
        return _NodePattern(self.element_nodes, self.n_nodes)


def strain_operator(
    space: ModelSpace, slopes: FloatArray, shapes: FloatArray, places_mm: FloatArray
) -> FloatArray:
    """Strains of each nodal displacement, (n, q, strains, a · dim), component fastest.

    slopes : (n, q, a, dim); shapes : (q, a); places_mm : (n, q, dim)
    """
    n, q, a, dim = slopes.shape
    rows = STRAIN_ROWS[space.kind]
    b = np.zeros((n, q, len(rows), a, dim))
    if space.kind == "axisymmetric":
        r = np.maximum(places_mm[..., 0], 1e-12)
        b[:, :, 0, :, 0] = slopes[..., 0]
        b[:, :, 1, :, 0] = shapes / r[..., None]
        b[:, :, 2, :, 1] = slopes[..., 1]
        b[:, :, 3, :, 0], b[:, :, 3, :, 1] = slopes[..., 1], slopes[..., 0]
    else:
        for axis in range(dim):
            b[:, :, axis, :, axis] = slopes[..., axis]
        for row, (i, j) in zip(range(dim, len(rows)), ((0, 1), (1, 2), (0, 2)), strict=False):
            b[:, :, row, :, i], b[:, :, row, :, j] = slopes[..., j], slopes[..., i]
    return b.reshape(n, q, len(rows), a * dim)


def apply_elasticity(
    space: ModelSpace, strain: FloatArray, lame: FloatArray, shear: FloatArray, axis: int = -1
) -> FloatArray:
    """λ tr ε I + 2 G ε in the rows of the model's strains, which lie along `axis`.

    lame, shear : of the shape of `strain` without `axis`
    """
    strain = np.moveaxis(strain, axis, 0)
    normal = [k for k, row in enumerate(STRAIN_ROWS[space.kind]) if row < 3]
    stress = strain * shear
    stress[normal] *= 2.0
    stress[normal] += lame * strain[normal].sum(axis=0)
    return np.moveaxis(stress, 0, axis)


def full_stress(
    space: ModelSpace, strain: FloatArray, properties: EffectiveProperties, warming_K: FloatArray
) -> FloatArray:
    """All six stresses xx, yy, zz, xy, yz, xz, (..., 6) [MPa], of strains (..., strains).

    warming_K : (...), temperature above the stress-free one
    """
    found = np.zeros((*strain.shape[:-1], 6))
    found[..., list(STRAIN_ROWS[space.kind])] = apply_elasticity(
        space, strain, properties.lame_MPa, properties.shear_MPa)
    if space.kind == "plane-strain":
        found[..., 2] = properties.lame_MPa * strain[..., :2].sum(axis=-1)
    found[..., list(STRESSED_AXES[space.kind])] -= (
        properties.thermal_stress_MPa_K * warming_K)[..., None]
    return found


class _NodePattern:
    """Where each pair of an element's nodes lies among the entries of a matrix."""

    def __init__(self, element_nodes: IntArray, n_nodes: int) -> None:
        a = element_nodes.shape[1]
        rows = np.repeat(element_nodes, a, axis=1).ravel()
        columns = np.tile(element_nodes, (1, a)).ravel()
        keys, place = np.unique(rows * np.int64(n_nodes) + columns, return_inverse=True)
        self._place = place.astype(np.int32)
        self._columns = (keys % n_nodes).astype(np.int32)
        counts = np.bincount(keys // n_nodes, minlength=n_nodes)
        self._starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        self._n_nodes = n_nodes

    def scalar_matrix(self, local: FloatArray) -> csr_array:
        data = np.bincount(self._place, local.ravel(), minlength=len(self._columns))
        return csr_array((data, self._columns.copy(), self._starts.copy()),
                         shape=(self._n_nodes, self._n_nodes))

    def block_matrix(self, local: FloatArray, dim: int) -> bsr_array:
        n, size = local.shape[0], local.shape[1] // dim
        parts = local.reshape(n, size, dim, size, dim)
        data = np.empty((len(self._columns), dim, dim))
        for i in range(dim):
            for j in range(dim):
                data[:, i, j] = np.bincount(self._place, parts[:, :, i, :, j].ravel(),
                                            minlength=len(self._columns))
        size_all = self._n_nodes * dim
        return bsr_array((data, self._columns.copy(), self._starts.copy()),
                         shape=(size_all, size_all), blocksize=(dim, dim))
