"""What acts on a part in service, as a part file states it: faces, loads, supports, heat, model."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from lmctl.config.composition import Feature, Range
from lmctl.config.quantities import Coordinate, Direction, Length, Name, Positive
from lmctl.config.toml_file import ConfigModel

#: The name by which loads refer to all of the surface.
WHOLE_SURFACE = "surface"

Temperature = Annotated[float, Field(ge=-273.15, le=5000)]
Stress = Annotated[float, Field(ge=-1e6, le=1e6)]


class FaceSettings(ConfigModel):
    """A piece of the surface that loads may name.

    feature : as of a composition; the face is what lies at distances at_mm of it
    at_mm : None is on the feature itself
    facing, angle_deg : only where the outward normal is at such angles to a direction
    name : by which loads refer to it
    """

    name: Name
    feature: Feature
    at_mm: Range | None = None
    facing: Direction | None = None
    angle_deg: tuple[Annotated[float, Field(ge=0, le=180)],
                     Annotated[float, Field(ge=0, le=180)]] = (0.0, 60.0)


class LoadSettings(ConfigModel):
    """A load on a face: one of a pressure into the solid, a stress vector, and a whole force.

    on : the face
    pressure_MPa : into the solid
    traction_MPa : the stress vector
    force_N : the whole force, spread evenly
    """

    on: Name
    pressure_MPa: Stress | None = None
    traction_MPa: tuple[Stress, Stress, Stress] | None = None
    force_N: tuple[Coordinate, Coordinate, Coordinate] | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> LoadSettings:
        if [self.pressure_MPa, self.traction_MPa, self.force_N].count(None) != 2:
            raise ValueError("give one of pressure_MPa, traction_MPa and force_N")
        return self


class SupportSettings(ConfigModel):
    """Displacements that are held on a face, or rigid motion of the whole.

    fix : along which of the part's axes; "r" in an axisymmetric model
    at_mm : where they are held
    rigid_motion : nothing is held but motion as a whole, for loads that balance
    on : the face
    """

    on: Name | None = None
    fix: Annotated[tuple[Literal["x", "y", "z", "r"], ...], Field(max_length=3)] = ()
    at_mm: Coordinate = 0.0
    rigid_motion: bool = False

    @model_validator(mode="after")
    def _says_what(self) -> SupportSettings:
        if self.rigid_motion and (self.on is not None or self.fix):
            raise ValueError("rigid_motion stands alone, without on and fix")
        if not self.rigid_motion and (self.on is None or not self.fix):
            raise ValueError('say on which face and along which axes: fix = ["x", "y", "z"]')
        return self


class HeatSettings(ConfigModel):
    """Heat at a face: a temperature, a flux into the solid, or a film to a medium.

    on : the face
    temperature_C : held there
    flux_W_mm2 : into the solid
    film_W_mm2_K, ambient_C : coefficient and temperature of the medium
    """

    on: Name
    temperature_C: Temperature | None = None
    flux_W_mm2: Annotated[float, Field(ge=-1e4, le=1e4)] | None = None
    film_W_mm2_K: Annotated[float, Field(gt=0, le=1e3)] | None = None
    ambient_C: Temperature | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> HeatSettings:
        if [self.temperature_C, self.flux_W_mm2, self.film_W_mm2_K].count(None) != 2:
            raise ValueError("give one of temperature_C, flux_W_mm2 and film_W_mm2_K")
        if (self.film_W_mm2_K is None) != (self.ambient_C is None):
            raise ValueError("film_W_mm2_K and ambient_C go together")
        return self


class SimulationSettings(ConfigModel):
    """How the part is simulated.

    model : "solid"; "plane-stress" and "plane-strain" of the section at z = section_mm;
        "axisymmetric" around the z axis, from its half plane y = 0, x > 0
    section_mm : None is the part's middle
    mesh_mm : length of an element's edge; None is a twentieth of the part's size
    elastic, conduction : the mixing rules
    transfer_GPa : q of the rule of Tamura, Tomota and Ozawa
    stress_free_C : temperature without thermal stress
    temperature_C : of all of the part where no [[heat]] is given; None is the stress-free one
    thickness_mm : of a plane model; None: the part's height
    matrix : the material around the others; None: the first
    """

    model: Literal["solid", "plane-stress", "plane-strain", "axisymmetric"] = "solid"
    section_mm: Coordinate | None = None
    thickness_mm: Length | None = None
    mesh_mm: Annotated[float, Field(gt=0, le=10_000)] | None = None
    elastic: Literal["voigt", "reuss", "mori-tanaka", "tamura"] = "mori-tanaka"
    conduction: Literal["voigt", "reuss", "maxwell-eucken"] = "maxwell-eucken"
    matrix: Name | None = None
    transfer_GPa: Positive = 100.0
    stress_free_C: Temperature = 20.0
    temperature_C: Temperature | None = None


class ForbiddenMixture(ConfigModel):
    """Volume fractions of one material that must not be deposited, from and to [0, 1].

    material : whose fraction
    between : the fractions, from and to
    """

    material: Name
    between: tuple[Annotated[float, Field(ge=0, le=1)], Annotated[float, Field(ge=0, le=1)]]

    @model_validator(mode="after")
    def _rising(self) -> ForbiddenMixture:
        if self.between[0] >= self.between[1]:
            raise ValueError("between must rise")
        return self


class LimitSettings(ConfigModel):
    """One constraint of an optimisation: a quantity, everywhere at most, or at least, a value.

    quantity : a stress [MPa], "utilisation" (von Mises stress over the mixture's strength),
        "temperature" [°C], "mass" [g], "cost", or "fraction" of `material`
    material : of a stress, only where this material is; of a fraction, whose
    at_most, at_least : the limit
    """

    quantity: Literal[
        "von-mises", "tresca", "largest-principal", "xx", "yy", "zz", "xy", "yz", "xz",
        "utilisation", "temperature", "mass", "cost", "fraction"]
    at_most: Annotated[float, Field(ge=-1e9, le=1e9)] | None = None
    at_least: Annotated[float, Field(ge=-1e9, le=1e9)] | None = None
    material: Name | None = None

    @model_validator(mode="after")
    def _has_a_limit(self) -> LimitSettings:
        if self.at_most is None and self.at_least is None:
            raise ValueError("give at_most or at_least")
        if self.at_most is not None and self.at_least is not None and (
                self.at_least > self.at_most):
            raise ValueError(f"at_least {self.at_least:g} is above at_most {self.at_most:g}")
        if self.at_least is not None and self.quantity not in ("fraction", "mass", "cost"):
            raise ValueError("at_least is for fraction, mass and cost")
        if (self.quantity == "fraction") and self.material is None:
            raise ValueError("a fraction is of a material: give material")
        return self


class OptimiseSettings(ConfigModel):
    """What is to be least, and under which limits.

    minimise : the quantity; of stresses and temperature its largest value or its p-norm
    norm : p of the norm; None takes the largest value (a norm of p = 30 while it is searched)
    limit : constraints
    monotone : whether free levels must rise or fall
    depositable : whether the cell's own limits hold: least flow, gradients, forbidden mixtures
    rate_per_s : how fast a fraction may change at the nozzle, in units of 1/τ
    forbidden : mixtures that must not be deposited
    starts : how many starting points are tried; the first is the part file's own
    iterations : at most, of each start
    """

    minimise: Literal[
        "von-mises", "tresca", "largest-principal", "xx", "yy", "zz", "xy", "yz", "xz",
        "utilisation", "temperature", "mass", "cost"] = "von-mises"
    norm: Annotated[float, Field(ge=1, le=200)] | None = None
    limit: tuple[LimitSettings, ...] = ()
    monotone: Literal["rising", "falling"] | None = None
    depositable: bool = True
    rate_per_s: Positive = 0.5
    forbidden: tuple[ForbiddenMixture, ...] = ()
    starts: Annotated[int, Field(ge=1, le=100)] = 3
    iterations: Annotated[int, Field(ge=1, le=10_000)] = 60
