"""Powders fed together are caught otherwise than alone: one coupon of a pair says by how much."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lmctl.config.mixture_catch import MixtureCatchSettings
from lmctl.config.part_file import ProcessSettings
from lmctl.errors import PlanError
from lmctl.plan.mixture_catch import MixtureCatch, mixture_catch
from lmctl.plan.planner import plan_job
from lmctl.plan.recipe import make_recipe

ALONE = np.array([0.75, 0.55])
PAIR = ("316L", "WC-12Co")


def coupon(share, efficiency, pair=PAIR):
    return MixtureCatchSettings(
        mass_shares=dict(zip(pair, (share, 1 - share), strict=True)), efficiency=efficiency)


def caught(model, share):
    flow = np.array([share, 1 - share])
    return float(model.efficiency(flow) @ flow)


def test_a_mixture_is_caught_as_its_coupon_says_and_powders_alone_as_ever():
    model = mixture_catch([coupon(0.4, 0.56)], PAIR, ALONE)
    assert caught(model, 0.4) == pytest.approx(0.56)
    assert model.efficiency(np.array([3.0, 0.0]))[0] == 0.75
    assert model.efficiency(np.array([0.0, 3.0]))[1] == 0.55


def test_the_bench_hides_the_same_law():
    """Truth as the simulated feeders have it: each powder changed by its share of the others."""
    for change in (-0.3, 0.2):
        def truth(share, change=change):
            other = np.array([1 - share, share])
            return float(np.array([share, 1 - share]) @ (ALONE * (1 + change * other)))

        model = mixture_catch([coupon(0.36, truth(0.36))], PAIR, ALONE)
        for share in (0.1, 0.5, 0.9):
            assert caught(model, share) == pytest.approx(truth(share))


def test_several_coupons_of_a_pair_are_weighed_and_other_powders_are_left_alone():
    alone = np.array([0.7, 0.6, 0.5])
    pairs = [coupon(0.5, 0.6, ("A", "B")), coupon(0.5, 0.64, ("A", "B")),
             coupon(0.5, 0.5, ("B", "D"))]
    model = mixture_catch(pairs, ("A", "B", "C"), alone)
    assert model.interaction[0, 1] == pytest.approx((0.62 - 0.65) / (0.25 * 1.3))
    assert model.interaction[1, 0] == model.interaction[0, 1]
    assert not model.interaction[2].any()
    assert mixture_catch(pairs[2:], ("A", "B", "C"), alone) is None


def test_flows_deposit_what_is_wanted():
    random = np.random.default_rng(2)
    change = np.array([[0, -0.4, 0.2], [-0.4, 0, 0.1], [0.2, 0.1, 0]])
    model = MixtureCatch(np.array([0.7, 0.6, 0.5]), change)
    wanted = random.dirichlet(np.ones(3), 50) * 0.1
    wanted[0] = [0.1, 0, 0]
    flow = model.flow_to_deposit(wanted)
    assert flow * model.efficiency(flow) == pytest.approx(wanted, rel=1e-8)


def test_a_catch_that_would_be_none_is_refused():
    with pytest.raises(PlanError, match="316L and WC-12Co"):
        mixture_catch([coupon(0.5, 0.2)], PAIR, ALONE)


@pytest.fixture
def paired(profile):
    return profile.model_copy(update={"mixture_catch": (coupon(0.36, 0.56),)})


def test_a_recipe_deposits_its_mixture_and_volume(paired, materials):
    recipe = make_recipe(materials, ProcessSettings(), paired)
    share = np.linspace(0, 1, 11)
    wanted = np.column_stack([1 - share, share])
    flow = recipe.flow_g_s(wanted)
    assert recipe.deposited_fractions(flow) == pytest.approx(wanted, abs=1e-9)
    volume = (flow * recipe.catch_at(flow) / recipe.density_g_mm3).sum(axis=1)
    assert volume == pytest.approx(
        recipe.pitch_mm * recipe.layer_height_mm * recipe.speed(wanted))


def test_mixtures_at_a_hoppers_least_flow_are_metered(paired, materials):
    recipe = make_recipe(materials, ProcessSettings(), paired)
    recipe = replace(recipe, min_flow_g_s=np.full(2, 2.0 / 60))
    share = np.linspace(0.005, 0.995, 100)
    found = recipe.deliverable_mixtures(np.column_stack([1 - share, share]))
    recipe.check_deliverable(found, "layer 1")  # raises where a hopper would meter less
    flow = recipe.flow_g_s(found)
    assert ((flow < 1e-12) | (flow >= recipe.min_flow_g_s * (1 - 1e-6))).all()


def test_powder_in_the_part_is_its_volume(tmp_path, make_part, shapes, paired, materials):
    totals = plan_job(make_part(shapes["rectangle"], lambda p: 0.2 + 0.02 * (p[:, 0] + 15)),
                      paired, tmp_path / "a.lmj").totals
    grams = totals["powder_in_part_g"]
    assert sum(grams[m.name] / m.density_g_mm3 for m in materials) == pytest.approx(
        30 * 17 * 1.6, rel=0.015)
    assert totals["mixture_share"] > 0.99
