"""A simulated catch scale under the nozzle, and the operator who puts things onto it."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simulators.scale.config import ScaleConfig as ScaleConfig
    from simulators.scale.device import SimulatedCatchScale as SimulatedCatchScale

#: Public names and the modules that define them; a module is loaded on first use.
_HOMES = {
    "ScaleConfig": "simulators.scale.config",
    "SimulatedCatchScale": "simulators.scale.device",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
