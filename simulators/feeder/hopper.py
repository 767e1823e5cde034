"""A hopper of a PMX device, as the device drives it, and when powder was fed."""

from __future__ import annotations

from dataclasses import dataclass, replace

from simulators.feeder.config import HopperConfig
from simulators.feeder.process import FloatArray, HopperProcess

_ENDLESS_G = 1e12
_ROUNDING_RPM = 1e-9

#: Commands that may wait to be followed.
_MAX_WAITING = 10_000


class IdealHopper:
    """The process of a hopper that is never empty, and with which all is always well.

    It hears every command, and follows them when somebody asks what it does.
    """

    def __init__(self, config: HopperConfig) -> None:
        self._process = HopperProcess(replace(config, fill_g=_ENDLESS_G, noise_rsd=0.0))
        self._waiting: list[tuple[float, float, float]] = []

    def command_rpm(self, time_s: float, rpm: float, ramp_s: float = 0.0) -> None:
        """As `HopperProcess.command`."""
        self._waiting.append((time_s, rpm, ramp_s))
        if len(self._waiting) > _MAX_WAITING:
            self._follow()

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
    """A hopper and what the running recipe asks of it.

    rpm : what its disc is to do; requested_rpm : before the device clipped that
    fault_free_process : the same, were all well with it; for the judge
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
        """Full, its disc at rest."""
        return cls(config, HopperProcess(config), IdealHopper(config))

    def apply_setpoint(self, rpm: float, most_rpm: float) -> None:
        """A new set-point; clipped to most_rpm, and the clipping told."""
        self.is_setpoint_clipped = rpm > most_rpm + _ROUNDING_RPM
        self.rpm = min(rpm, most_rpm)
        self.requested_rpm = min(rpm, self.config.n_max_rpm)

    def start_disc(self, time_s: float, ramp_s: float) -> None:
        """Let the disc go to its speed from time_s on."""
        self.process.command_rpm(time_s, self.rpm, ramp_s)
        self.fault_free_process.command_rpm(time_s, self.requested_rpm, ramp_s)

    def stop(self, time_s: float) -> None:
        self.process.command_rpm(time_s, 0.0)
        self.fault_free_process.command_rpm(time_s, 0.0)


@dataclass(frozen=True)
class FeedInterval:
    """Discs were on from start_s to end_s (inf while they are), called stable from stable_s."""

    start_s: float
    stable_s: float
    end_s: float
