"""From a part file to a model: its mesh, its faces, its loads and supports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import BoolArray, FloatArray
from lmctl.config.composition import SurfaceFeature
from lmctl.config.part_file import PartFile
from lmctl.config.simulation import WHOLE_SURFACE, FaceSettings, SimulationSettings
from lmctl.design.conditions import ModelConditions
from lmctl.design.discretisation import Discretisation
from lmctl.design.effective_properties import MixingRules
from lmctl.design.fitted_mesh import fit_mesh
from lmctl.design.linear_solver import BYTES_PER_UNKNOWN
from lmctl.design.model_space import ModelSpace
from lmctl.design.performance_model import PerformanceModel
from lmctl.design.phases import phase_constants
from lmctl.design.surface_facets import SurfaceFacets
from lmctl.errors import InputError
from lmctl.part.load import MeasuredPart
from lmctl.part.part import Part

#: An element's edge, as a share of the part's greatest extent, where the file states none.
_DEFAULT_MESH_SHARE = 0.05

#: How far a facet's corners may lie from a face's feature, as a share of an element.
_ON_FACE_SHARE = 0.05

#: A composition that changes by more than this within an element is coarsely resolved.
COARSE_CHANGE = 0.25

#: Nodes of a solid mesh a cell of its lattice makes, and the lattice's cell over the edge length.
_NODES_PER_CELL = {2: 8.0, 3: 16.0}
_CELL_PER_EDGE = {2: 1.2, 3: 1.15}

#: Seconds a million unknowns take to solve, on one core of 2024: direct in 2D, multigrid in 3D.
_SOLVE_S_PER_UNKNOWN = {2: 3e-5, 3: 1.5e-4}


@dataclass(frozen=True)
class ModelCost:
    """What a solution will take, estimated from the part's volume and the mesh size.

    memory_bytes, solve_s : of one solution
    """

    unknowns: int
    elements: int
    memory_bytes: float
    solve_s: float


def model_space_of(part: Part, settings: SimulationSettings) -> ModelSpace:
    """The space of a part's simulation; what is not stated is taken from its bounds."""
    low, high = part.bounds_mm
    section = settings.section_mm
    section = 0.5 * float(low[2] + high[2]) if section is None else section
    if settings.model in ("plane-stress", "plane-strain") and not low[2] <= section <= high[2]:
        raise InputError(f"the plane z = {section:g} mm does not meet the part",
                         where=f"the part is from {low[2]:g} to {high[2]:g} mm",
                         hint="change section_mm in [simulation]")
    thickness = settings.thickness_mm or float(high[2] - low[2])
    return ModelSpace(settings.model, section, thickness)


def mesh_size_of(part: Part, settings: SimulationSettings) -> float:
    """The edge length of elements [mm], stated or taken from the part's size."""
    low, high = part.bounds_mm
    return settings.mesh_mm or _DEFAULT_MESH_SHARE * float((high - low).max())


def model_cost(part: Part, settings: SimulationSettings) -> ModelCost:
    """What a simulation will take, before a mesh is made."""
    space, size = model_space_of(part, settings), mesh_size_of(part, settings)
    low, high = space.box(*part.bounds_mm)
    rng = np.random.default_rng(0)
    probes = low + (high - low) * rng.random((20_000, space.dim))
    inside = space.section_distance(part.body.distance_at)(probes) > 0
    volume = float(inside.mean() * np.prod(high - low))
    cells = volume / (size * _CELL_PER_EDGE[space.dim]) ** space.dim
    unknowns = int(space.dim * _NODES_PER_CELL[space.dim] * cells)
    return ModelCost(
        unknowns, int(cells * (4 if space.dim == 2 else 12)),
        unknowns * BYTES_PER_UNKNOWN[space.dim], unknowns * _SOLVE_S_PER_UNKNOWN[space.dim])


def build_model(measured: MeasuredPart) -> PerformanceModel:
    """The model that a part file states.

    Raises ConfigError (constants of materials) and InputError (mesh, faces, supports, loads).
    """
    part, file = measured.part, measured.file
    settings = file.simulation
    phases = phase_constants(file.material)
    names = list(phases.names)
    rules = MixingRules(
        settings.elastic, settings.conduction,
        0 if settings.matrix is None else names.index(settings.matrix), settings.transfer_GPa)
    space = model_space_of(part, settings)
    low, high = space.box(*part.bounds_mm)
    fitted = fit_mesh(space.section_distance(part.body.distance_at), low, high,
                      mesh_size_of(part, settings),
                      (True, False) if space.kind == "axisymmetric" else ())
    discretisation = Discretisation(fitted, space)
    facets = SurfaceFacets(discretisation)
    conditions = ModelConditions(discretisation, facets)
    conditions.stress_free_C = settings.stress_free_C
    conditions.uniform_C = (settings.stress_free_C if settings.temperature_C is None
                            else settings.temperature_C)
    chosen = _FaceFinder(measured, space, facets)
    _apply(file, conditions, chosen, space)
    balanced = bool(file.support) and all(support.rigid_motion for support in file.support)
    conditions.check(balanced=balanced)
    return PerformanceModel(conditions, phases, rules)


