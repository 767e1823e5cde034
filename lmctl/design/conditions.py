"""Loads, supports and heat of a model, as arrays on its mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import qr

from lmctl.array_types import BoolArray, FloatArray
from lmctl.design.discretisation import Discretisation
from lmctl.design.surface_facets import FacetIntegrals, SurfaceFacets
from lmctl.errors import InputError

#: A motion that the supports leave free: share of its size that they hold.
_HELD_SHARE = 1e-6

#: Loads of a part that hangs on nothing must balance to this share of their size.
_BALANCE = 1e-3


@dataclass(frozen=True, eq=False)
class HeatExchange:
    """Heat passing through facets by a film: film_W_mm2_K times what ambient_C is above them."""

    integrals: FacetIntegrals
    film_W_mm2_K: float
    ambient_C: float


@dataclass(eq=False)
class ModelConditions:
    """What acts on the nodes of a discretised part; filled by the methods, in any order.

    force_N : (n_nodes, dim); held, held_mm : (n_nodes, dim), which displacements are given
    heat_W : (n_nodes,); fixed_temperature, fixed_C : (n_nodes,)
    stress_free_C : where there is no thermal stress; uniform_C : without a heat problem
    """

    discretisation: Discretisation
    facets: SurfaceFacets
    stress_free_C: float = 20.0
    uniform_C: float = 20.0
    exchanges: list[HeatExchange] = field(default_factory=list)

    def __post_init__(self) -> None:
        n, dim = self.discretisation.n_nodes, self.discretisation.space.dim
        self.force_N: FloatArray = np.zeros((n, dim))
        self.held: BoolArray = np.zeros((n, dim), dtype=bool)
        self.held_mm: FloatArray = np.zeros((n, dim))
        self.heat_W: FloatArray = np.zeros(n)
        self.fixed_temperature: BoolArray = np.zeros(n, dtype=bool)
        self.fixed_C: FloatArray = np.zeros(n)

    @property
    def has_heat_problem(self) -> bool:
        """Whether temperatures have to be solved for."""
        return bool(self.fixed_temperature.any() or self.exchanges)

    def add_traction(self, chosen: BoolArray, traction_MPa: Sequence[float]) -> None:
        """A stress vector (dim,) on chosen facets."""
        of = self.facets.integrals(chosen)
        for axis, value in enumerate(traction_MPa):
            self.force_N[:, axis] += self._spread(of, np.full(of.weights.shape, value))

    def add_pressure(self, chosen: BoolArray, pressure_MPa: float) -> None:
        """A pressure: positive pushes into the solid."""
        of = self.facets.integrals(chosen)
        for axis in range(self.force_N.shape[1]):
            self.force_N[:, axis] += self._spread(of, -pressure_MPa * of.normals[..., axis])

    def add_force(self, chosen: BoolArray, force_N: Sequence[float]) -> None:
        """A force (dim,), spread evenly over chosen facets."""
        area = self.facets.integrals(chosen).area_mm2
        self.add_traction(chosen, [value / area for value in force_N])

    def hold(self, chosen: BoolArray, axes: Sequence[int], at_mm: float = 0.0) -> None:
        """Displacement along axes given on chosen facets."""
        nodes = self.facets.nodes_of(chosen)
        for axis in axes:
            self.held[nodes, axis] = True
            self.held_mm[nodes, axis] = at_mm

    def hold_rigid_motion(self) -> None:
        """As few displacements held as stop rigid motion: loads that balance feel nothing of it."""
        space = self.discretisation.space
        motions = space.rigid_motions(self.discretisation.nodes_mm)
        n, dim, count = motions.shape
        scale = np.abs(motions).reshape(-1, count).max(axis=0)
        _, _, order = qr(motions.reshape(n * dim, count).T / scale[:, None], mode="economic",
                         pivoting=True)
        self.held.ravel()[order[:count]] = True

    def hold_temperature(self, chosen: BoolArray, temperature_C: float) -> None:
        """Temperature given on chosen facets."""
        nodes = self.facets.nodes_of(chosen)
        self.fixed_temperature[nodes] = True
        self.fixed_C[nodes] = temperature_C

    def add_heat_flux(self, chosen: BoolArray, flux_W_mm2: float) -> None:
        """Heat into the solid through chosen facets."""
        of = self.facets.integrals(chosen)
        self.heat_W += self._spread(of, np.full(of.weights.shape, flux_W_mm2))

    def add_exchange(self, chosen: BoolArray, film_W_mm2_K: float, ambient_C: float) -> None:
        """Heat exchanged with a medium through chosen facets."""
        self.exchanges.append(
            HeatExchange(self.facets.integrals(chosen), film_W_mm2_K, ambient_C))

    def check(self, *, balanced: bool = False) -> None:
        """Raise InputError where the part can move as a whole, or heat has nowhere to go.

        balanced : whether only rigid motion is held, so that loads have to balance
        """
        space = self.discretisation.space
        motions = space.rigid_motions(self.discretisation.nodes_mm)
        count = motions.shape[2]
        scaled = motions / np.abs(motions).reshape(-1, count).max(axis=0)
        held = scaled[self.held]
        _, size, directions = np.linalg.svd(held.T @ held if len(held) else np.zeros((count,) * 2))
        loose = directions[size <= _HELD_SHARE * max(float(size.max()), 1.0)]
        if len(loose):
            names = [space.motion_names[int(np.abs(way).argmax())] for way in loose]
            raise InputError("nothing holds the part: it can move as a whole",
                             where=f"free: {', '.join(dict.fromkeys(names))}",
                             hint='add a [[support]]; `rigid_motion = true` holds a part whose '
                             "loads balance")
        if balanced:
            rest = np.abs(np.einsum("nd,ndk->k", self.force_N, scaled))
            total = np.abs(np.einsum("nd,ndk->nk", self.force_N, scaled)).sum(axis=0)
            if (rest > _BALANCE * max(float(total.max()), 1e-300)).any():
                worst = int(rest.argmax())
                raise InputError(
                    "the loads do not balance, and nothing but rigid motion is held",
                    where=f"{rest[worst]:.4g} N are left over, as {space.motion_names[worst]}",
                    hint="support a face that takes this force")
        if self.heat_W.any() and not self.has_heat_problem:
            raise InputError("heat enters and has nowhere to go",
                             hint="give a [[heat]] table a temperature_C or a film_W_mm2_K")

    def _spread(self, of: FacetIntegrals, density: FloatArray) -> FloatArray:
        local = np.einsum("fq,fqa->fa", of.weights * density, of.shapes)
        n_nodes = self.discretisation.n_nodes
        return np.asarray(np.bincount(of.nodes.ravel(), local.ravel(), n_nodes), dtype=np.float64)
