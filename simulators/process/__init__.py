"""What the pool makes of the powder: deposit, dilution and growth, from the bench's own record."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simulators.process.build import build_from_record as build_from_record
    from simulators.process.config import ProcessConfig as ProcessConfig
    from simulators.process.substrate_heights import SubstrateHeights as SubstrateHeights
    from simulators.process.voxel_map import VoxelMap as VoxelMap

#: Public names and the modules that define them; a module is loaded on first use.
_HOMES = {
    "ProcessConfig": "simulators.process.config",
    "SubstrateHeights": "simulators.process.substrate_heights",
    "VoxelMap": "simulators.process.voxel_map",
    "build_from_record": "simulators.process.build",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
