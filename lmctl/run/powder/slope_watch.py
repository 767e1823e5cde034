"""Slopes of the hoppers during a run: reported outside their interval, corrected if asked to.

Nothing is measured or corrected while the weight or the flow is disturbed: in a hold, a purge or a
refill, and below the level from which the weight is relied on.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping, Sequence

from firmware_protocol.pmx import HopperStatusBits
from lmctl.config.machine import HopperSettings, MachineProfile
from lmctl.config.measuring import FeederCorrectionSettings
from lmctl.machine.feeder.readings import HopperReading
from lmctl.machine.feeder.warnings import FeederWarning
from lmctl.run.cell.devices import Cell
from lmctl.run.interlocks.alarms import RunAlarms
from lmctl.run.journal.recorder import RunRecorder
from lmctl.run.powder.fed import FedPowder
from lmctl.run.powder.slope_window import (
    SlopeCorrection,
    SlopeDrift,
    SlopeMeasurement,
    SlopeWindow,
)

#: How often readings are looked at [s]; a feeder reports its hoppers every few seconds.
_EVERY_S = 2.0
#: A slope that was not measured is taken to be known so well.
_UNKNOWN_SLOPE = 0.02
#: A deviation is over when it is this share of its limit.
_OVER = 0.7
_WIDTHS = 1.96

#: Number of this warning: below those that feeders have (process values 51 to 55).
SLOPE_WARNING_NUMBER = 49


class _HopperSlope:
    """One hopper: its window, its drift and its correction, if it has one."""

    def __init__(
        self, index: int, hopper: HopperSettings, settings: FeederCorrectionSettings,
        is_corrected: bool,
    ) -> None:
        self.index = index
        self.hopper = hopper
        self.settings = settings
        self.window = SlopeWindow(settings.window_s)
        self.drift = SlopeDrift()
        self.correction = SlopeCorrection(settings) if is_corrected else None
        self.read: HopperReading | None = None
        self.warning: FeederWarning | None = None

    @property
    def corrected(self) -> float:
        return 1.0 if self.correction is None else self.correction.value


class SlopeWatch:
    """Watches the slopes of one run, from `start` to `stop`.

    fed : what the present segment's discs have fed
    is_depositing : whether the program is under way
    """

    def __init__(
        self, hoppers: Sequence[HopperSettings], profile: MachineProfile, cell: Cell,
        fed: Callable[[], FedPowder], is_depositing: Callable[[], bool], alarms: RunAlarms,
        recorder: RunRecorder,
    ) -> None:
        by_feeder = {feeder.name: feeder.correction for feeder in profile.feeder}
        self._slopes = [
            _HopperSlope(index, hopper, by_feeder[hopper.feeder] or FeederCorrectionSettings(),
                         by_feeder[hopper.feeder] is not None)
            for index, hopper in enumerate(hoppers)
        ]
        use = profile.calibration_use
        self._half_widths: Mapping[str, float] = {} if use is None else use.slope_half_widths
        self._cell = cell
        self._fed = fed
        self._is_depositing = is_depositing
        self._alarms = alarms
        self._recorder = recorder
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._segment: FedPowder | None = None

    def start(self) -> None:
        self._timer = self._loop.call_later(_EVERY_S, self._look)

    def stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def _look(self) -> None:
        fed = self._fed()
        if fed is not self._segment or not self._is_depositing():
            self._segment = fed
            for slope in self._slopes:
                slope.window.restart()
        else:
            for slope in self._slopes:
                self._look_at(slope, fed)
        self.start()

    def _look_at(self, slope: _HopperSlope, fed: FedPowder) -> None:
        reading = self._cell.hopper_reading(slope.hopper.name)
        if reading is None or reading is slope.read or reading.weight_g is None:
            return
        slope.read = reading
        level = reading.level_percent
        if HopperStatusBits.REFILLING in reading.flags or (
            level is not None and level < slope.settings.least_level_percent
        ):
            slope.window.restart()
            return
        found = slope.window.add(reading.time_s, reading.weight_g,
                                 fed.fed_g(reading.time_s)[slope.index])
        if found is not None:
            self._measured(slope, found)

    def _measured(self, slope: _HopperSlope, found: SlopeMeasurement) -> None:
        """A window is complete: journal it, report a deviation, correct."""
        name, before = slope.hopper.name, slope.corrected
        total = found.ratio * before
        drift = slope.drift.add((found.from_s + found.to_s) / 2.0, total)
        limit = math.hypot(self._half_widths.get(name, _UNKNOWN_SLOPE),
                           _WIDTHS * found.standard_error)
        self._recorder.record_slope(
            hopper=name, ratio=round(found.ratio, 5), slope=round(total, 5),
            error=round(found.standard_error, 5), window_s=round(found.to_s - found.from_s, 1),
            fed_g=round(found.fed_g, 2), limit=round(limit, 5),
            **({} if drift is None else {"drift_per_h": round(drift, 5)}))
        self._tell(slope, total, limit, drift)
        if slope.correction is None:
            return
        after = slope.correction.take(found)
        self._cell.correct_slope(name, after)
        self._recorder.record_slope_correction(
            hopper=name, before=round(before, 5), after=round(after, 5),
            at_limit=slope.correction.is_at_limit,
            reason=f"loss in weight over {found.to_s - found.from_s:.0f} s is "
                   f"{100 * (found.ratio - 1):+.2f} % off the set flow")

    def _tell(self, slope: _HopperSlope, total: float, limit: float, drift: float | None) -> None:
        """Warn where the slope leaves its interval, and say when it is back."""
        off, hopper = abs(total - 1.0), slope.hopper
        if slope.warning is None and off > limit:
            drifting = "" if drift is None else f", drifting by {100 * drift:+.1f} % an hour"
            kept = ("it is corrected slowly" if slope.correction is not None
                    else "nothing corrects it")
            slope.warning = FeederWarning(
                SLOPE_WARNING_NUMBER, hopper.feeder, hopper.name,
                f"hopper {hopper.name} of feeder {hopper.feeder} feeds {100 * (total - 1):+.1f} % "
                f"beside its calibration, by its weight{drifting}; {kept}",
                "after the part: `lmctl machine feeder-test`; [feeder.correction] in the profile "
                "corrects it during a run")
            self._send(slope.warning, is_active=True)
        elif slope.warning is not None and off < _OVER * limit:
            warning, slope.warning = slope.warning, None
            self._send(warning, is_active=False)

    def _send(self, warning: FeederWarning, *, is_active: bool) -> None:
        self._recorder.record_warning(warning, is_active=is_active)
        self._alarms.set_warning(warning, is_active=is_active)
