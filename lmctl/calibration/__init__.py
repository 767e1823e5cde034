"""What a cell measures of itself: estimators, the calibration file, and whether it holds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.calibration.calibration_file import Calibration as Calibration
    from lmctl.calibration.calibration_file import CatchCalibration as CatchCalibration
    from lmctl.calibration.calibration_file import DilutionCalibration as DilutionCalibration
    from lmctl.calibration.calibration_file import HopperCalibration as HopperCalibration
    from lmctl.calibration.calibration_file import MeasuredValue as MeasuredValue
    from lmctl.calibration.calibration_file import MeasurementConditions as MeasurementConditions
    from lmctl.calibration.calibration_file import calibration_stamp as calibration_stamp
    from lmctl.calibration.calibration_file import load_calibration as load_calibration
    from lmctl.calibration.calibration_file import save_calibration as save_calibration
    from lmctl.calibration.estimate import Estimate as Estimate
    from lmctl.calibration.step_fit import FeederResponse as FeederResponse
    from lmctl.calibration.step_fit import StepFit as StepFit
    from lmctl.calibration.step_fit import WeighedSteps as WeighedSteps
    from lmctl.calibration.step_fit import fit_feeder_response as fit_feeder_response
    from lmctl.calibration.step_response import SetpointHistory as SetpointHistory
    from lmctl.calibration.validity import CalibrationFinding as CalibrationFinding
    from lmctl.calibration.validity import calibrated_profile as calibrated_profile
    from lmctl.calibration.validity import calibration_findings as calibration_findings

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "Calibration": "lmctl.calibration.calibration_file",
    "CalibrationFinding": "lmctl.calibration.validity",
    "CatchCalibration": "lmctl.calibration.calibration_file",
    "DilutionCalibration": "lmctl.calibration.calibration_file",
    "Estimate": "lmctl.calibration.estimate",
    "FeederResponse": "lmctl.calibration.step_fit",
    "HopperCalibration": "lmctl.calibration.calibration_file",
    "MeasuredValue": "lmctl.calibration.calibration_file",
    "MeasurementConditions": "lmctl.calibration.calibration_file",
    "SetpointHistory": "lmctl.calibration.step_response",
    "StepFit": "lmctl.calibration.step_fit",
    "WeighedSteps": "lmctl.calibration.step_fit",
    "calibrated_profile": "lmctl.calibration.validity",
    "calibration_findings": "lmctl.calibration.validity",
    "calibration_stamp": "lmctl.calibration.calibration_file",
    "fit_feeder_response": "lmctl.calibration.step_fit",
    "load_calibration": "lmctl.calibration.calibration_file",
    "save_calibration": "lmctl.calibration.calibration_file",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
