"""Dead times and lags that a run leads powder by, and what purges have measured of them since.

They begin as the profile states them, measured by a feeder test or typed in. What a purge measures
is for this run alone: the calibration file stays as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lmctl.calibration.estimate import Estimate
from lmctl.calibration.hose_estimate import HoseEstimate, Revision, revised
from lmctl.calibration.hose_fit import HoseBelief
from lmctl.config.machine import HopperSettings
from lmctl.config.measuring import CalibrationUse, Interval
from lmctl.machine.feeder.warnings import FeederWarning
from lmctl.run.interlocks.alarms import RunAlarms
from lmctl.run.journal.recorder import RunRecorder
from lmctl.run.powder.lead import HoseDynamics

#: Number of this warning: below those that feeders have (process values 51 to 55).
HOSE_WARNING_NUMBER = 48
#: How well a slope is known, as a share of it, that may have drifted since it was measured.
_SLOPE_ERROR = 0.03
#: An interval of no width says nothing of its value [s].
_LEAST_HALF_S = 1e-3


class HoseCalibration:
    """The hoses of one run, in the order of the job's hoppers. use : of the profile, if measured"""

    def __init__(
        self, hoppers: Sequence[HopperSettings], use: CalibrationUse | None, alarms: RunAlarms,
        recorder: RunRecorder,
    ) -> None:
        self._hoppers = tuple(hoppers)
        self._alarms = alarms
        self._recorder = recorder
        self._calibrated = tuple(_calibrated(hopper, use) for hopper in hoppers)
        self._in_use = list(self._calibrated)
        self._warnings: dict[str, FeederWarning] = {}

    def dynamics(self) -> list[HoseDynamics]:
        """As powder is led by them from now on."""
        return [
            HoseDynamics(hose.dead_time_s, hose.lag_s, hopper.max_flow_g_min, hopper.min_flow_g_min)
            for hopper, hose in zip(self._hoppers, self._in_use, strict=True)
        ]

    def beliefs(self) -> tuple[HoseBelief, ...]:
        """As a measurement takes them to be. Set-points hold the slope: it is about 1."""
        return tuple(HoseBelief(hose.dead_time_s, max(hose.lag_s, 0.1), Estimate(1.0, _SLOPE_ERROR))
                     for hose in self._in_use)

    def take(self, measured: Sequence[HoseEstimate], took_s: float) -> None:
        """A purge has measured all hoses: journal each, report deviations, use what is sure.

        measured : in the hoppers' order, each with its covariance
        """
        for at, (hopper, found) in enumerate(zip(self._hoppers, measured, strict=True)):
            revision, after = revised(self._in_use[at], found)
            self._recorder.record_hose_response(
                hopper=hopper.name, source="measured", **_rounded(found), revision=revision.value,
                used_dead_time_s=round(after.dead_time_s, 4), used_lag_s=round(after.lag_s, 4),
                took_s=round(took_s, 1))
            self._in_use[at] = after
            self._tell(hopper, self._calibrated[at], found, revision)

    def _tell(
        self, hopper: HopperSettings, calibrated: HoseEstimate, found: HoseEstimate,
        revision: Revision,
    ) -> None:
        """Warn where the measurement is not what the profile has, and say when it is again."""
        differs = revised(calibrated, found)[0] is not Revision.AGREES
        if before := self._warnings.pop(hopper.name, None):
            self._send(before, is_active=False)
        if not differs:
            return
        off_s = found.response.value - calibrated.response.value
        later = f"{abs(off_s):.2f} s {'later' if off_s > 0 else 'sooner'}"
        followed = ("powder is led by what was measured" if revision is not Revision.REFUSED else
                    "powder is led as before: the measurement is not sure enough")
        warning = self._warnings[hopper.name] = FeederWarning(
            HOSE_WARNING_NUMBER, hopper.feeder, hopper.name,
            f"hopper {hopper.name} of feeder {hopper.feeder}: its powder arrives {later} than the "
            f"profile has it, by the scale at the purge position (dead time "
            f"{found.dead_time.text(2, 's')}, lag {found.lag.text(2, 's')}); {followed}",
            "see to carrier gas and hose; after the part: `lmctl machine feeder-test`")
        self._send(warning, is_active=True)

    def _send(self, warning: FeederWarning, *, is_active: bool) -> None:
        self._recorder.record_warning(warning, is_active=is_active)
        self._alarms.set_warning(warning, is_active=is_active)


def _calibrated(hopper: HopperSettings, use: CalibrationUse | None) -> HoseEstimate:
    """As the profile states a hose: with its intervals where it was measured."""
    known = None if use is None else use.intervals.get(hopper.name)
    ends = None if known is None else (known.dead_time_s, known.lag_s, known.response_s)
    if ends is None or None in ends:
        return HoseEstimate(hopper.dead_time_s, hopper.lag_s)
    dead_time_half_s, lag_half_s, response_half_s = map(_half_width, ends)
    return HoseEstimate.of_half_widths(
        hopper.dead_time_s, hopper.lag_s, dead_time_half_s=dead_time_half_s,
        lag_half_s=lag_half_s, response_half_s=response_half_s)


def _half_width(interval: Interval) -> float:
    assert interval is not None
    return max((interval[1] - interval[0]) / 2.0, _LEAST_HALF_S)


def _rounded(hose: HoseEstimate) -> dict[str, Any]:
    """Values and half widths of their 95 % intervals, as journals hold them."""
    of = {"dead_time": hose.dead_time, "lag": hose.lag, "response": hose.response}
    return {f"{name}_{what}": round(value, 4) for name, one in of.items()
            for what, value in (("s", one.value), ("half_s", one.half_width))}
