"""Text of small part files that many tests begin with."""

from __future__ import annotations

from collections.abc import Sequence

_MATERIALS = '[[material]]\nname = "316L"\n'
_TWO_MATERIALS = _MATERIALS + '[[material]]\nname = "WC-12Co"\n'


def block_file(
    high_mm: Sequence[float], composition: str = "", *, low_mm: Sequence[float] = (0, 0, 0),
    name: str = "block",
) -> str:
    """A box of 316L; with a composition (keys and tables after `[composition]`) of WC-12Co too."""
    materials = _TWO_MATERIALS if composition else _MATERIALS
    graded = f"[composition]\n{composition.strip()}\n" if composition else ""
    return (
        f'name = "{name}"\n{materials}[[body]]\nkind = "box"\nlow_mm = {list(low_mm)}\n'
        f"high_mm = {list(high_mm)}\n{graded}"
    )
