"""What a part is deposited on: its height, the layers that follow it, and whether it lies right."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.part.substrate.flattened import flattened_part as flattened_part
    from lmctl.part.substrate.layer_stack import LayerStack as LayerStack
    from lmctl.part.substrate.substrate_surface import SubstrateSurface as SubstrateSurface
    from lmctl.part.substrate.substrate_surface import (
        substrate_surface_of as substrate_surface_of,
    )
    from lmctl.part.substrate.surface_heights import SurfaceHeights as SurfaceHeights

#: Public names, and the module that holds each; loaded on first use.
_HOMES = {
    "LayerStack": "lmctl.part.substrate.layer_stack",
    "SubstrateSurface": "lmctl.part.substrate.substrate_surface",
    "SurfaceHeights": "lmctl.part.substrate.surface_heights",
    "flattened_part": "lmctl.part.substrate.flattened",
    "substrate_surface_of": "lmctl.part.substrate.substrate_surface",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
