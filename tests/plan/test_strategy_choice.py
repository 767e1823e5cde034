"""The strategy "auto" plans some layers in each way, takes the fastest good one, and says why."""

import numpy as np
import pytest

from lmctl.config.part_file import ProcessSettings
from lmctl.plan.planner import plan_job
from lmctl.plan.strategy_choice import StrategyTrial, choose_strategy, with_chosen_strategy
from tests.plan.conftest import circle, rectangle

AUTO = ProcessSettings(strategy="auto")


def along_x(points):
    return 0.45 + points[:, 0] / 34


def around_z(points):
    return 0.1 + np.hypot(points[:, 0], points[:, 1]) / 25


def test_a_part_graded_along_its_outline_gets_tracks_of_one_mixture(make_part, profile, tmp_path):
    part = make_part([rectangle(24.0, 12.0)], along_x, process=AUTO)
    choice = choose_strategy(part, profile)
    offset = choice.trials[0]
    assert offset.strategy == "offset"
    assert offset.right > 0.99
    assert offset.right_at_worst < 0.6
    assert choice.chosen.strategy == "iso-composition"
    assert choice.chosen.right_at_worst > 0.94
    assert choice.chosen.time_s < 2 * offset.time_s
    manifest = plan_job(part, profile, tmp_path / "a.lmj")
    assert manifest.totals["strategy"] == "iso-composition"
    said = next(f["text"] for f in manifest.verdict if f["text"].startswith("strategy"))
    assert "offset: 9" in said or "offset: 100" in said
    assert "starts" in said


def test_no_faster_way_is_as_good_as_the_one_chosen(make_part, profile):
    part = make_part([circle(14.0), circle(7.0, clockwise=True)], around_z, process=AUTO)
    choice = choose_strategy(part, profile)
    best = max(trial.right_at_worst for trial in choice.trials)
    assert choice.chosen.right_at_worst >= best - 0.03
    faster = [trial for trial in choice.trials if trial.time_s < choice.chosen.time_s - 1e-9]
    assert all(trial.right_at_worst < best - 0.03 for trial in faster)


def test_one_mixture_needs_no_trial(make_part, profile):
    class Plain(make_part):
        def uniform_mixture(self):
            return (1.0, 0.0)

    part = Plain([rectangle(20.0, 10.0)], lambda p: 0 * p[:, 0], process=AUTO)
    planned, choice = with_chosen_strategy(part, profile)
    assert planned.process.strategy == "offset"
    assert "one mixture" in choice.as_text()


def test_a_named_strategy_is_not_questioned(make_part, profile):
    part = make_part([rectangle(20.0, 10.0)], along_x)
    assert with_chosen_strategy(part, profile) == (part, None)


@pytest.mark.parametrize(("error_s", "waits"), [(0.0, False), (0.5, True)])
def test_waits_are_taken_only_where_dead_times_are_doubted(make_part, profile, error_s, waits):
    part = make_part([rectangle(24.0, 12.0)], along_x,
                     process=AUTO.model_copy(update={"dead_time_error_s": error_s}))
    chosen = choose_strategy(part, profile).chosen
    assert isinstance(chosen, StrategyTrial)
    assert (chosen.change_margin_s > 0) is waits
