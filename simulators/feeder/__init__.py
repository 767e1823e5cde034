"""A simulated powder feeder: hoppers with hoses, and the PMX device that drives them."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simulators.feeder.config import FeederConfig as FeederConfig
    from simulators.feeder.config import HopperConfig as HopperConfig
    from simulators.feeder.device import PmxFeederDevice as PmxFeederDevice
    from simulators.feeder.hopper import FeedInterval as FeedInterval
    from simulators.feeder.hopper import SimulatedHopper as SimulatedHopper
    from simulators.feeder.injected_defects import Change as Change
    from simulators.feeder.injected_defects import InjectedDefects as InjectedDefects
    from simulators.feeder.process import HopperProcess as HopperProcess
    from simulators.feeder.readings import register_values as register_values
    from simulators.feeder.server import FeederRegisters as FeederRegisters

#: Public names and the modules that define them; a module is loaded on first use.
_HOMES = {
    "Change": "simulators.feeder.injected_defects",
    "FeedInterval": "simulators.feeder.hopper",
    "FeederConfig": "simulators.feeder.config",
    "FeederRegisters": "simulators.feeder.server",
    "HopperConfig": "simulators.feeder.config",
    "HopperProcess": "simulators.feeder.process",
    "InjectedDefects": "simulators.feeder.injected_defects",
    "PmxFeederDevice": "simulators.feeder.device",
    "SimulatedHopper": "simulators.feeder.hopper",
    "register_values": "simulators.feeder.readings",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
