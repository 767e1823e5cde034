"""A hopper of a PMX device, its set-points, and the intervals in which it fed powder."""

from __future__ import annotations

from dataclasses import dataclass, replace

from simulators.array_types import FloatArray
from simulators.feeder.config import HopperConfig
from simulators.feeder.process import HopperProcess

_ENDLESS_G = 1e12
_ROUNDING_RPM = 1e-9

#: Most commands that are queued before they are carried out.
_MAX_WAITING = 10_000


class IdealHopper:
    """The process of a fault-free hopper that is never empty.

    It receives every command, and carries them out when a caller reads its speed or flow.
    """

    def __init__(self, config: HopperConfig) -> None:
        self._process = HopperProcess(replace(
            config, fill_g=_ENDLESS_G, noise_rsd=0.0, pulsation_rsd=0.0, slope_drift_per_h=0.0,
            slope_change_to_empty=0.0))
        self._waiting: list[tuple[float, float, float]] = []

    def command_rpm(self, time_s: float, rpm: float, ramp_s: float = 0.0) -> None:
        """As `HopperProcess.command_rpm`."""
        self._waiting.append((time_s, rpm, ramp_s))
        if len(self._waiting) > _MAX_WAITING:
            self._follow()

    def set_carrier_L_min(self, time_s: float, carrier_L_min: float) -> None:
        """As `HopperProcess.set_carrier_L_min`."""
        self._follow()
        self._process.set_carrier_L_min(time_s, carrier_L_min)

    def disc_rpm(self, time_s: float) -> float:
        """As `HopperProcess.disc_rpm`."""
        self._follow()
        return self._process.disc_rpm(time_s)

    def nozzle_flow_g_s(self, time_s: FloatArray) -> FloatArray:
        """As `HopperProcess.nozzle_flow_g_s`."""
        self._follow()
        return self._process.nozzle_flow_g_s(time_s)

    def _follow(self) -> None:
        for command in self._waiting:
            self._process.command_rpm(*command)
        self._waiting.clear()


@dataclass
class SimulatedHopper:
    """A hopper and its set-points from the running recipe.

    rpm : disc set-point; requested_rpm : the same before the device clipped it
    fault_free_process : the process without faults; reference for the safety checks
    """

    config: HopperConfig
    process: HopperProcess
    fault_free_process: IdealHopper
    rpm: float = 0.0
    requested_rpm: float = 0.0
    carrier_L_min: float = 0.0
    stirrer_rpm: float = 0.0
    is_setpoint_clipped: bool = False

    @classmethod
    def from_config(cls, config: HopperConfig) -> SimulatedHopper:
        """A full hopper with its disc at rest."""
        return cls(config, HopperProcess(config), IdealHopper(config))

    def apply_setpoint(self, rpm: float, most_rpm: float) -> None:
        """Apply a new set-point, clip it to most_rpm, and flag the clipping."""
        self.is_setpoint_clipped = rpm > most_rpm + _ROUNDING_RPM
        self.rpm = min(rpm, most_rpm)
        self.requested_rpm = min(rpm, self.config.n_max_rpm)

    def set_carrier(self, time_s: float, carrier_L_min: float) -> None:
        """Set the carrier gas; what is fed from time_s on travels with it."""
        if carrier_L_min == self.carrier_L_min:
            return
        self.carrier_L_min = carrier_L_min
        if self.config.carrier_share:
            self.process.set_carrier_L_min(time_s, carrier_L_min)
            self.fault_free_process.set_carrier_L_min(time_s, carrier_L_min)

    def start_disc(self, time_s: float, ramp_s: float) -> None:
        """Ramp the disc to its set-point from time_s on."""
        self.process.command_rpm(time_s, self.rpm, ramp_s)
        self.fault_free_process.command_rpm(time_s, self.requested_rpm, ramp_s)

    def stop(self, time_s: float) -> None:
        self.process.command_rpm(time_s, 0.0)
        self.fault_free_process.command_rpm(time_s, 0.0)


@dataclass(frozen=True)
class FeedInterval:
    """Discs were on from start_s to end_s (inf while on), reported as stable from stable_s."""

    start_s: float
    stable_s: float
    end_s: float
