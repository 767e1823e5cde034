"""What a job says of dilution, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def dilution_text(totals: Mapping[str, Any], materials: int) -> str:
    """Whether a job's powder makes up for dilution, by its totals; "" where it has one powder.

    materials : of the part
    """
    found = totals.get("dilution")
    if not isinstance(found, Mapping):
        return "" if materials < 2 else "not made up for: not measured or stated, or ignored"
    if not found["compensated_fraction"]:
        return "made up for in no layer"
    interval = (f" ({found['low']:.1%} to {found['high']:.1%})"
                if found["high"] > found["low"] else "")
    of = ("" if found["compensated_fraction"] >= 1 else
          f" in {found['compensated_fraction']:.0%} of the path")
    clipped = ("" if not found["clipped_fraction"] else
               f"; {found['clipped_fraction']:.1%} of the path cannot, off by up to "
               f"{found['clipped_worst']:.3f}")
    return f"{found['share']:.1%}{interval} made up for{of}{clipped}"
