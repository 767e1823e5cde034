"""Cases with known answers: each returns the largest error of the simulation, as a share.

Used by the tests on coarse meshes and by the benchmark on fine ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from lmctl.array_types import FloatArray
from lmctl.config.part_file import MaterialSettings
from lmctl.design.conditions import ModelConditions
from lmctl.design.discretisation import Discretisation
from lmctl.design.effective_properties import MixingRules, ModelKind, effective_properties
from lmctl.design.fitted_mesh import fit_mesh
from lmctl.design.model_space import ModelSpace
from lmctl.design.performance_model import PerformanceModel, PerformanceSolution
from lmctl.design.phases import PhaseConstants, phase_constants
from lmctl.design.recovery import RecoveredFields, recover_fields
from lmctl.design.surface_facets import SurfaceFacets

Composition = Callable[[FloatArray], FloatArray]

STEEL = MaterialSettings(name="316L", elastic_modulus_GPa=200, poisson_ratio=0.3)
HARD = MaterialSettings(name="WC-12Co", elastic_modulus_GPa=600, poisson_ratio=0.3)
SOFT_AND_HARD = phase_constants((STEEL, HARD))
ALUMINIUM_ZIRCONIA = phase_constants((MaterialSettings(name="Al"), MaterialSettings(name="ZrO2")))

#: Exponent of the modulus that the cylinder's hoop stress is least at, of all powers.
BETA = 1.274


def pure(points: FloatArray) -> FloatArray:
    return np.tile([1.0, 0.0], (len(points), 1))


def box_distance(low: FloatArray, high: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Exact inside, an upper bound of no use but its sign outside."""
    return lambda p: np.minimum(p - low, high - p).min(axis=1)


def conditions_of(
    distance: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray, size_mm: float,
    kind: ModelKind, flat_low: tuple[bool, ...] = (),
) -> ModelConditions:
    space = ModelSpace(kind)
    d = Discretisation(fit_mesh(distance, low, high, size_mm, flat_low), space)
    return ModelConditions(d, SurfaceFacets(d))


@dataclass(frozen=True)
class Solved:
    model: PerformanceModel
    solution: PerformanceSolution
    fields: RecoveredFields


def solved(conditions: ModelConditions, composition: Composition, phases: PhaseConstants,
           rules: MixingRules) -> Solved:
    conditions.check()
    model = PerformanceModel(conditions, phases, rules)
    solution = model.solve(model.fractions_of(composition))
    return Solved(model, solution, recover_fields(model, solution, composition))


def patch_error(kind: ModelKind, size_mm: float) -> float:
    """A linear displacement given on the boundary is met inside, with its constant stress."""
    dim = 3 if kind == "solid" else 2
    low, high = np.zeros(dim), np.array([7.0, 5.0, 4.0][:dim])
    cut = np.full(dim, 0.5) / np.sqrt(dim)

    def distance(p: FloatArray) -> FloatArray:  # a box with a ball cut from its corner
        return np.minimum(box_distance(low, high)(p), np.linalg.norm(p - cut, axis=1) - 1.7)

    conditions = conditions_of(distance, low, high, size_mm, kind)
    everywhere = np.ones(len(conditions.facets.facets), dtype=bool)
    nodes = conditions.facets.nodes_of(everywhere)
    slope = 1e-3 * np.arange(1, dim * dim + 1).reshape(dim, dim) * np.array([1, -1, 1][:dim])
    exact = conditions.discretisation.nodes_mm @ slope.T
    conditions.held[nodes] = True
    conditions.held_mm[nodes] = exact[nodes]
    found = solved(conditions, pure, SOFT_AND_HARD, MixingRules("voigt"))
    off = np.abs(found.solution.displacement_mm - exact).max() / np.abs(exact).max()
    stress = found.solution.stress_MPa
    uneven = np.ptp(stress, axis=(0, 1)).max() / np.abs(stress).max()
    return float(max(off, uneven))


def power_composition(beta: float, inner_mm: float = 40.0) -> Composition:
    """Voigt modulus E0 (r/a)^β from 200 GPa, of materials with 200 and 600 GPa."""
    def composition(points: FloatArray) -> FloatArray:
        hard = ((np.hypot(points[:, 0], points[:, 1]) / inner_mm) ** beta - 1) / 2
        return np.stack([1 - hard, hard], axis=1)
    return composition


def ring_distance(inner_mm: float, outer_mm: float) -> Callable[[FloatArray], FloatArray]:
    def distance(p: FloatArray) -> FloatArray:
        r = np.hypot(p[:, 0], p[:, 1])
        return np.minimum(r - inner_mm, outer_mm - r)
    return distance


