"""True parameters of the deposition process, known only to the simulators."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_protocol.table_reader import TableReader
from simulators.process.substrate_heights import SubstrateHeights, read_substrate_heights

#: Strips of a bead's cross-section must be resolved: so many voxels lie across the bead at least.
_LEAST_VOXELS_ACROSS = 4.0
#: More than this share of the pool from below is no deposition but remelting.
MAX_DILUTION = 0.8


@dataclass(frozen=True)
class ProcessConfig:
    """What happens in the pool, and the grid it is recorded on.

    max_power_W : beam power at the full S word
    bead_width_mm : of the bead at power_W and speed_mm_s; elsewhere
        width · (P/power)^width_power_exponent · (speed/v)^width_speed_exponent
    power_W, speed_mm_s : at which the bead is so wide
    width_power_exponent, width_speed_exponent : how its width follows power and speed
    dilution : share of the pool that comes from below, at the energy per length power_W/speed_mm_s;
        it changes by dilution_per_J_mm, within 0 and MAX_DILUTION
    dilution_per_J_mm : change of dilution with the energy per length
    substrate : name of the plate, other than every powder; its top is at substrate_z_mm in machine
        coordinates
    substrate_z_mm : height of the plate's top, in machine coordinates
    substrate_heights : how much higher it is than that from place to place; None: nowhere
    substrate_material : the material that the plate is of, "" for one of its own
    best_standoff_mm : distance from tool point to the surface below at which most powder is caught
    nozzle_gap_mm : from the nozzle's tip down to the tool point
    voxel_mm, voxel_height_mm : of the voxel map
    """

    max_power_W: float
    bead_width_mm: float
    power_W: float
    speed_mm_s: float
    width_power_exponent: float = 0.0
    width_speed_exponent: float = 0.0
    dilution: float = 0.0
    dilution_per_J_mm: float = 0.0
    substrate: str = "substrate"
    substrate_material: str = ""
    substrate_z_mm: float = 0.0
    substrate_heights: SubstrateHeights | None = None
    best_standoff_mm: float = 0.8
    nozzle_gap_mm: float = 10.0
    voxel_mm: float = 0.25
    voxel_height_mm: float = 0.25


def read_process(table: TableReader) -> ProcessConfig:
    """The table [process] of a bench file; mistakes are reported to the table."""
    known = len(table.mistakes)
    process = ProcessConfig(
        max_power_W=table.number("max_power_W", above=0, most=100_000),
        bead_width_mm=table.number("bead_width_mm", above=0, most=50),
        power_W=table.number("power_W", above=0, most=100_000),
        speed_mm_s=table.number("speed_mm_s", above=0, most=10_000),
        width_power_exponent=table.number("width_power_exponent", 0.0, least=0, most=2),
        width_speed_exponent=table.number("width_speed_exponent", 0.0, least=0, most=2),
        dilution=table.number("dilution", 0.0, least=0, most=MAX_DILUTION),
        dilution_per_J_mm=table.number("dilution_per_J_mm", 0.0, least=0, most=1),
        substrate=table.text("substrate", "substrate"),
        substrate_material=(
            table.text("substrate_material") if table.has_key("substrate_material") else ""),
        substrate_z_mm=table.number("substrate_z_mm", 0.0, least=-10_000, most=10_000),
        substrate_heights=(read_substrate_heights(table.table("substrate_heights"))
                           if table.has_key("substrate_heights") else None),
        best_standoff_mm=table.number("best_standoff_mm", 0.8, least=-100, most=100),
        nozzle_gap_mm=table.number("nozzle_gap_mm", 10.0, above=0, most=200),
        voxel_mm=table.number("voxel_mm", 0.25, least=0.02, most=5),
        voxel_height_mm=table.number("voxel_height_mm", 0.25, least=0.02, most=5),
    )
    if len(table.mistakes) == known:
        most_mm = process.bead_width_mm / _LEAST_VOXELS_ACROSS
        if process.voxel_mm > most_mm:
            table.report_mistake("voxel_mm", f"must be at most {most_mm:g}, a quarter of the bead")
        if process.power_W > process.max_power_W:
            table.report_mistake("power_W", "must be at most max_power_W")
    table.report_unknown_keys()
    return process
