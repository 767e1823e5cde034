"""A part: depth inside its solid, and composition; the whole interface to planning."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.config.part_file import ProcessSettings
from lmctl.config.substrate import SubstrateSettings
from lmctl.field.grid import Grid, Window
from lmctl.field.outline_distance import plane_distance
from lmctl.field.plane import PlaneGrid
from lmctl.part.bodies.body import Body, plane_points
from lmctl.part.bodies.measured import Bounds
from lmctl.part.materials.build_heat import BuildHeat
from lmctl.part.materials.composition import CompositionField, UniformComposition
from lmctl.part.materials.powders import MaterialSpec
from lmctl.part.named_bodies import NO_NAMED_BODIES, NamedBodies
from lmctl.part.turning_heights import turning_heights_mm

if TYPE_CHECKING:
    from lmctl.part.copies import PartCopy
    from lmctl.part.materials.alloy_rules import AlloyRules
    from lmctl.part.materials.laid_mixtures import LaidMixtures
    from lmctl.part.substrate import LayerStack, SubstrateSurface

#: Points of a composition evaluated at a time: keeps temporaries in tens of megabytes.
POINTS_AT_ONCE = 500_000


@dataclass(frozen=True)
class PartSection:
    """The part in one plane, in its own coordinates.

    loops : the outline, closed loops (k, 2) float64 [mm], first point repeated last, the inside
        on the left; empty where the plane misses the part
    """

    z_mm: float
    grid: PlaneGrid
    loops: list[FloatArray]
    body: Body

    @cached_property
    def in_plane_distance(self) -> NDArray[np.float32]:
        """(ny, nx) float32 [mm]: in-plane signed distance to the outline, positive inside.

        Computed anew in the plane at each call; −inf everywhere where there is no outline.
        """
        return plane_distance(self.loops, self.grid)

    @cached_property
    def spatial_distance(self) -> NDArray[np.float32]:
        """(ny, nx) float32 [mm]: the 3D signed distance in this plane, made when asked for.

        Its iso-levels are the paper's literal toolpaths (the strategy "iso-3d").
        """
        depth = self.body.distance_at(plane_points(self.grid, self.z_mm))
        return depth.astype(np.float32).reshape(self.grid.shape)


@dataclass(frozen=True)
class Part:
    """A checked part, ready to be planned; coordinates are the part file's own, before placement.

    text : the part file's text (made up for a bare mesh or cloud)
    sources : {data file as the part file names it: sha256}
    placement_mm : where the part's origin lies in program coordinates; None: centred on the
        platform, its lowest point at z = 0
    warnings : what is doubtful; notes : what was taken by default; each for the user
    grid : around the solid; `plane` : of every section
    surface_error_mm : of surfaces fitted to clouds, estimated from their samples; None where no
        tolerance is stated or nothing is fitted
    named_bodies : those it is made of
    strategy_bodies : by name, those that the process gives a strategy of their own
    substrate : what the first layer is deposited on
    substrate_surface : of a substrate with a shape; None: a level plate under its lowest point
    copies : that stand on the plate; none: the part alone
    layer_stack : where coordinates are (x, y, u) of `substrate.flattened_part`, how its layers lie
    alloy_rules : mixtures that must not be deposited; None where the part has no rules
    build_heat : what a prediction of temperature needs; None where none is asked for
    """

    name: str
    text: str
    sources: Mapping[str, str]
    materials: tuple[MaterialSpec, ...]
    process: ProcessSettings
    placement_mm: tuple[float, float, float] | None
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    body: Body
    composition_field: CompositionField
    grid: Grid
    plane: PlaneGrid
    surface_error_mm: float | None = None
    named_bodies: NamedBodies = NO_NAMED_BODIES
    strategy_bodies: Mapping[str, Body] = field(default_factory=dict)
    substrate: SubstrateSettings = field(default_factory=SubstrateSettings)
    substrate_surface: SubstrateSurface | None = None
    layer_stack: LayerStack | None = None
    copies: tuple[PartCopy, ...] = ()
    alloy_rules: AlloyRules | None = None
    build_heat: BuildHeat | None = None

    @property
    def bounds_mm(self) -> Bounds:
        """Lowest and highest x, y, z of the solid, each (3,) float64 [mm]."""
        return self.body.tight_bounds_mm

    @cached_property
    def turning_heights_mm(self) -> FloatArray:
        """Rising heights at which something of the solid begins or ends, (h,) float64 [mm]."""
        return turning_heights_mm(self.body)

    def distance(self, window: Window) -> NDArray[np.float32]:
        """Signed distance at the nodes of a slab, positive inside; float32 of window.shape [mm]."""
        return self.body.distance(window)

    def section(self, z_mm: float) -> PartSection:
        """The outline and the in-plane distance at height z of the part.

        Meshes are cut from their triangles, formulas are evaluated in the plane, fields are
        interpolated between their nodes; outlines of booleans are cut from these as polygons.
        """
        loops = self.body.outline_loops(z_mm, self.plane)
        return PartSection(z_mm, self.plane, loops, self.body)

    def uniform_mixture(self) -> tuple[float, ...] | None:
        """The volume fractions of all of the part, where they are the same everywhere."""
        if len(self.materials) == 1:
            return (1.0,)
        return self.composition_field.mixture if isinstance(self.composition_field,
                                                            UniformComposition) else None

    def composition(self, points_mm: FloatArray) -> FloatArray:
        """Volume fractions at any points, in the order of `materials`.

        points_mm : (n, 3) float64 [mm]
        returns : (n, n_materials) float64, each ≥ 0, rows summing to 1 within 1e-6
        """
        return _fractions_at(self.composition_field, points_mm)

    @cached_property
    def laid_mixtures(self) -> LaidMixtures | None:
        """What is laid in place of mixtures that alloy rules forbid; None without rules."""
        if self.alloy_rules is None:
            return None
        if (known := getattr(self.composition_field, "mixtures", None)) is not None:
            return cast("LaidMixtures", known)  # of a part as it is laid
        from lmctl.part.materials.laid_mixtures import LaidMixtures  # late: it compiles kernels

        return LaidMixtures(self.alloy_rules, self.process.fraction_step)

    def as_laid(self) -> Part:
        """The part with the composition that alloy rules leave of its own; itself without rules.

        Its `designed_composition` is still the part file's.
        """
        if self.laid_mixtures is None:
            return self
        from lmctl.part.materials.laid_mixtures import RuledComposition

        if isinstance(self.composition_field, RuledComposition):
            return self
        return replace(self, composition_field=RuledComposition(
            self.composition_field, self.laid_mixtures))

    def designed_composition(self, points_mm: FloatArray) -> FloatArray:
        """As `composition`, of the part file, whatever alloy rules say."""
        return _fractions_at(getattr(self.composition_field, "designed", self.composition_field),
                             points_mm)


def _fractions_at(of: CompositionField, points_mm: FloatArray) -> FloatArray:
    """A composition field at points (n, 3), many at a time."""
    points = np.asarray(points_mm, dtype=np.float64).reshape(-1, 3)
    parts = [
        of.fractions(points[first : first + POINTS_AT_ONCE])
        for first in range(0, max(len(points), 1), POINTS_AT_ONCE)
    ]
    return parts[0] if len(parts) == 1 else np.concatenate(parts)
