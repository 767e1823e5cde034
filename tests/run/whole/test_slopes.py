"""A hopper whose slope is not what it was, in a whole run: seen by its weight, told, corrected."""

from __future__ import annotations

import numpy as np
import pytest

from lmctl.config.measuring import FeederCorrectionSettings

#: Hopper A feeds 6 % more than its profile says.
STEEPER = (("slope_factor = 1.0 ", "slope_factor = 1.06 "),)
STEADY = [(0.0, (0.15, 0.15)), (1e6, (0.15, 0.15))]


@pytest.fixture
def long_job(tmp_path, profile, job_file):
    """Some five minutes of squares at a steady flow of 9 g/min of each hopper."""
    layers = job_file.squares(layers=14, per_layer=3, side_mm=14.0)
    job_file(tmp_path / "long.lmj", profile, layers, flow=STEADY)
    return tmp_path / "long.lmj"


def corrected(profile):
    settings = FeederCorrectionSettings(window_s=60.0)
    return profile.model_copy(update={"feeder": tuple(
        feeder.model_copy(update={"correction": settings}) for feeder in profile.feeder)})


def test_a_deviation_is_reported_and_without_a_table_nothing_is_corrected(run, long_job) -> None:
    one = run(long_job, bench=STEEPER)
    slopes = one.records("slope")
    of_a = [record["slope"] for record in slopes if record["hopper"] == "A"]
    of_b = [record["slope"] for record in slopes if record["hopper"] == "B"]
    assert len(of_a) >= 1
    assert of_a == pytest.approx([1.06] * len(of_a), abs=0.01)
    assert of_b == pytest.approx([1.0] * len(of_b), abs=0.01)
    assert one.records("slope_correction") == []
    (warning,) = [r for r in one.records("warning") if r["number"] == 49]
    assert warning["hopper"] == "A"
    assert "+6" in warning["what"] or "+5.9" in warning["what"]
    assert "nothing corrects it" in warning["what"]


def test_a_correction_is_slow_journaled_and_reaches_the_nozzle(run, long_job, profile) -> None:
    one = run(long_job, bench=STEEPER, profile=corrected(profile))
    steps = [r for r in one.records("slope_correction") if r["hopper"] == "A"]
    assert len(steps) >= 3
    values = [steps[0]["before"], *(step["after"] for step in steps)]
    assert values[0] == 1.0
    assert np.all(np.diff(values) > 0)
    assert np.diff(values).max() < 0.008
    assert all("loss in weight" in step["reason"] for step in steps)
    steel = one.path.materials.index("316L")
    flow = one.path.flow_g_s[:, steel]
    first, last = flow[:500].mean(), flow[-500:].mean()
    assert first == pytest.approx(1.06 * 0.15, rel=0.005)
    assert last == pytest.approx(1.06 * 0.15 / values[-1], rel=0.008)


def test_nothing_is_measured_below_the_level_where_weight_is_relied_on(run, long_job) -> None:
    small = ("fill_g = 20000\nslope_factor", "fill_g = 50\nslope_factor")
    one = run(long_job, bench=[*STEEPER, small])
    of_a = [record["t"] for record in one.records("slope") if record["hopper"] == "A"]
    of_b = [record["t"] for record in one.records("slope") if record["hopper"] == "B"]
    assert 1 <= len(of_a) < len(of_b)
    assert of_a[-1] < of_b[-1] - 30.0
