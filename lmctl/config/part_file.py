"""The part file: bodies, materials, process, as written in TOML; data only, no geometry.

`lmctl.part` builds geometry from it; `lmctl.plan` reads `process` and `placement`. Lengths are in
millimetres; only data files have units of their own. `part_rules` makes the checks that concern
several keys at once, so that one reading names every mistake.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from lmctl.config.alloy_rules import AlloyRuleSettings
from lmctl.config.bodies import Body, referenced_bodies
from lmctl.config.composition import Composition, measured_bodies
from lmctl.config.copies import CopySettings
from lmctl.config.deposition_heat import DepositionHeatSettings
from lmctl.config.quantities import FileName, Name, Pitch, Positive, ShareOfOne, Vector
from lmctl.config.simulation import (
    FaceSettings,
    HeatSettings,
    LoadSettings,
    OptimiseSettings,
    SimulationSettings,
    SupportSettings,
)
from lmctl.config.substrate import SubstrateSettings
from lmctl.config.toml_file import ConfigModel
from lmctl.config.traveller import TravellerSettings


class MaterialSettings(ConfigModel):
    """One powder, as the process sees it (docs/explanation/process-defaults.md, Powders).

    density_g_cm3, apparent_g_cm3 : solid and loose-powder density; None takes the library's
    catch_efficiency : share of the fed powder that ends in the bead, η in (0, 1]
    power_W, speed_mm_s : recipe of the pure material; mixtures interpolate by volume fraction
    elastic_modulus_GPa .. strength_MPa : of the dense material, for simulations only; None takes
        the library's (`material_constants`)
    heat_capacity_J_kg_K, absorptivity : specific heat, and share of the beam's power that stays in
        the part; with conductivity they count where `process.interpass_max_C` is stated
    melting_C : where it is molten; counts with `process.power_follows_temperature`
    price_per_kg : in any one currency; there is no default
    name : by which compositions and hoppers refer to it
    """

    name: Annotated[str, Field(min_length=1, max_length=60)]
    density_g_cm3: Annotated[float, Field(gt=0, le=30)] | None = None
    apparent_g_cm3: Annotated[float, Field(gt=0, le=30)] | None = None
    catch_efficiency: ShareOfOne | None = None
    power_W: Positive | None = None
    speed_mm_s: Positive | None = None
    elastic_modulus_GPa: Annotated[float, Field(gt=0, le=2000)] | None = None
    poisson_ratio: Annotated[float, Field(ge=0, lt=0.5)] | None = None
    conductivity_W_m_K: Annotated[float, Field(gt=0, le=5000)] | None = None
    expansion_1e6_K: Annotated[float, Field(ge=-20, le=100)] | None = None
    strength_MPa: Annotated[float, Field(gt=0, le=20_000)] | None = None
    heat_capacity_J_kg_K: Annotated[float, Field(gt=0, le=20_000)] | None = None
    absorptivity: ShareOfOne | None = None
    melting_C: Annotated[float, Field(ge=100, le=5000)] | None = None
    price_per_kg: Annotated[float, Field(ge=0, le=1e6)] | None = None


#: How the tracks of a slice, or of a region of one, are laid out.
RegionStrategy = Literal["offset", "iso-composition", "hatch", "spiral"]


class StrategyRegion(ConfigModel):
    """Where in the part another strategy holds; of several, the last one.

    body : within this body; None: everywhere
    layers : in these layers, from the first number to the last, from 1; None: in all
    strategy : the one that holds there
    """

    strategy: RegionStrategy
    body: Name | None = None
    layers: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]] | None = None

    @model_validator(mode="after")
    def _limited(self) -> StrategyRegion:
        if self.body is None and self.layers is None:
            raise ValueError("states neither body nor layers: say process.strategy instead")
        if self.layers is not None and self.layers[0] > self.layers[1]:
            raise ValueError("layers go from the lower number to the higher")
        return self

    def holds_in(self, layer: int) -> bool:
        """Whether it holds in a layer, counted from 0."""
        return self.layers is None or self.layers[0] <= layer + 1 <= self.layers[1]


class ProcessSettings(DepositionHeatSettings):
    """How beads are deposited. Defaults are those of medium deposition, and are named.

    Keys about heat are in `deposition_heat`.

    Source: docs/explanation/process-defaults.md, Process window.

    overlap : share of the bead width by which neighbours overlap; pitch = width · (1 − overlap)
    fraction_step : quantum of volume fraction along a path (docs/explanation/process-defaults.md,
    Toolpaths)
    lead_in_mm : run-up and run-out with the beam off at each end of a path
    change_margin_s : time kept free before and after each change of mixture with the beam off, for
        powder that comes sooner or later than hoppers' dead times say
    outer_track : how far the outermost track lies inside the outline: half a pitch, which fills the
        slice to its outline, or half a bead, which leaves no bead outside it
    allowance_mm : how far the outline is moved outwards, for machining; negative: inwards
    narrow_features : for features narrower than a bead and at least half a bead wide: one track is
        deposited, or the feature is left out, or the part is refused
    min_built_fraction : least volume deposited inside the intended surface, over its volume
    max_overhang_deg : steepest lean of a wall, from the vertical, over the layer below
    seam : where closed tracks begin: at a place that turns from layer to layer, at one that stays,
        or nearest to a point (x, y) [mm]
    material_seam : where the material jumps, tracks end on the jump itself, or half a pitch beyond
        it, to one side in one layer and to the other in the next, so that the two interlock
    strategy : how tracks are laid out: along the outline, along iso-contours of the 3D distance, or
        along lines of equal mixture, in straight lines, in a spiral; "auto" tries some layers and
        says what it chose, and why
    hatch, hatch_angle_deg, hatch_turn_deg : lines to and fro or all one way; their direction in the
        first layer, from x, and by how much it turns from layer to layer
    hatch_blocks, hatch_block_mm : lines as long as the slice, or in stripes or square islands so
        wide
    outline_tracks : tracks along the outline around hatch lines
    copy_order : of several copies, each layer of all before the next, its mixtures in one order; or
        each copy finished before the next, where the nozzle clears what is finished
    region : bodies and layers with strategies of their own
    dead_time_error_s : how far dead times may be off, in what "auto" compares
    height_check_every : after so many layers a run is held for the height of the part; powder then
        brings it back to its plan. None: never
    height_tolerance_mm : within this of its planned height, and within 2.5 % of it, a part gets its
        planned volume; beyond, powder is changed as far as brings it back to there. 0: to its plan
    dilution : whether powder is fed so that the bead has the part's mixture after the pool has
        melted some of the layer below into it, where the machine's dilution is known
    first_layer_order : on a substrate of another alloy, where dilution is made up for: each track
        beside the last, or every other track first and wider, so that beads melt the substrate and
        not each other; "auto" lays every other first where dilution was measured at energies per
        length that differ by a factor of two or more
    bead_width_mm, layer_height_mm : of one bead
    speed_mm_s : of deposition; a material may have its own
    travel_speed_mm_s : between beads, with the beam off
    power_W : of the beam; a material may have its own
    powder : how flows follow the mixture: set ahead of the path by the delay of the hose, or by
        waiting at each change; "none" feeds no powder
    dwell_s : the wait at each change of mixture, where powder is "dwell"
    """

    bead_width_mm: Annotated[float, Field(ge=0.05, le=100)] = 2.0
    overlap: Annotated[float, Field(ge=0, lt=0.9)] = 0.333
    layer_height_mm: Annotated[float, Field(ge=0.005, le=100)] = 0.8
    speed_mm_s: Positive = 10.0
    travel_speed_mm_s: Positive = 50.0
    power_W: Positive = 1500.0
    fraction_step: Annotated[float, Field(ge=0.001, le=0.5)] = 0.02
    lead_in_mm: Annotated[float, Field(ge=0, le=20)] = 1.0
    strategy: Literal["auto", "offset", "iso-3d", "iso-composition", "hatch", "spiral"] = "offset"
    powder: Literal["lead", "dwell", "none"] = "lead"
    dwell_s: Annotated[float, Field(ge=0, le=600)] = 30.0
    change_margin_s: Annotated[float, Field(ge=0, le=10)] = 0.0
    dead_time_error_s: Annotated[float, Field(ge=0, le=10)] = 0.5
    outer_track: Literal["half-pitch", "half-bead"] = "half-pitch"
    allowance_mm: Annotated[float, Field(ge=-20, le=20)] = 0.0
    narrow_features: Literal["deposit", "omit", "refuse"] = "deposit"
    min_built_fraction: Annotated[float, Field(ge=0, le=1)] = 0.98
    max_overhang_deg: Annotated[float, Field(gt=0, lt=90)] = 45.0
    seam: Literal["spread", "aligned"] | tuple[float, float] = "spread"
    material_seam: Literal["butt", "stepped"] = "butt"
    hatch: Literal["zigzag", "one-way"] = "zigzag"
    hatch_angle_deg: Annotated[float, Field(ge=-360, le=360)] = 45.0
    hatch_turn_deg: Annotated[float, Field(ge=-180, le=180)] = 90.0
    hatch_blocks: Literal["none", "stripes", "islands"] = "none"
    hatch_block_mm: Annotated[float, Field(ge=1, le=1000)] = 20.0
    outline_tracks: Annotated[int, Field(ge=0, le=10)] = 1
    height_check_every: Annotated[int, Field(ge=1, le=10_000)] | None = None
    height_tolerance_mm: Annotated[float, Field(ge=0, le=20)] = 1.0
    dilution: Literal["compensate", "ignore"] = "compensate"
    first_layer_order: Literal["auto", "in-turn", "every-other"] = "auto"
    copy_order: Literal["layer-by-layer", "part-by-part"] = "layer-by-layer"
    region: Annotated[tuple[StrategyRegion, ...], Field(max_length=1000)] = ()


class PlacementSettings(ConfigModel):
    """Where the part file's origin lies in program coordinates.

    origin_mm : of the part, in program coordinates
    """

    origin_mm: Vector


class PartFile(ConfigModel):
    """A whole part file; read one with `part_rules.load_part_file`, which checks all of it.

    pitch_mm : of the grid that fields are stored on; None chooses it from the bead width
    tolerance_mm : how far the surface may be from the data of a cloud; the pitch follows from it
    combine : how the bodies that no other names make one solid; a difference takes all others
        from the first
    composition : of the whole part; None where the bodies state their own
    placement : None centres the part, or all its copies, on the platform, its lowest point at z = 0
    substrate : what the first layer is deposited on
    copies : of the part on its plate, `[[copy]]` in the file; none: the part alone
    traveller : what the job report prints of the part beside what the machine records
    face, load, support, heat, simulation : what acts on it in service, for `lmctl simulate`
    optimise : what is to be least, for `lmctl optimise`
    name : of the part, in jobs and reports
    material : the powders it is made of
    body : the shapes it is made of
    process : how beads are deposited
    alloy_rule : mixtures that must not be deposited
    alloy_rule_files : TOML files of such rules that several parts share
    """

    name: Name
    pitch_mm: Pitch | None = None
    tolerance_mm: Annotated[float, Field(gt=0, le=10)] | None = None
    combine: Literal["union", "difference", "intersection"] | None = None
    material: Annotated[tuple[MaterialSettings, ...], Field(min_length=1, max_length=64)]
    body: Annotated[tuple[Body, ...], Field(min_length=1, max_length=1000)]
    composition: Composition | None = None
    placement: PlacementSettings | None = None
    process: ProcessSettings = ProcessSettings()
    substrate: SubstrateSettings = SubstrateSettings()
    copies: Annotated[tuple[CopySettings, ...], Field(max_length=500, alias="copy")] = ()
    traveller: TravellerSettings = TravellerSettings()
    face: Annotated[tuple[FaceSettings, ...], Field(max_length=1000)] = ()
    load: Annotated[tuple[LoadSettings, ...], Field(max_length=1000)] = ()
    support: Annotated[tuple[SupportSettings, ...], Field(max_length=1000)] = ()
    heat: Annotated[tuple[HeatSettings, ...], Field(max_length=1000)] = ()
    simulation: SimulationSettings = SimulationSettings()
    optimise: OptimiseSettings | None = None
    alloy_rule: Annotated[tuple[AlloyRuleSettings, ...], Field(max_length=100)] = ()
    alloy_rule_files: Annotated[tuple[FileName, ...], Field(max_length=20)] = ()

    def root_body_indices(self) -> tuple[int, ...]:
        """Numbers of the bodies the part is made of: those no other and no feature names."""
        used = self._used() | self._measured()
        return tuple(n for n, body in enumerate(self.body) if body.name not in used)

    def reference_body_indices(self) -> tuple[int, ...]:
        """Numbers of the bodies that features measure from, and that nothing is made of."""
        only = self._measured() - self._used()
        return tuple(n for n, body in enumerate(self.body) if body.name in only)

    def _used(self) -> set[str]:
        return {name for body in self.body for name in referenced_bodies(body)}

    def _measured(self) -> set[str]:
        """Bodies that features name, but each body's own composition naming the body itself."""
        of_all = set() if self.composition is None else measured_bodies(self.composition)
        each = (measured_bodies(body.composition) - {body.name}
                for body in self.body if body.composition is not None)
        return of_all.union(*each)