def pressed_ring(size_mm: float, kind: ModelKind = "plane-stress") -> ModelConditions:
    """b/a = 80/40, 1 MPa inside."""
    conditions = conditions_of(ring_distance(40, 80), np.full(2, -80.0), np.full(2, 80.0), size_mm,
                               kind)
    middle = conditions.facets.corners_mm.mean(axis=1)
    conditions.add_pressure(np.hypot(*middle.T) < 60, 1.0)
    conditions.hold_rigid_motion()
    return conditions


@dataclass(frozen=True)
class GradedRing:
    """Plane stress, E = E0 (r/a)^β, 1 MPa inside (Horgan and Chan, J. Elast. 55 (1999) 43-59)."""

    beta: float
    modulus_MPa: float = 200e3
    poisson: float = 0.3

    def at(self, r: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Displacement, radial and hoop stress."""
        a, b, nu, beta = 40.0, 80.0, self.poisson, self.beta
        root = np.sqrt(beta**2 + 4 - 4 * nu * beta)
        m = np.array([(-beta + root) / 2, (-beta - root) / 2])
        scale = self.modulus_MPa / (1 - nu**2)
        radial = [[scale * (x / a) ** beta * (k + nu) * x ** (k - 1) for k in m] for x in (a, b)]
        c = np.linalg.solve(np.array(radial), [-1.0, 0.0])
        u = sum(ck * r**k for ck, k in zip(c, m, strict=True))
        e = scale * (r / a) ** beta
        sr = e * sum(ck * (k + nu) * r ** (k - 1) for ck, k in zip(c, m, strict=True))
        st = e * sum(ck * (1 + nu * k) * r ** (k - 1) for ck, k in zip(c, m, strict=True))
        return u, sr, st


def ring_errors(size_mm: float, beta: float) -> tuple[float, float, float]:
    """Root mean square error of displacement and stress, and the largest hoop stress's share."""
    composition = power_composition(beta) if beta else pure
    found = solved(pressed_ring(size_mm), composition, SOFT_AND_HARD, MixingRules("voigt"))
    d = found.model.discretisation
    exact = GradedRing(beta)
    places = d.places_mm.reshape(-1, 2)
    r = np.hypot(*places.T)
    u, sr, st = exact.at(r)
    way = places / r[:, None]
    moved = np.stack([d.at_places(found.solution.displacement_mm[:, k]).ravel()
                      for k in range(2)], axis=1)
    w = d.weights.ravel()
    free = np.stack([np.ones_like(r), np.zeros_like(r), -places[:, 1],
                     np.zeros_like(r), np.ones_like(r), places[:, 0]], axis=1).reshape(-1, 2, 3)
    off = moved - u[:, None] * way
    left = free.reshape(-1, 3)
    rigid = np.linalg.lstsq(left, off.ravel(), rcond=None)[0]
    off = off - (left @ rigid).reshape(-1, 2)
    displacement = np.sqrt((w * (off**2).sum(axis=1)).sum() / (w * u**2).sum())
    tensor = found.solution.stress_MPa.reshape(-1, 6)
    x, y = way.T
    hoop = tensor[:, 0] * y**2 + tensor[:, 1] * x**2 - 2 * tensor[:, 3] * x * y
    radial = tensor[:, 0] * x**2 + tensor[:, 1] * y**2 + 2 * tensor[:, 3] * x * y
    stress = np.sqrt((w * ((hoop - st) ** 2 + (radial - sr) ** 2)).sum()
                     / (w * (st**2 + sr**2)).sum())
    peak = largest_hoop(found.fields.stress_MPa, d.nodes_mm)
    expected = exact.at(np.linspace(40, 80, 2001))[2].max()
    return float(displacement), float(stress), float(abs(peak / expected - 1))


def largest_hoop(stress: FloatArray, points: FloatArray) -> float:
    """The largest stress around the origin."""
    x, y = (points[:, :2] / np.hypot(points[:, 0], points[:, 1])[:, None]).T
    hoop = stress[:, 0] * y**2 + stress[:, 1] * x**2 - 2 * stress[:, 3] * x * y
    return float(hoop.max())


def thick_tube_error(size_mm: float) -> float:
    """Lamé's tube in axisymmetry between smooth end faces: plane strain, so u is known."""
    low, high = np.array([0.0, 0.0]), np.array([80.0, 20.0])

    def distance(p: FloatArray) -> FloatArray:
        return np.minimum(np.minimum(p[:, 0] - 40, 80 - p[:, 0]), np.minimum(p[:, 1], 20 - p[:, 1]))

    conditions = conditions_of(distance, low, high, size_mm, "axisymmetric", (True, False))
    corners = conditions.facets.corners_mm
    conditions.add_pressure((np.abs(corners[:, :, 0] - 40) < 1e-6).all(axis=1), 1.0)
    for z in (0.0, 20.0):
        conditions.hold((np.abs(corners[:, :, 1] - z) < 1e-9).all(axis=1), [1])
    found = solved(conditions, pure, SOFT_AND_HARD, MixingRules("voigt"))
    nodes, e, nu = found.model.discretisation.nodes_mm, 200e3, 0.3
    r = nodes[:, 0]
    factor = 40.0**2 / (80.0**2 - 40.0**2)
    u = (1 + nu) / e * factor * ((1 - 2 * nu) * r + 80.0**2 / r)
    hoop = factor * (1 + 80.0**2 / r**2)
    off = np.abs(found.solution.displacement_mm[:, 0] - u).max() / u.max()
    wrong = np.abs(found.fields.stress_MPa[:, 1] - hoop).max() / hoop.max()
    return float(max(off, wrong))


def bilayer_error(size_mm: float) -> float:
    """Curvature of a strip of two metals (Timoshenko, J. Opt. Soc. Am. 11 (1925) 233, Eq. 4)."""
    length, thickness, warming = 80.0, 4.0, 100.0
    low, high = np.zeros(2), np.array([length, thickness])
    phases = replace(SOFT_AND_HARD, expansion_1_K=np.array([16e-6, 6e-6]))

    def composition(points: FloatArray) -> FloatArray:
        hard = (points[:, 1] > thickness / 2).astype(float)
        return np.stack([1 - hard, hard], axis=1)

    conditions = conditions_of(box_distance(low, high), low, high, size_mm, "plane-stress")
    conditions.hold_rigid_motion()
    conditions.stress_free_C, conditions.uniform_C = 20.0, 20.0 + warming
    found = solved(conditions, composition, phases, MixingRules("voigt"))
    nodes, moved = found.model.discretisation.nodes_mm, found.solution.displacement_mm
    middle = (np.abs(nodes[:, 1] - thickness / 2) < 1e-9) & (np.abs(nodes[:, 0] - length / 2) < 20)
    curvature = 2 * np.polyfit(nodes[middle, 0], moved[middle, 1], 2)[0]
    m, n = 1.0, 200.0 / 600.0
    exact = 6 * 10e-6 * warming * (1 + m) ** 2 / (
        thickness * (3 * (1 + m) ** 2 + (1 + m * n) * (m**2 + 1 / (m * n))))
    return float(abs(abs(curvature) / exact - 1))


def heated_plate_error(size_mm: float, exponent: float) -> float:
    """A plate of Al and ZrO2, V = (y/t)^n, 20 °C below and 300 °C above, against quadrature.

    The plate's edges are held, so that a narrow piece of it says all: temperature is that of
    resistances in series, stress −E α ΔT. Temperature as a share of the difference, stress of the
    largest.
    """
    width, thickness = 4 * size_mm, 10.0
    low, high = np.zeros(2), np.array([width, thickness])

    def ceramic(y: FloatArray) -> FloatArray:
        return np.clip(y / thickness, 0.0, 1.0) ** exponent

    def composition(points: FloatArray) -> FloatArray:
        v = ceramic(points[:, 1])
        return np.stack([1 - v, v], axis=1)

    conditions = conditions_of(box_distance(low, high), low, high, size_mm, "plane-stress")
    corners = conditions.facets.corners_mm

    def side(axis: int, at: float) -> NDArray[np.bool_]:
        return (np.abs(corners[:, :, axis] - at) < 1e-9).all(axis=1)

    conditions.hold_temperature(side(1, 0.0), 20.0)
    conditions.hold_temperature(side(1, thickness), 300.0)
    for x in (0.0, width):
        conditions.hold(side(0, x), [0])
    conditions.hold(side(1, 0.0), [1])
    rules = MixingRules("mori-tanaka", "maxwell-eucken")
    found = solved(conditions, composition, ALUMINIUM_ZIRCONIA, rules)
    y = thickness * (1 - (1 - np.linspace(0, 1, 400_001) ** 2) ** 2)  # fine at both ends
    v = ceramic(y)
    of = effective_properties(np.stack([1 - v, v], axis=1), ALUMINIUM_ZIRCONIA, rules, "solid")
    through = cumulative_trapezoid(1 / of.conductivity_W_mm_K, y, initial=0.0)
    temperature = 20 + 280 * through / through[-1]
    d = found.model.discretisation
    at = np.interp(d.nodes_mm[:, 1], y, temperature)
    off = np.abs(found.solution.temperature_C - at).max() / 280
    bulk = of.lame_MPa + 2 / 3 * of.shear_MPa
    expansion = of.thermal_stress_MPa_K / (3 * bulk)
    exact = -of.elastic_modulus_MPa * expansion * (temperature - 20)
    wrong = np.abs(found.solution.stress_MPa[..., 0] - np.interp(d.places_mm[..., 1], y, exact))
    return float(max(off, wrong.max() / np.abs(exact).max()))
