"""Powder on time: hopper set-points sent now for the flow that the path needs later."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.run.powder.fed import FedPowder as FedPowder
    from lmctl.run.powder.lead import HoseDynamics as HoseDynamics
    from lmctl.run.powder.lead import PowderPlan as PowderPlan
    from lmctl.run.powder.refill import RefillProcedure as RefillProcedure
    from lmctl.run.powder.setpoint_sender import SetpointSender as SetpointSender
    from lmctl.run.powder.slope_watch import SlopeWatch as SlopeWatch
    from lmctl.run.powder.supply import SupplyWatch as SupplyWatch

#: Public names and the module that holds each; a module is imported on first use.
_HOMES = {
    "FedPowder": "lmctl.run.powder.fed",
    "HoseDynamics": "lmctl.run.powder.lead",
    "PowderPlan": "lmctl.run.powder.lead",
    "RefillProcedure": "lmctl.run.powder.refill",
    "SetpointSender": "lmctl.run.powder.setpoint_sender",
    "SlopeWatch": "lmctl.run.powder.slope_watch",
    "SupplyWatch": "lmctl.run.powder.supply",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
