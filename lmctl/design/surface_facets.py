"""The boundary of a mesh: which facets lie on a named face, and integrals over them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from skfem import FacetBasis

from lmctl.array_types import BoolArray, FloatArray, IntArray
from lmctl.design.discretisation import Discretisation

_FACET_ORDER = 4


@dataclass(frozen=True, eq=False)
class FacetIntegrals:
    """Integration over some facets.

    nodes : (f, a), the nodes of the element behind each facet; shapes : (f, q, a)
    weights : (f, q), area [mm²]; normals : (f, q, dim), outwards; places_mm : (f, q, dim)
    """

    nodes: IntArray
    shapes: FloatArray
    weights: FloatArray
    normals: FloatArray
    places_mm: FloatArray

    @property
    def area_mm2(self) -> float:
        """Of all the facets, of the model's thickness or all the way round."""
        return float(self.weights.sum())


class SurfaceFacets:
    """All boundary facets of a discretised part.

    corners_mm : (f, dim, dim), of each facet; normals : (f, dim), outwards
    """

    def __init__(self, discretisation: Discretisation) -> None:
        self.discretisation = discretisation
        mesh = discretisation.fitted.mesh
        facets = np.asarray(mesh.boundary_facets())
        corners = np.moveaxis(mesh.p[:, mesh.facets[:, facets]], 0, -1).swapaxes(0, 1)
        if discretisation.space.kind == "axisymmetric":  # the axis itself is no surface
            away = corners[:, :, 0].max(axis=1) > 1e-9 * float(np.abs(mesh.p).max())
            facets, corners = facets[away], corners[away]
        self.facets: IntArray = facets
        self.corners_mm: FloatArray = corners

    @cached_property
    def normals(self) -> FloatArray:
        """(f, dim), outwards, of length 1, in the middle of each facet."""
        found = self.integrals(np.ones(len(self.facets), dtype=bool)).normals.mean(axis=1)
        return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))

    def nodes_of(self, chosen: BoolArray) -> IntArray:
        """Numbers of the nodes of chosen facets, each once, middles too."""
        basis = self._basis(self.facets[chosen])
        if basis is None:
            return np.empty(0, dtype=np.int64)
        found = basis.get_dofs(self.facets[chosen]).flatten()
        return np.asarray(found, dtype=np.int64)

    def integrals(self, chosen: BoolArray) -> FacetIntegrals:
        """Integration over chosen facets (f,) bool, at least one."""
        basis = self._basis(self.facets[chosen])
        assert basis is not None, "at least one facet"
        places = np.moveaxis(np.asarray(basis.global_coordinates()), 0, -1)
        shapes = np.stack([np.broadcast_to(np.asarray(field[0]), places.shape[:2])
                           for field in basis.basis], axis=-1)
        return FacetIntegrals(
            np.ascontiguousarray(basis.element_dofs.T, dtype=np.int64), shapes,
            basis.dx * self.discretisation.space.measure(places),
            np.moveaxis(np.asarray(basis.normals), 0, -1), places)

    def _basis(self, facets: IntArray) -> FacetBasis | None:
        if len(facets) == 0:
            return None
        d = self.discretisation
        return FacetBasis(d.fitted.mesh, d.element, facets=facets, intorder=_FACET_ORDER)
