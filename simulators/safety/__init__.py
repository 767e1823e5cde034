"""A simulated safety-input device, and how it is wired to the rest of the cell."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simulators.safety.config import SafetyConfig as SafetyConfig
    from simulators.safety.device import SimulatedSafetyDevice as SimulatedSafetyDevice
    from simulators.safety.wiring import SafetyWiring as SafetyWiring

#: Public names and the modules that define them; a module is loaded on first use.
_HOMES = {
    "SafetyConfig": "simulators.safety.config",
    "SafetyWiring": "simulators.safety.wiring",
    "SimulatedSafetyDevice": "simulators.safety.device",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
