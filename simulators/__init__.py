"""The simulated machine at the device end of the links."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simulators.bench import Bench as Bench
    from simulators.bench_config import BenchConfig as BenchConfig
    from simulators.bench_record import BenchRecord as BenchRecord
    from simulators.faults.fault_injector import FaultInjector as FaultInjector
    from simulators.faults.plan import FaultPlan as FaultPlan
    from simulators.faults.plan import FaultPlanError as FaultPlanError
    from simulators.virtual_time import run_in_virtual_time as run_in_virtual_time

#: Public names and the modules that define them; a module is loaded on first use.
_HOMES = {
    "Bench": "simulators.bench",
    "BenchConfig": "simulators.bench_config",
    "BenchRecord": "simulators.bench_record",
    "FaultInjector": "simulators.faults.fault_injector",
    "FaultPlan": "simulators.faults.plan",
    "FaultPlanError": "simulators.faults.plan",
    "run_in_virtual_time": "simulators.virtual_time",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
