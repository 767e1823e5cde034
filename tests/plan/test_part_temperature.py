"""Temperature while a part is deposited: conservation, a known solution, and a finer one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lmctl.config.part_rules import parse_part_file
from lmctl.part.load import load_part
from lmctl.part.materials.build_heat import resolve_build_heat
from lmctl.plan.heat.heat_grid import heat_grid
from lmctl.plan.heat.heat_steps import NO_LINES, BeadLines
from lmctl.plan.heat.part_temperature import PartTemperature
from lmctl.plan.planner import plan_job
from tests.benchmarks.mixture_rows.fine_heat import FineConstants, beads_of, fine_temperatures
from tests.benchmarks.mixture_rows.revisits import planner_readings
from tests.plan.planned_jobs import layers_of

BLOCK = """
name = "block"
[[material]]
name = "316L"
{more}
[[body]]
kind = "box"
low_mm = [0, 0, 0]
high_mm = [{high}]
[substrate]
{plate}
[process]
power_W = 800
interpass_max_C = {limit}
{process}
"""


def block(high="10, 8, 2.4", limit=3000, plate="", process="", more=""):
    return BLOCK.format(high=high, limit=limit, plate=plate, process=process, more=more)


def heat_of(text):
    return resolve_build_heat(parse_part_file(text, name="part.toml"))


def temperature_of(heat, low=(0, 0), high=(20, 20), layer_mm=0.8):
    grid = heat_grid(np.array(low, float), np.array(high, float), 2.0, layer_mm)
    return PartTemperature(grid, heat.plate, layer_mm, float(heat.diffusivity_mm2_s.max()))


def line(heat, start, end, start_s, end_s, power_W, volume_mm3):
    """One bead line of the first material."""
    def one(value):
        return np.array([value], float)

    return BeadLines(
        one(start), one(end), one(start_s), one(end_s), one(1.334), one(power_W), one(volume_mm3),
        one(volume_mm3 * heat.capacity_J_mm3_K[0]), one(volume_mm3 * heat.conductivity_W_mm_K[0]))


@pytest.mark.parametrize("name", ["316L", "WC-12Co"])
@pytest.mark.parametrize("aside_mm", [0.0, 0.331])
def test_heat_is_neither_made_nor_lost(name, aside_mm):
    """Insulated, through slabs that retire to deep cells, of a poor and of the best conductor, with
    beads that graze other columns: all that was absorbed is in the body."""
    heat, part = insulated(name)
    for layer in range(24):
        part.begin_layer()
        begin, y = part.time_s, 9 + layer % 3 * aside_mm
        beads = line(heat, (2, y), (18, y + 2), begin, begin + 2, 300, 20)
        part.advance(begin + 3, beads, np.empty(0), np.empty((0, 2)))
    assert part.heat_content_J() == pytest.approx(24 * 600, rel=2e-3)


@pytest.mark.parametrize("name", ["316L", "WC-12Co"])
@pytest.mark.parametrize("row", [4.5, 5.5])
@pytest.mark.parametrize("sliver", [1e-5, 1e-7, 1e-9])
def test_slivers_of_columns_do_not_run_away(name, row, sliver):
    """Beads beside a column of which they fill so little: it conducts no more than it can hold, in
    fine cells and when it has retired to deep ones."""
    heat, part = insulated(name)
    grid = heat_grid(np.zeros(2), np.full(2, 20.0), 2.0, 0.8)
    # a bead is deposited along two lines, a quarter of its strip aside
    y = grid.origin_mm[1] + (row + sliver) * grid.cell_mm - 1.334 / 4
    for _ in range(24):
        part.begin_layer()
        begin = part.time_s
        beads = line(heat, (2, y), (18, y), begin, begin + 2, 30, 20)
        read = part.advance(begin + 3, beads, np.full(30, begin + 2.9), np.column_stack([
            np.full(30, 10.0), np.linspace(0, 20, 30)]))
        # what a bead would have if it conducted nothing
        assert np.nanmax(read) < 25 + 60 / (20 * heat.capacity_J_mm3_K[0])
        assert np.nanmin(read) > 19.5
    assert part.heat_content_J() == pytest.approx(24 * 60, rel=2e-3)


def insulated(name):
    """Constants of a part of one powder, and its temperature on an insulated plate."""
    heat = heat_of(block(plate="contact_W_m2_K = 0", process="surface_loss_W_m2_K = 0").replace(
        "316L", name))
    return heat, temperature_of(heat)


def test_a_spot_on_a_thick_plate_cools_as_the_half_space():
    """T = E / (4 ρc (π a t)^1.5) exp(−r²/4at), Carslaw and Jaeger (1959), 10.2, with its image."""
    heat = heat_of(block(plate='material = "316L"\nthickness_mm = 80',
                         process="surface_loss_W_m2_K = 0"))
    part = temperature_of(heat)
    part.begin_layer()
    energy_J, spot = 500.0, (10.0, 10.0)
    places = np.array([[10.0, 10.0], [13.0, 10.0], [10.0, 14.0]])
    times = np.repeat([4.0, 8.0, 16.0], len(places))
    read = part.advance(20.0, line(heat, spot, (10.02, 10.0), 0.0, 0.2, energy_J / 0.2, 0.05),
                        times, np.tile(places, (3, 1)))
    assert part.heat_content_J() == pytest.approx(energy_J, rel=1e-3)
    a, c = heat.diffusivity_mm2_s[0], heat.capacity_J_mm3_K[0]
    t, r2 = times - 0.1, np.tile(((places - spot) ** 2).sum(axis=1), 3)
    known = energy_J / (4 * c * (np.pi * a * t) ** 1.5) * np.exp(-r2 / (4 * a * t))
    # a slab's mean is read for its surface, and only half of each slab lies below its middle
    assert read - 20.0 == pytest.approx(known, rel=0.1)


def test_a_plate_without_a_beam_keeps_the_tables_temperature():
    heat = heat_of(block(limit=400, plate="temperature_C = 200", process="surface_loss_W_m2_K = 0"))
    part = temperature_of(heat)
    part.begin_layer()
    read = part.advance(60.0, NO_LINES, np.array([0.0, 59.0]), np.full((2, 2), 5.0))
    assert read == pytest.approx([200.0, 200.0], abs=0.01)


def test_a_copy_goes_on_by_itself():
    heat = heat_of(block())
    part = temperature_of(heat)
    part.begin_layer()
    beads = line(heat, (2, 9), (18, 11), 0.0, 2.0, 400, 20)
    other = part.copy()
    hot = other.advance(3.0, beads, np.array([2.5]), np.array([[10.0, 10.0]]))
    cold = part.advance(3.0, NO_LINES, np.array([2.5]), np.array([[10.0, 10.0]]))
    assert hot[0] > 100
    assert cold[0] == pytest.approx(20.0, abs=0.01)


@pytest.fixture
def planned(tmp_path, profile):
    def plan(text, name="p"):
        file = tmp_path / f"{name}.toml"
        file.write_text(text, encoding="utf-8")
        part = load_part(Path(file))
        plan_job(part, profile, file.with_suffix(".lmj"))
        manifest, layers = layers_of(file.with_suffix(".lmj"))
        return part, manifest, layers

    return plan


@pytest.mark.parametrize("conductor", ["316L", "WC-12Co"])
def test_readings_agree_with_a_finer_solution(planned, conductor):
    """A small block of three layers, read where the planner reads; within a tenth of the rise."""
    part, manifest, layers = planned(block().replace("316L", conductor))
    at_s, place_mm, found_C = planner_readings(part, layers, manifest)
    heat, plate = part.build_heat, part.build_heat.plate
    constants = FineConstants(
        heat.conductivity_W_mm_K, heat.capacity_J_mm3_K, heat.absorptivity,
        plate.conductivity_W_mm_K, plate.capacity_J_mm3_K, plate.thickness_mm, plate.at_C,
        plate.contact_W_mm2_K, plate.loss_W_mm2_K, plate.ambient_C)
    fine_C = fine_temperatures(beads_of(layers, part.process.overlap), constants,
                               manifest.totals["layer_height_mm"], 2.0, at_s, place_mm, 1.334 / 3)
    # a tenth of the rise, or the 5 K of a good thermocouple
    off = np.abs(found_C - fine_C) / np.maximum(fine_C - plate.at_C, 50.0)
    assert (off <= 0.1).mean() >= 0.9
    assert found_C.max() > (250 if conductor == "316L" else 150)
