"""Ten rings, r = 1 … 10 mm, mixture in steps of 0.1, 10 mm/s, 1 s of travel between them.

Source: docs/explanation/powder-delivery.md, Ten rings.

θ = 3 s, τ = 1 s for both hoppers. An annulus from 0.5 to 10.5 mm is ten such rings exactly.
"""

import numpy as np
import pytest

from lmctl.config.part_file import ProcessSettings
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind
from lmctl.plan.planner import plan_job


@pytest.fixture
def rings(tmp_path, make_part, profile):
    hoppers = tuple(
        hopper.model_copy(update={"dead_time_s": 3.0, "lag_s": 1.0, "min_flow_g_min": 0.0})
        for hopper in profile.hopper)
    even = profile.model_copy(update={"hopper": hoppers})
    turn = np.linspace(0, 2 * np.pi, 1441)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    circle[-1] = circle[0]

    def plan(mode, lowest):
        part = make_part(
            [10.5 * circle, 0.5 * circle[::-1]],
            lambda p: lowest + 0.1 * (np.round(np.hypot(p[:, 0], p[:, 1])) - 1),
            height_mm=0.8, pitch_mm=0.125,
            process=ProcessSettings(bead_width_mm=1.0, overlap=0.0, lead_in_mm=0.0,
                                    travel_speed_mm_s=1.0,
                                    powder=mode, dwell_s=30.0))
        manifest = plan_job(part, even, tmp_path / "rings.lmj")
        with JobReader(tmp_path / "rings.lmj") as job:
            lines = job.read_layer(0).lines
        bead = np.flatnonzero(lines["kind"] == LineKind.BEAD)
        lasting = lines["end_s"][bead[-1]] - lines["end_s"][bead[0] - 1]
        return manifest.totals, lasting, lines

    return plan


def test_they_are_ten_rings_a_millimetre_apart(rings):
    _, lasting, lines = rings("none", 0.05)
    bead = lines["kind"] == LineKind.BEAD
    radius = np.hypot(lines["x_mm"] - 150, lines["y_mm"] - 150)[bead]
    by_path = [radius[lines["path"][bead] == path].mean() for path in range(10)]
    assert sorted(by_path) == pytest.approx(np.arange(1, 11), abs=0.02)
    assert lasting == pytest.approx(2 * np.pi * 55 / 10 + 9, rel=0.02)


@pytest.mark.parametrize("lowest", [0.0, 0.05, 0.1])
def test_led_powder_arrives_on_time_at_unchanged_layer_time(rings, lowest):
    totals, lasting, _ = rings("lead", lowest)
    assert totals["mixture_share"] >= 0.99
    assert lasting == pytest.approx(43.6, rel=0.01)


def test_without_compensation_a_third_of_it_is_right(rings):
    totals, lasting, _ = rings("none", 0.1)
    # 0.31 where set-points change at once; they do at the next tick of 0.1 s, nine times
    assert totals["mixture_share"] == pytest.approx(0.31 - 9 * 0.05 / 43.6, abs=0.005)
    assert totals["mixture_worst"] == pytest.approx(0.18, abs=0.005)
    assert lasting == pytest.approx(43.6, rel=0.01)


def test_waiting_gets_there_in_seven_times_the_time(rings):
    totals, lasting, _ = rings("dwell", 0.1)
    assert totals["mixture_share"] >= 0.99
    assert lasting == pytest.approx(313.6, rel=0.01)
