"""Several copies of a part on one plate: `[[copy]]` of a part file."""

from __future__ import annotations

import string
from typing import Annotated

from pydantic import Field, model_validator

from lmctl.config.quantities import Coordinate, Name
from lmctl.config.toml_file import ConfigModel

Spacing = Annotated[float, Field(gt=0, le=10_000)]
#: Copies of one table at most in each direction, and in all.
MAX_COPIES = 500


class CopySettings(ConfigModel):
    """One copy of the part, or a grid of copies.

    name : or serial number; in a grid its copies are numbered. None: "copy" and a number
    position_mm : (x, y) of the part file's origin; of a grid, that of its first copy
    turn_deg : by which it is turned about that origin, counter-clockwise seen from above
    count : copies along x and along y; spacing_mm : from one to the next
    """

    name: Name | None = None
    position_mm: tuple[Coordinate, Coordinate]
    turn_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    count: tuple[Annotated[int, Field(ge=1, le=MAX_COPIES)],
                 Annotated[int, Field(ge=1, le=MAX_COPIES)]] = (1, 1)
    spacing_mm: tuple[Spacing, Spacing] | None = None

    @model_validator(mode="after")
    def _consistent(self) -> CopySettings:
        if self.count[0] * self.count[1] > MAX_COPIES:
            raise ValueError(f"count makes {self.count[0] * self.count[1]} copies; at most "
                             f"{MAX_COPIES} are taken")
        if self.count != (1, 1) and self.spacing_mm is None:
            raise ValueError("a grid of copies needs spacing_mm = [along x, along y]")
        if self.count == (1, 1) and self.spacing_mm is not None:
            raise ValueError("spacing_mm is for a grid: say count = [along x, along y]")
        return self


def copy_names(settings: tuple[CopySettings, ...]) -> list[str]:
    """The name of each copy, in order; a grid's rows along x one after the other."""
    names: list[str] = []
    for one in settings:
        many = one.count[0] * one.count[1]
        for number in range(1, many + 1):
            if one.name is None:
                names.append(f"copy {len(names) + 1}")
            elif many == 1:
                names.append(one.name)
            else:
                joint = "-" if one.name[-1] in string.digits else ""
                names.append(f"{one.name}{joint}{number}")
    return names
