"""Mixtures with less of a powder than its hopper meters are laid faster before they are rounded."""

import numpy as np
import pytest

from lmctl.config.part_file import ProcessSettings
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind
from lmctl.plan.planner import plan_job
from lmctl.plan.sequence.weak_flow import MeteredMixtures, metered_levels
from tests.plan.conftest import rectangle

#: Of the carbide, at the recipe's speed: 0.8 g/min.
LEAST = 0.048


def metered(recipe, *second, fastest=1.6):
    wanted = np.stack([1 - np.array(second), np.array(second)], axis=1)
    return metered_levels(
        wanted, np.arange(len(second)), len(second), MeteredMixtures(recipe, fastest), "layer 1")


def test_what_can_be_metered_at_the_recipes_speed_is_deposited_at_it(recipe):
    levels, factor = metered(recipe, 0.0, LEAST * 1.01, 0.3, 0.8)
    assert levels[:, 1] == pytest.approx([0.0, LEAST * 1.01, 0.3, 0.8])
    assert factor.tolist() == [1, 1, 1, 1]


def test_a_scarce_powder_makes_its_track_just_fast_enough(recipe):
    levels, factor = metered(recipe, 0.033)
    assert levels[0, 1] == pytest.approx(0.033, abs=0.01)
    assert factor[0] == pytest.approx(1.2)  # 0.048 / 1.2 is 0.040, 0.048 / 1.1 is 0.0436
    flow = recipe.flow_g_s(levels) * factor[:, None]
    assert (flow[0] >= recipe.min_flow_g_s * (1 - 1e-9)).all()


def test_beam_power_bounds_the_speed(recipe):
    levels, factor = metered(recipe, 0.030, fastest=1.15)
    assert factor[0] <= 1.15
    assert levels[0, 1] == pytest.approx(LEAST / factor[0], rel=0.01)


def test_what_is_too_scarce_at_any_speed_is_rounded_to_the_nearer(recipe):
    levels, _ = metered(recipe, 0.001, 0.024)
    assert levels[0, 1] == 0
    assert levels[1, 1] == pytest.approx(LEAST / 1.5, rel=0.01)


def test_a_faster_bead_has_the_energy_and_the_powder_of_a_slower_one(tmp_path, make_part, profile):
    part = make_part([rectangle(20.0, 10.0)], lambda p: np.full(len(p), 0.03),
                     process=ProcessSettings(fraction_step=0.01))
    manifest = plan_job(part, profile, tmp_path / "a.lmj")
    assert manifest.totals["mixture_share"] > 0.999
    with JobReader(tmp_path / "a.lmj") as job:
        lines = next(iter(job.iterate_layers())).lines
    bead = lines[lines["kind"] == LineKind.BEAD]
    assert bead["speed_mm_s"].max() > 12
    strip_mm = bead["bead_width_mm"] * 0.667
    per_area = bead["power_W"] / (bead["speed_mm_s"] * strip_mm)
    plain = 1509 / (10 * 1.334)  # W s / mm² of the recipe
    assert np.percentile(per_area, [10, 90]) == pytest.approx([plain, plain], rel=0.02)
