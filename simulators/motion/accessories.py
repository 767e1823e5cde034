"""Beam, spindle and coolant: what is on, and what a hold or the safety door has switched off."""

from __future__ import annotations

from simulators.motion.reports import StatusReporter
from simulators.motion.settings import FirmwareSettings
from simulators.motion.stepper import Stepper

OFF, CLOCKWISE, COUNTERCLOCKWISE = 5, 3, 4  # M5, M3, M4

_DOOR_COOLANT_DELAY_S, _DOOR_SPINDLE_DELAY_S = 1.0, 4.0  # Grbl 1.1 `config.h`


class Accessories:
    """The outputs beside the axes. The next status report includes every change."""

    def __init__(
        self, settings: FirmwareSettings, stepper: Stepper, reporter: StatusReporter, hal: bool
    ) -> None:
        self.spindle_mode = OFF
        self.flood = False
        self.mist = False
        self._settings = settings
        self._stepper = stepper
        self._reporter = reporter
        self._hal = hal
        self.spindle_stopped = False  # by a hold or the door, to be restored
        self._coolant_stopped = False  # by the door
        self._power_before = 0.0  # standstill power to restore

    def set_spindle(self, mode: int, standstill_power: float, now_s: float) -> None:
        """Set M3, M4 or M5 with the axes at rest. standstill_power : from now on, a fraction"""
        if mode != self.spindle_mode or standstill_power != self._stepper.standstill_power:
            self._reporter.on_accessories_changed()
        self.spindle_mode = mode
        self._stepper.set_standstill_power(standstill_power, now_s)

    def set_coolant(self, flood: bool, mist: bool) -> None:
        if (flood, mist) != (self.flood, self.mist):
            self.flood, self.mist = flood, mist
            self._reporter.on_accessories_changed()

    def switch_all_off(self, now_s: float) -> None:
        """Switch all outputs off, with nothing to restore."""
        self.spindle_stopped = self._coolant_stopped = False
        self.set_spindle(OFF, 0.0, now_s)
        self.set_coolant(False, False)

    def stop_spindle(self) -> None:
        """Switch off at the end of the current motion, until `restore_spindle`."""
        if self.spindle_mode != OFF and not self.spindle_stopped:
            self.spindle_stopped = True
            self._power_before = self._stepper.standstill_power
            self._stepper.set_standstill_power(0.0, self._stepper.end_s)
            self._reporter.on_accessories_changed()

    def stop_for_door(self) -> None:
        self.stop_spindle()
        self._coolant_stopped = True
        self._reporter.on_accessories_changed()

    def restore_spindle(self, now_s: float) -> None:
        if self.spindle_stopped:
            self.spindle_stopped = False
            self._stepper.set_standstill_power(self._power_before, now_s)
            # In laser mode Grbl only waits for the next step and reports no change
            if self._hal or not self._settings.is_laser_mode:
                self._reporter.on_accessories_changed()

    def restore(self, now_s: float) -> None:
        """Switch on again what a hold or the door switched off."""
        self.restore_spindle(now_s)
        if self._coolant_stopped:
            self._coolant_stopped = False
            if self.flood or self.mist:
                self._reporter.on_accessories_changed()

    def restore_delay_s(self) -> float:
        """How long the firmware waits for coolant and spindle after the door was closed."""
        coolant_s, spindle_s = _DOOR_COOLANT_DELAY_S, _DOOR_SPINDLE_DELAY_S
        if self._hal:
            spindle_s, coolant_s = self._settings[392], self._settings[393]
        delay_s = coolant_s if self.flood or self.mist else 0.0
        if self.spindle_stopped and not self._settings.is_laser_mode:
            delay_s += spindle_s
        return delay_s

    def letters(self) -> str:
        """The value of `A:`."""
        on = self.spindle_mode != OFF and not self.spindle_stopped
        if not self._hal and self._settings.is_laser_mode:
            _, power = self._stepper.reported_speed_and_power()
            on = on and power > 0.0  # it reports the spindle off while the PWM is zero
        letters = ("C" if self.spindle_mode == COUNTERCLOCKWISE else "S") if on else ""
        if self._coolant_stopped:
            return letters
        return letters + ("F" if self.flood else "") + ("M" if self.mist else "")