def _apply(
    file: PartFile, conditions: ModelConditions, faces: _FaceFinder, space: ModelSpace
) -> None:
    for load in file.load:
        chosen = faces.find(load.on)
        if load.pressure_MPa is not None:
            conditions.add_pressure(chosen, load.pressure_MPa)
        elif load.traction_MPa is not None:
            conditions.add_traction(chosen, [load.traction_MPa[k] for k in space.part_axes])
        elif load.force_N is not None:
            conditions.add_force(chosen, [load.force_N[k] for k in space.part_axes])
    for support in file.support:
        if support.rigid_motion:
            conditions.hold_rigid_motion()
        elif support.on is not None:
            axes = [space.axis_names.index(axis) for axis in support.fix]
            conditions.hold(faces.find(support.on), axes, support.at_mm)
    for heat in file.heat:
        chosen = faces.find(heat.on)
        if heat.temperature_C is not None:
            conditions.hold_temperature(chosen, heat.temperature_C)
        elif heat.flux_W_mm2 is not None:
            conditions.add_heat_flux(chosen, heat.flux_W_mm2)
        elif heat.film_W_mm2_K is not None and heat.ambient_C is not None:
            conditions.add_exchange(chosen, heat.film_W_mm2_K, heat.ambient_C)


class _FaceFinder:
    """Facets of the mesh by the name of a face, of a body, or of the whole surface."""

    def __init__(self, measured: MeasuredPart, space: ModelSpace, facets: SurfaceFacets) -> None:
        self._measured, self._space, self._facets = measured, space, facets
        self._size_mm = facets.discretisation.fitted.size_mm

    def find(self, name: str) -> BoolArray:
        """Which facets a face has. Raises InputError where it has none."""
        count = len(self._facets.facets)
        if name == WHOLE_SURFACE:
            return np.ones(count, dtype=bool)
        face = next((face for face in self._measured.file.face if face.name == name), None)
        if face is None:  # a body, which the rules of part files have made sure of
            face = FaceSettings(name=name, feature=SurfaceFeature(kind="surface", of=name))
        chosen = self._on_feature(face) & self._facing(face)
        if not chosen.any():
            raise InputError(
                f"no place of the surface is on the face {name!r}",
                where=f"{count} facets were tried, with edges of {self._size_mm:.3g} mm",
                hint="loads act on nothing there; widen its at_mm, turn its facing, or lower "
                "mesh_mm")
        return chosen

    def _on_feature(self, face: FaceSettings) -> BoolArray:
        corners = self._facets.corners_mm
        distance = self._measured.feature(face.feature).distance(
            self._space.part_points(corners.reshape(-1, self._space.dim)))
        slack = _ON_FACE_SHARE * self._size_mm
        low, high = face.at_mm or (0.0, 0.0)
        near = (distance >= low - slack) & (distance <= high + slack)
        return np.asarray(near.reshape(corners.shape[:2]).all(axis=1))

    def _facing(self, face: FaceSettings) -> BoolArray:
        normals = self._facets.normals
        if face.facing is None:
            return np.ones(len(normals), dtype=bool)
        way: Sequence[float] = [face.facing[axis] for axis in self._space.part_axes]
        cosine = normals @ (np.asarray(way) / max(float(np.linalg.norm(way)), 1e-300))
        angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        return np.asarray((angle >= face.angle_deg[0]) & (angle <= face.angle_deg[1]))


def coarse_share(model: PerformanceModel, fractions: FloatArray) -> tuple[float, float]:
    """How far a mesh resolves a composition.

    returns : the largest change of a fraction within an element, and the share of the volume in
        elements where it changes by more than `COARSE_CHANGE`
    """
    change = np.ptp(fractions, axis=1).max(axis=1)
    volume = model.discretisation.weights.sum(axis=1)
    return float(change.max()), float(volume[change > COARSE_CHANGE].sum() / volume.sum())
