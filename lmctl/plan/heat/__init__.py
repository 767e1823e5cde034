"""Temperature of a part while it is deposited, as the plan predicts it; waits that limit it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.plan.heat.heat_planner import HeatPlanner as HeatPlanner
    from lmctl.plan.heat.heat_report import heat_findings as heat_findings
    from lmctl.plan.heat.heat_report import heat_planner_of as heat_planner_of
    from lmctl.plan.heat.heat_report import heat_totals as heat_totals

#: Public names, and the module that holds each; loaded on first use.
_HOMES = {
    "HeatPlanner": "lmctl.plan.heat.heat_planner",
    "heat_planner_of": "lmctl.plan.heat.heat_report",
    "heat_findings": "lmctl.plan.heat.heat_report",
    "heat_totals": "lmctl.plan.heat.heat_report",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
