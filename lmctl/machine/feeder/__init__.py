"""Powder feeders."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.machine.feeder.driver import FeederDriver as FeederDriver
    from lmctl.machine.feeder.identity import FeederIdentity as FeederIdentity
    from lmctl.machine.feeder.identity import identify_feeder as identify_feeder
    from lmctl.machine.feeder.readings import HopperReader as HopperReader
    from lmctl.machine.feeder.readings import HopperReading as HopperReading
    from lmctl.machine.feeder.recipe import post_flow_duration_s as post_flow_duration_s
    from lmctl.machine.feeder.recipe import settling_time_s as settling_time_s
    from lmctl.machine.feeder.status import FeederCallbacks as FeederCallbacks
    from lmctl.machine.feeder.status import FeederStatus as FeederStatus
    from lmctl.machine.feeder.status import read_feeder_status as read_feeder_status
    from lmctl.machine.feeder.warnings import FeederWarning as FeederWarning
    from lmctl.machine.feeder.warnings import WarningReader as WarningReader

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "FeederCallbacks": "lmctl.machine.feeder.status",
    "FeederDriver": "lmctl.machine.feeder.driver",
    "FeederIdentity": "lmctl.machine.feeder.identity",
    "FeederStatus": "lmctl.machine.feeder.status",
    "FeederWarning": "lmctl.machine.feeder.warnings",
    "HopperReader": "lmctl.machine.feeder.readings",
    "HopperReading": "lmctl.machine.feeder.readings",
    "WarningReader": "lmctl.machine.feeder.warnings",
    "identify_feeder": "lmctl.machine.feeder.identity",
    "post_flow_duration_s": "lmctl.machine.feeder.recipe",
    "read_feeder_status": "lmctl.machine.feeder.status",
    "settling_time_s": "lmctl.machine.feeder.recipe",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
