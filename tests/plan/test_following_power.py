"""Beam power that falls where a layer finds what is below it hot: how far, and what it saves."""

from __future__ import annotations

import numpy as np
import pytest

from lmctl.plan.heat.following_power import following_power_factor
from tests.plan.test_heat_waits import findings
from tests.plan.test_part_temperature import block

FOLLOWS = "power_follows_temperature = true"


@pytest.mark.parametrize(("found_C", "factor"), [
    ([20.0], 1.0),  # as the plate is
    ([0.0], 1.0),  # never more than the recipe's
    ([710.0], 0.5),  # half way to the melting point
    ([365.0, 1055.0], 0.5),  # as the mean is
    ([1300.0], 0.4), ([1500.0], 0.4),  # no lower than that
    ([np.nan, 710.0], 0.5), ([np.nan], 1.0),
])
def test_power_goes_with_the_rise_to_the_melting_point(found_C, factor):
    assert following_power_factor(np.array(found_C), 1400.0, 20.0, 0.4) == pytest.approx(factor)


def test_each_layer_has_the_power_for_what_it_finds(plan):
    text = block(high="12, 8, 8", limit=250)
    stays, layers = plan(text)
    follows, slower = plan(block(high="12, 8, 8", limit=250, process=FOLLOWS))
    factors = [layer.power_factor for layer in follows.heat]
    assert factors[0] == 1.0  # on the plate
    assert 0.7 <= min(factors) < max(factors[1:]) < 0.95
    assert [layer.power_factor for layer in stays.heat] == [1.0] * len(factors)
    # the power of the program is that which the job and its totals state
    assert [layer.lines["power_W"].max() for layer in slower] == pytest.approx(
        [800 * factor for factor in factors], rel=2e-3)
    said = follows.totals["predicted_heat"]
    assert said["least_power_factor"] == min(factors)
    assert any(f"down to {100 * min(factors):.0f} % of the recipe's" in found["text"]
               for found in follows.verdict)
    # less heat, less waiting; the same beads
    assert said["wait_s"] < 0.9 * stays.totals["predicted_heat"]["wait_s"]
    assert follows.totals["path_length_mm"] == pytest.approx(
        stays.totals["path_length_mm"], abs=0.05)
    assert follows.totals["deposited_volume_mm3"] == pytest.approx(
        stays.totals["deposited_volume_mm3"], rel=1e-4)
    assert len(layers) == len(slower)


def test_power_falls_on_top_of_stated_factors_and_not_below_its_range(plan):
    manifest, _ = plan(block(high="12, 8, 8", limit=1000, process=(
        f"{FOLLOWS}\nfirst_layer_power = 1.1\npower_per_layer = 0.95\nfinal_power = 0.9\n"
        "power_range = [0.75, 1.3]")))
    factors = [layer.power_factor for layer in manifest.heat]
    assert factors[0] == pytest.approx(1.1)
    assert factors[2] < 0.95
    assert min(factors) == pytest.approx(0.75)


def test_mixtures_melt_between_their_powders(plan):
    """Of equal heat, a layer of what melts lower has less power."""
    def factor(high_share):
        more = """melting_C = 1400
[[material]]
name = "WC-12Co"
density_g_cm3 = 7.99
speed_mm_s = 10
conductivity_W_m_K = 14.6
heat_capacity_J_kg_K = 500
absorptivity = 0.37
melting_C = 3200"""
        composition = f"""
[body.composition]
feature = {{ kind = "axis", point_mm = [0, 0, 0], direction = [0, 0, 1] }}
profile = {{ kind = "constant", of = {{ "316L" = {1 - high_share}, "WC-12Co" = {high_share} }} }}
[substrate]"""
        text = block(high="12, 8, 4", limit=1200, process=FOLLOWS, more=more)
        return plan(text.replace("[substrate]", composition))[0].heat[1].power_factor

    # the layer on the first one finds the same in both
    low, middle = factor(0.0), factor(0.5)
    assert (1 - middle) * (2300 - 20) == pytest.approx((1 - low) * (1400 - 20), rel=0.01)


def test_it_needs_a_limit_and_melting_points():
    found = findings(block(process=FOLLOWS).replace("interpass_max_C = 3000", ""))
    assert list(found) == ["process.power_follows_temperature"]
    assert "process.interpass_max_C" in found["process.power_follows_temperature"]
    found = findings(block(limit=250, process=FOLLOWS).replace(
        'name = "316L"', 'name = "mine"\ndensity_g_cm3 = 8\nabsorptivity = 0.4\n'
        "conductivity_W_m_K = 15\nheat_capacity_J_kg_K = 500"))
    assert list(found) == ["material[1].melting_C"]
    found = findings(block(limit=1400, process=FOLLOWS))
    assert list(found) == ["process.interpass_max_C"]
    assert "melting point of '316L', 1400 °C" in found["process.interpass_max_C"]


def test_some_layers_alone_have_the_power_of_the_recipe_and_say_so(plan):
    manifest, layers = plan(block(limit=250, process=FOLLOWS), layers=(2, 3))
    assert {layer.lines["power_W"].max() for layer in layers} == {800}
    assert any("beam power is the recipe's" in found["text"] for found in manifest.verdict)
