"""How much of a mixture of powders is caught: `[[mixture_catch]]` of a machine profile."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from lmctl.config.quantities import Name
from lmctl.config.toml_file import ConfigModel

_SHARE_ERROR = 0.01


class MixtureCatchSettings(ConfigModel):
    """Catch efficiency of a mixture of two powders, measured or typed in.

    mass_shares : of each powder fed, by material; two, adding up to 1
    efficiency : deposited over fed mass of both together, (0, 1]
    """

    mass_shares: dict[Name, Annotated[float, Field(gt=0, lt=1)]]
    efficiency: Annotated[float, Field(gt=0, le=1)]

    @model_validator(mode="after")
    def _of_two(self) -> MixtureCatchSettings:
        wrong = []
        if len(self.mass_shares) != 2:
            wrong.append(f"mass_shares are of two powders, not of {len(self.mass_shares)}")
        if abs(sum(self.mass_shares.values()) - 1.0) > _SHARE_ERROR:
            wrong.append("mass_shares do not add up to 1")
        if wrong:
            raise ValueError("; ".join(wrong))
        return self
