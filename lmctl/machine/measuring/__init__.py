"""Tests in which a cell measures itself, beam off."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.machine.measuring.feeder_test import FeederTest as FeederTest
    from lmctl.machine.measuring.feeder_test import FeederTestResult as FeederTestResult
    from lmctl.machine.measuring.scale_lag import ScaleOperator as ScaleOperator
    from lmctl.machine.measuring.scale_lag import measure_scale_lag as measure_scale_lag
    from lmctl.machine.measuring.step_plan import StepPlan as StepPlan
    from lmctl.machine.measuring.step_plan import WantedPrecision as WantedPrecision

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "FeederTest": "lmctl.machine.measuring.feeder_test",
    "FeederTestResult": "lmctl.machine.measuring.feeder_test",
    "ScaleOperator": "lmctl.machine.measuring.scale_lag",
    "StepPlan": "lmctl.machine.measuring.step_plan",
    "WantedPrecision": "lmctl.machine.measuring.step_plan",
    "measure_scale_lag": "lmctl.machine.measuring.scale_lag",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
