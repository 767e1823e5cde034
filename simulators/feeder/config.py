"""True parameters of a simulated feeder, known only to the simulators."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_protocol.registers import WordOrder


@dataclass(frozen=True)
class HopperConfig:
    """One hopper, its disc, its hose and the powder in it.

    Source: docs/explanation/powder-delivery.md, Feeders.

    channel : its number on the feeder
    material : the powder in it
    density_g_mm3, catch_efficiency : of the powder alone, at its best standoff; only the record of
        the bench and the simulated process use them
    catch_in_mixture : relative change of the catch efficiency per mass share of other powders
    catch_falloff_mm : the catch falls as exp(−(Δ/falloff)²) with the distance Δ of the surface from
        the best standoff; 0: it does not fall
    dead_time_s, lag_s : θ and τ from disc to nozzle; drive_lag_s : of the disc drive
    carrier_L_min : carrier gas for which dead_time_s and lag_s hold
    carrier_share : the share of both that goes with 1/carrier gas, the rest is the feeder's own
    feed_factor_g_rev, offset_g_min : the true flow is offset + slope_factor · factor · rpm
    slope_factor : true slope over feed_factor_g_rev
    slope_drift_per_h : relative change of the slope in an hour, from the first turn of the disc on
    slope_change_to_empty : relative change of the slope from the full hopper to the empty one
    calibrated_g_rev : the factor the device uses; None: feed_factor_g_rev
    n_min_rpm, n_max_rpm : below n_min_rpm the disc does not turn; n_max_rpm is its highest speed
    fill_g : powder at the start
    noise_rsd, noise_time_s : relative standard deviation and correlation time of the flow at the
        nozzle, drawn from `seed`
    seed : of the noise; the same seed and channel give the same noise
    pulsation_rsd, pulses_per_rev : of the sine that the grooves of the disc put on the flow
    """

    channel: int
    material: str
    density_g_mm3: float
    catch_efficiency: float
    dead_time_s: float
    lag_s: float
    feed_factor_g_rev: float
    n_min_rpm: float
    n_max_rpm: float
    fill_g: float
    drive_lag_s: float = 0.0
    offset_g_min: float = 0.0
    calibrated_g_rev: float | None = None
    noise_rsd: float = 0.0
    seed: int = 0
    noise_time_s: float = 1.0
    pulsation_rsd: float = 0.0
    pulses_per_rev: float = 10.0
    slope_factor: float = 1.0
    slope_drift_per_h: float = 0.0
    slope_change_to_empty: float = 0.0
    carrier_L_min: float = 4.0
    carrier_share: float = 0.0
    catch_in_mixture: float = 0.0
    catch_falloff_mm: float = 0.0

    @property
    def slope_drifts(self) -> bool:
        """Whether the slope changes by itself while the disc turns."""
        return bool(self.slope_drift_per_h or self.slope_change_to_empty)


@dataclass(frozen=True)
class FeederConfig:
    """One PMX device.

    device_id : its unit id
    boot_s : time from power-up until it answers writes
    preflow_s : carrier gas before powder may run
    word_order : of 32-bit values
    map_minor : 1 has the mirror for FC 23, 0 has not
    has_watchdog : whether its discs stop when heartbeats do
    """

    name: str
    hoppers: tuple[HopperConfig, ...]
    device_id: int = 1
    boot_s: float = 0.0
    preflow_s: float = 3.0
    map_minor: int = 1
    word_order: WordOrder = WordOrder.ABCD
    has_watchdog: bool = True
