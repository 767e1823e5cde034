"""Fault injection: the faults of a cell as data, and the code that injects them."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simulators.faults.fault_injector import FaultInjector as FaultInjector
    from simulators.faults.fault_injector import InjectedFault as InjectedFault
    from simulators.faults.link_tap import LinkTap as LinkTap
    from simulators.faults.plan import FaultPlan as FaultPlan
    from simulators.faults.plan import FaultPlanError as FaultPlanError

#: Public names and the modules that define them; a module is loaded on first use.
_HOMES = {
    "FaultInjector": "simulators.faults.fault_injector",
    "FaultPlan": "simulators.faults.plan",
    "FaultPlanError": "simulators.faults.plan",
    "InjectedFault": "simulators.faults.fault_injector",
    "LinkTap": "simulators.faults.link_tap",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
