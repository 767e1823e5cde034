"""Shells: what of a body lies between two depths."""

from __future__ import annotations

import numpy as np

from lmctl.config.bodies import ShellBody
from lmctl.errors import InputError
from lmctl.part.bodies.body import Body
from lmctl.part.bodies.depth import maximum_in_box
from lmctl.part.bodies.measured import Bounds
from lmctl.part.booleans.combined import CombinedBody
from lmctl.part.booleans.offset import OffsetBody
from lmctl.part.resolution import boundary_grid

#: A body is deep enough for a shell where it is deeper by more than this.
TOLERANCE_MM = 1e-3


def make_shell(of: Body, box: Bounds, shell: ShellBody, pitch_mm: float) -> Body:
    """The shell of a body that a part file specifies.

    box : holds the body
    raises : InputError where the body has no end, or nothing of it lies as deep as the shell
    """
    low, high = box
    if not np.isfinite([low, high]).all():
        raise InputError(f"the shell of {shell.of!r} has no end",
                         hint="cut it with a body that has one")
    for key, level in (("from_mm", shell.from_mm), ("to_mm", shell.to_mm)):
        if level is not None and level > 0.0:
            _check_depth(of, box, shell.of, key, level)
    least = min(shell.from_mm, 0.0)
    grid = boundary_grid(low + least, high - least, pitch_mm)
    outer = of if shell.from_mm == 0 else OffsetBody(of, shell.from_mm, grid)
    if shell.to_mm is None:
        return outer
    return CombinedBody("difference", (outer, OffsetBody(of, shell.to_mm, grid)), grid)


def _check_depth(of: Body, box: Bounds, name: str, key: str, level_mm: float) -> None:
    """Raises InputError where no place in a body lies deeper than a shell of it begins or ends.

    Bounds are never too large, so a place that is deeper by its bound is enough. Distances are
    evaluated only where there is none.
    """
    deepest = maximum_in_box(of.distance_bound, *box, TOLERANCE_MM, level_mm)
    if deepest <= level_mm and not of.distance_bound_is_exact:
        deepest = maximum_in_box(of.distance_at, *box, TOLERANCE_MM, level_mm)
    if deepest > level_mm:
        return
    raise InputError(
        f"nothing of {name!r} lies deeper than {level_mm:g} mm",
        where=f"its deepest place is at about {deepest:.3g} mm; {key} of a shell of it is "
        f"{level_mm:g} mm",
        hint="lower from_mm of the shell" if key == "from_mm" else
        "lower to_mm of the shell, or leave it out: then all that is deeper belongs to it",
    )
