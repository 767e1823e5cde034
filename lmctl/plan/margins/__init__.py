"""How much of a plan gets its mixture: as predicted, and at worst within measured intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.plan.margins.mixture_margins import MixtureMargins as MixtureMargins
    from lmctl.plan.margins.mixture_margins import mixture_margins as mixture_margins

#: Public names, and the module that holds each; loaded on first use.
_HOMES = {
    "MixtureMargins": "lmctl.plan.margins.mixture_margins",
    "mixture_margins": "lmctl.plan.margins.mixture_margins",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
