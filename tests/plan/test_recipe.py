"""From volume fractions to mass flows, within what hoppers can meter."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lmctl.config.part_file import ProcessSettings
from lmctl.errors import PlanError
from lmctl.plan.recipe import hopper_flows_g_min, make_recipe, recipe_of


def mixes(*second):
    second = np.array(second, dtype=float)
    return np.stack([1 - second, second], axis=1)


def test_the_worked_example_of_volume_to_mass():
    """Equal volumes of steel and carbide at 7.8 mm³/s."""
    flow = hopper_flows_g_min([0.5, 0.5], [0.00785, 0.0143], [0.75, 0.55], 7.8)
    assert flow == pytest.approx([2.4492, 6.084], abs=5e-5)


def test_flow_and_deposited_volume_are_each_others_inverse(recipe):
    fractions = mixes(0, 0.1, 0.5, 0.77, 1)
    assert recipe.deposited_fractions(recipe.flow_g_s(fractions)) == pytest.approx(fractions)


def test_deposited_volume_is_pitch_height_and_speed(recipe):
    flow = recipe.flow_g_s(mixes(0.3))
    volume = (flow * recipe.catch_efficiency / recipe.density_g_mm3).sum()
    assert volume == pytest.approx(2.0 * 0.667 * 0.8 * 10)


def test_speed_and_power_lie_between_the_pure_recipes(recipe):
    assert recipe.power(mixes(0, 0.5, 1)) == pytest.approx([1500, 1650, 1800])
    assert recipe.speed(mixes(0.25)) == pytest.approx([10])


def test_what_a_hopper_cannot_meter_goes_to_the_nearer(recipe):
    """The carbide hopper meters 0.8 g/min and more: 4.8 % of the volume here."""
    least = 0.8 / recipe.flow_g_s(mixes(1.0))[0, 1] / 60
    wanted = np.array([0.0, 0.3, 0.45, 0.55, 0.9, 1.0, 1.5]) * least
    got = recipe.deliverable_mixtures(mixes(*wanted))[:, 1]
    assert got == pytest.approx(np.array([0, 0, 0, 1, 1, 1, 1.5]) * least)


@settings(max_examples=60, deadline=None, suppress_health_check=[
    HealthCheck.function_scoped_fixture])
@given(second=st.lists(st.floats(0, 1), min_size=1, max_size=20))
def test_whatever_is_wanted_can_be_metered_afterwards(recipe, second):
    got = recipe.deliverable_mixtures(mixes(*second))
    flow = recipe.flow_g_s(got)
    assert got.sum(axis=1) == pytest.approx(np.ones(len(second)))
    assert ((flow < 1e-12) | (flow >= recipe.min_flow_g_s * (1 - 1e-6))).all()
    assert np.abs(got[:, 1] - second).max() <= 0.15


def test_every_mixture_of_three_powders_has_a_deliverable_one_near(materials, profile):
    """Of three speeds; what is set to a least flow keeps it when another powder is set."""
    third = replace(materials[0], name="IN625", speed_mm_s=12.0)
    mixed = (replace(materials[0], speed_mm_s=8.0), materials[1], third)
    hopper = profile.hopper[0].model_copy(update={"name": "C", "material": "IN625"})
    recipe = make_recipe(
        mixed, ProcessSettings(), profile.model_copy(update={"hopper": (*profile.hopper, hopper)}))
    wanted = np.array([(a, b, 50 - a - b) for a in range(51) for b in range(51 - a)]) / 50
    got = recipe.deliverable_mixtures(wanted)
    recipe.check_deliverable(got, "layer 1")
    assert got.sum(axis=1) == pytest.approx(np.ones(len(wanted)))
    least = recipe.min_flow_g_s / np.diag(recipe.flow_g_s(np.eye(3))) * 1.5  # at the least speed
    assert np.abs(got - wanted).max() <= least[[0, 2]].sum()
    fine = ((recipe.flow_g_s(wanted) >= recipe.min_flow_g_s) | (wanted == 0)).all(axis=1)
    assert got[fine] == pytest.approx(wanted[fine])


def test_mixtures_are_made_deliverable_each_for_itself(materials, profile):
    """A whole layer at once gives what its mixtures give alone, and least flows are met exactly."""
    third = replace(materials[0], name="IN625", speed_mm_s=13.0)
    hopper = profile.hopper[0].model_copy(
        update={"name": "C", "material": "IN625", "min_flow_g_min": 2.0})
    recipe = make_recipe(
        (replace(materials[0], speed_mm_s=6.0), materials[1], third), ProcessSettings(),
        profile.model_copy(update={"hopper": (*profile.hopper, hopper)}))
    wanted = np.random.default_rng(0).dirichlet([0.4, 0.4, 0.4], 200).round(2)
    wanted = wanted[wanted.sum(axis=1) > 0.5]
    got = recipe.deliverable_mixtures(wanted)
    alone = np.vstack([recipe.deliverable_mixtures(row[None]) for row in wanted])
    assert got == pytest.approx(alone, abs=1e-12)
    flow, least = recipe.flow_g_s(got), recipe.min_flow_g_s
    assert ((flow < 1e-12) | (flow > least * (1 - 1e-9))).all()
    at_least = np.abs(flow / least - 1) < 1e-9
    assert at_least.any(axis=1).sum() > 30  # of about 200; so the rule was put to work


def test_least_flows_that_leave_too_little_for_the_rest(materials, profile):
    """Each hopper's least is more than half of this thin layer: one powder goes."""
    recipe = make_recipe(materials, ProcessSettings(layer_height_mm=0.12), profile)
    least = recipe.min_flow_g_s / np.diag(recipe.flow_g_s(np.eye(2)))
    assert 0.5 < least[0] < 1
    got = recipe.deliverable_mixtures(mixes(0.42, 0.7))
    recipe.check_deliverable(got, "layer 1")


