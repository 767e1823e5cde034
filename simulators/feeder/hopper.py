"""A hopper of a PMX device, as the device drives it, and when powder was fed."""

from __future__ import annotations

from dataclasses import dataclass, replace

from simulators.feeder.config import HopperConfig
from simulators.feeder.process import HopperProcess

_ENDLESS_G = 1e12


@dataclass
class Hopper:
    """A hopper and what the running recipe asks of it.

    told : the same process, were all well with it and the hopper never empty; for the judge
    """

    config: HopperConfig
    process: HopperProcess
    told: HopperProcess
    rpm: float = 0.0
    carrier_L_min: float = 0.0
    stirrer_rpm: float = 0.0
    limited: bool = False

    @classmethod
    def of(cls, config: HopperConfig) -> Hopper:
        """Full, its disc at rest."""
        told = HopperProcess(replace(config, fill_g=_ENDLESS_G, noise_rsd=0.0))
        return cls(config, HopperProcess(config), told)

    def command(self, time_s: float, rpm: float, ramp_s: float = 0.0) -> None:
        """Let the disc go to rpm from time_s on."""
        self.process.command(time_s, rpm, ramp_s)
        self.told.command(time_s, rpm, ramp_s)


@dataclass(frozen=True)
class FeedSpan:
    """Discs were on from start_s to end_s (inf while they are), called stable from stable_s."""

    start_s: float
    stable_s: float
    end_s: float
