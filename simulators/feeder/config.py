"""True parameters of a simulated feeder, known only to the simulators."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_protocol.registers import WordOrder


@dataclass(frozen=True)
class HopperConfig:
    """One hopper, its disc, its hose and the powder in it.

    Source: docs/explanation/powder-delivery.md, Feeders.

    density_g_mm3, catch_efficiency : of the powder; only the safety checks use them
    dead_time_s, lag_s : θ and τ from disc to nozzle; drive_lag_s : of the disc drive
    feed_factor_g_rev, offset_g_min : the true flow is offset + factor · rpm
    calibrated_g_rev : the factor the device uses; None: the true one
    n_min_rpm, n_max_rpm : below n_min_rpm the disc stands still; n_max_rpm is its highest speed
    fill_g : powder at the start
    noise_rsd : relative standard deviation of the flow at the nozzle, drawn from `seed`
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


@dataclass(frozen=True)
class FeederConfig:
    """One PMX device.

    boot_s : time from power-up until it answers writes
    preflow_s : carrier gas before powder may run
    word_order : of 32-bit values
    map_minor : 1 has the mirror for FC 23, 0 has not
    """

    name: str
    hoppers: tuple[HopperConfig, ...]
    device_id: int = 1
    boot_s: float = 0.0
    preflow_s: float = 3.0
    map_minor: int = 1
    word_order: WordOrder = WordOrder.ABCD