def test_too_much_for_a_hopper_says_what_to_do(materials, profile):
    fast = make_recipe(materials, ProcessSettings(layer_height_mm=4.0), profile)
    with pytest.raises(PlanError) as caught:
        fast.check_deliverable(mixes(0.0, 1.0), "layer 3")
    text = caught.value.render()
    assert "hopper B (WC-12Co)" in text
    assert "at most 60" in text
    assert "layer 3" in text
    assert "lower speed_mm_s" in text


def test_the_speed_a_hint_gives_is_one_the_hopper_can_follow(materials, profile):
    """As told in three digits, in both directions."""
    for height, share in ((4.0, 1.0), (3.7, 0.9), (0.03, 0.0), (0.031, 1.0)):
        process = ProcessSettings(layer_height_mm=height)
        with pytest.raises(PlanError) as caught:
            make_recipe(materials, process, profile).check_deliverable(mixes(share), "layer 1")
        said = re.search(r"speed_mm_s to at (?:most|least) ([\d.]+),", caught.value.hint)
        assert said, caught.value.hint
        reported = tuple(replace(m, speed_mm_s=float(said[1])) for m in materials)
        make_recipe(reported, process, profile).check_deliverable(mixes(share), "layer 1")


def test_too_little_of_a_pure_powder_says_what_to_do(materials, profile):
    slow = make_recipe(materials, ProcessSettings(layer_height_mm=0.03), profile)
    with pytest.raises(PlanError, match=r"at least 0\.8"):
        slow.check_deliverable(slow.deliverable_mixtures(mixes(0.0)), "layer 1")


def test_a_material_without_a_hopper(materials, profile):
    other = (materials[0], replace(materials[1], name="IN718"))
    with pytest.raises(PlanError, match="no hopper of 'bench cell' holds IN718") as caught:
        make_recipe(other, ProcessSettings(), profile)
    assert "A: 316L" in caught.value.where[0]


@pytest.mark.parametrize("height_mm", [0.73, 0.8, 0.88])
def test_fitted_layers_get_the_recipes_energy_for_their_volume(
        make_part, shapes, profile, height_mm):
    """Volume per second, power and flow stay; lower layers are deposited faster."""
    part = make_part(shapes["disc"], lambda p: 0.5)
    plain, fitted = recipe_of(part, profile, 0.8), recipe_of(part, profile, height_mm)
    mixture = np.array([0.4, 0.6])
    assert fitted.flow_g_s(mixture) == pytest.approx(plain.flow_g_s(mixture))
    assert fitted.power(mixture) == plain.power(mixture)
    assert fitted.speed(mixture) * height_mm == pytest.approx(plain.speed(mixture) * 0.8)
