"""Several bodies as one (docs/explanation/multi-colour-distance-field.md, Booleans)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.part.booleans.combined import CombinedBody as CombinedBody
    from lmctl.part.booleans.expression import Operation as Operation
    from lmctl.part.booleans.offset import OffsetBody as OffsetBody
    from lmctl.part.booleans.overlap import OverlapWeights as OverlapWeights

#: Public names, and the module that holds each; loaded on first use.
_HOMES = {
    "CombinedBody": "lmctl.part.booleans.combined",
    "OffsetBody": "lmctl.part.booleans.offset",
    "Operation": "lmctl.part.booleans.expression",
    "OverlapWeights": "lmctl.part.booleans.overlap",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
