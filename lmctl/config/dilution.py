"""How much of the layer below ends up in a bead: `[[dilution]]` of a machine profile."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from lmctl.config.quantities import Name
from lmctl.config.toml_file import ConfigModel

#: More than this share from below is remelting rather than deposition.
MAX_DILUTION = 0.8

_Share = Annotated[float, Field(ge=0, le=MAX_DILUTION)]


class DilutionSettings(ConfigModel):
    """The dilution of one powder at one energy per length, measured or typed in.

    share : volume melted from below over all of the bead's volume
    low, high : its interval; both None where it is not known
    energy_J_mm : beam power over speed at which it holds; None where only one value is stated, and
        it holds at all
    material : the powder; None: all powders
    """

    share: _Share
    low: _Share | None = None
    high: _Share | None = None
    energy_J_mm: Annotated[float, Field(gt=0, le=1e6)] | None = None
    material: Name | None = None

    @model_validator(mode="after")
    def _inside(self) -> DilutionSettings:
        if (self.low is None) != (self.high is None):
            raise ValueError("states one of low and high: state both, or none")
        if self.low is not None and self.high is not None and (
            not self.low <= self.share <= self.high
        ):
            raise ValueError(f"share {self.share:g} is not within low {self.low:g} and high "
                             f"{self.high:g}")
        return self

    @property
    def half_width(self) -> float:
        """Half of the interval; 0 where it is not known."""
        return 0.0 if self.low is None or self.high is None else (self.high - self.low) / 2.0


def dilution_mistakes(stated: tuple[DilutionSettings, ...]) -> list[str]:
    """What is wrong with the statements of one profile together."""
    wrong = []
    for material in dict.fromkeys(one.material for one in stated):
        of = f"of {material}" if material else "of all powders"
        own = [one for one in stated if one.material == material]
        if len(own) > 1 and any(one.energy_J_mm is None for one in own):
            wrong.append(f"two dilutions {of}: each must state its energy_J_mm")
    return wrong
