"""True parameters of a simulated catch scale, known only to the simulators."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_protocol.registers import WordOrder
from firmware_protocol.table_reader import TableReader


@dataclass(frozen=True)
class ScaleConfig:
    """One scale.

    lag_s : first-order lag of what it shows behind what lies on it
    cycle_s : between two weighings of its own
    resolution_g : step of the display; noise_g : standard deviation before rounding
    capacity_g : greatest load, the pan's included
    pan_g : load at power-up, before a tare
    tare_works : whether it carries a tare out
    drift_g_min : by which the display moves without a load
    weight_g : of the known weight that lies beside it
    x_mm, y_mm : where it stands; reach_mm : how far from there the nozzle may be for its powder to
        fall onto the pan; 0: wherever the nozzle is, it is under it
    device_id : its unit id
    seed : of the noise
    """

    device_id: int = 1
    lag_s: float = 0.3
    cycle_s: float = 0.1
    resolution_g: float = 0.01
    noise_g: float = 0.0
    capacity_g: float = 2000.0
    pan_g: float = 120.0
    tare_works: bool = True
    drift_g_min: float = 0.0
    weight_g: float = 100.0
    x_mm: float = 0.0
    y_mm: float = 0.0
    reach_mm: float = 0.0
    seed: int = 0
    word_order: WordOrder = WordOrder.ABCD


def read_scale_config(table: TableReader) -> ScaleConfig:
    """The table [scale] of a bench, but for its endpoint; mistakes go to the reader."""
    usual = ScaleConfig()
    return ScaleConfig(
        device_id=table.integer("device_id", usual.device_id, least=1, most=247),
        lag_s=table.number("lag_s", usual.lag_s, least=0, most=10),
        cycle_s=table.number("cycle_s", usual.cycle_s, least=0.01, most=2),
        resolution_g=table.number("resolution_g", usual.resolution_g, least=0.01, most=10),
        noise_g=table.number("noise_g", usual.noise_g, least=0, most=10),
        capacity_g=table.number("capacity_g", usual.capacity_g, above=0, most=1e6),
        pan_g=table.number("pan_g", usual.pan_g, least=0, most=1e6),
        tare_works=table.boolean("tare_works", usual.tare_works),
        drift_g_min=table.number("drift_g_min", usual.drift_g_min, least=-100, most=100),
        weight_g=table.number("weight_g", usual.weight_g, above=0, most=1e6),
        x_mm=table.number("x_mm", usual.x_mm, least=-10_000, most=10_000),
        y_mm=table.number("y_mm", usual.y_mm, least=-10_000, most=10_000),
        reach_mm=table.number("reach_mm", usual.reach_mm, least=0, most=10_000),
        seed=table.integer("seed", usual.seed, least=0, most=2**31),
    )
