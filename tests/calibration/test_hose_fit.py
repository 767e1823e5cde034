"""Hoppers pulsed in turn over one scale: hoses within their intervals, and the law of revision."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from lmctl.calibration.estimate import Estimate
from lmctl.calibration.hose_estimate import HoseEstimate, Revision, revised
from lmctl.calibration.hose_fit import HoseBelief, ScaleFacts, fit_hoses
from lmctl.config.machine import HopperSettings
from lmctl.errors import ConfigError
from lmctl.machine.measuring.purge_pulses import (
    plan_pulses,
    setpoint_histories,
    shortest_pulses_s,
)
from tests.calibration.synthetic_steps import STEP_S, lagged

BELIEVED = ((3.0, 1.0), (2.6, 0.8), (2.0, 0.5))
FACTS = ScaleFacts(Estimate(0.3, 0.004), 0.03, 1.0, 0.01)


def hoppers(count=2):
    return [HopperSettings(name=name, feeder="F", channel=at + 1, material="m", dead_time_s=dead_s,
                           lag_s=lag_s, min_flow_g_min=0.8, max_flow_g_min=60)
            for at, (name, (dead_s, lag_s)) in enumerate(zip("ABC", BELIEVED, strict=True))][:count]


def beliefs(count=2):
    return [HoseBelief(*believed, Estimate(1.0, 0.03)) for believed in BELIEVED[:count]]


def plan(count=2, within_s=100.0, wanted_s=0.05, facts=FACTS):
    return plan_pulses(hoppers(count), beliefs(count), facts, period_s=0.2, within_s=within_s,
                       wanted_half_s=wanted_s)


def weighed(pulses, truth, seed, *, rsd=0.03, slopes=(1.02, 0.97, 1.0)):
    """What a scale shows of these hoses, by Euler steps: times and masses."""
    random = np.random.default_rng(seed)
    time_s = np.arange(0.0, pulses.end_s, STEP_S)
    keep, flow = np.exp(-STEP_S / 1.0), np.zeros(len(time_s))
    histories = setpoint_histories(pulses.lows_g_min, pulses.changes)
    for (dead_time_s, lag_s), history, slope in zip(truth, histories, slopes, strict=False):
        at = np.searchsorted(history.time_s, time_s - dead_time_s + 1e-9, side="right") - 1
        own = lagged(slope * history.flow_g_min[np.maximum(at, 0)] / 60.0, lag_s)
        noise, _ = lfilter([np.sqrt(1 - keep**2)], [1.0, -keep],
                           random.standard_normal(len(time_s)),
                           zi=[keep * random.standard_normal()])
        flow += own * (1.0 + rsd * noise)
    mass = lagged(np.cumsum(flow) * STEP_S, 0.3)
    read = np.arange(int(pulses.weigh_from_s / STEP_S), len(time_s), 10)
    return histories, time_s[read] + STEP_S, np.round(mass[read], 2)


def changed(seed, count=2):
    """Hoses that are not as believed any more."""
    random = np.random.default_rng(100 + seed)
    return [(dead_s + random.uniform(-0.8, 0.8), lag_s * random.uniform(0.7, 1.3))
            for dead_s, lag_s in BELIEVED[:count]]


def test_hoses_that_changed_are_found_within_their_intervals():
    """Of 24 hoses behind one scale 95 in 100 are within; plain chance leaves three out of that."""
    pulses, inside, errors = plan(), 0, []
    for seed in range(12):
        truth = changed(seed)
        found = fit_hoses(*weighed(pulses, truth, seed), FACTS, beliefs())
        for hose, true in zip(found.hoses, truth, strict=True):
            errors.append(hose.response.value - sum(true))
            off = hose.values - true
            inside += float(off @ np.linalg.solve(hose.covariance_s2, off)) < 5.99
    assert inside >= 20
    assert np.sqrt(np.mean(np.square(errors))) < 0.035
    assert max(pulses.response_half_s) <= 0.05
    assert found.hoses[0].response.half_width == pytest.approx(pulses.response_half_s[0], rel=0.3)


def test_three_hoppers_are_told_apart_too():
    pulses, truth = plan(3), changed(5, 3)
    found = fit_hoses(*weighed(pulses, truth, 5), FACTS, beliefs(3))
    for hose, true in zip(found.hoses, truth, strict=True):
        assert hose.response.value == pytest.approx(sum(true), abs=0.08)


def test_more_noise_than_the_feeder_test_found_widens_the_intervals():
    pulses = plan()
    quiet, loud = (fit_hoses(*weighed(pulses, BELIEVED[:2], 3, rsd=rsd), FACTS, beliefs())
                   for rsd in (0.03, 0.12))
    assert quiet.more_noise < 1.6
    assert 2.5 < loud.more_noise < 6.0
    assert loud.hoses[0].response.half_width > 2.0 * quiet.hoses[0].response.half_width


def test_pulses_take_the_time_they_need_and_no_more_than_there_is():
    shortest_s = shortest_pulses_s(hoppers(), beliefs(), FACTS)
    assert plan(within_s=shortest_s - 0.1) is None
    short, wanted = plan(within_s=shortest_s), plan(within_s=300.0)
    assert len(short.changes) == 4
    assert short.end_s <= shortest_s
    assert max(wanted.response_half_s) <= 0.05 < max(short.response_half_s)
    finer = plan(within_s=300.0, wanted_s=0.03)
    assert finer.end_s > wanted.end_s
    assert max(finer.response_half_s) <= 0.03
    assert plan(within_s=60.0, wanted_s=1e-6).end_s <= 60.0


def test_edges_of_two_hoppers_arrive_one_after_the_other():
    arrivals = sorted(change.at_s + BELIEVED[change.hopper][0] for change in plan().changes)
    assert np.diff(arrivals).min() > 3.0 * (0.8 + 0.3) - 0.11
    assert all(change.at_s >= 0 for change in plan().changes)


def test_a_hopper_without_range_cannot_be_pulsed():
    narrow = [hoppers()[0].model_copy(update={"min_flow_g_min": 20.0})]
    with pytest.raises(ConfigError, match="1:8"):
        plan_pulses(narrow, beliefs(1), FACTS, period_s=0.2, within_s=100.0, wanted_half_s=0.05)


def hose(dead_time_s, lag_s=1.0, response_half_s=0.05):
    return HoseEstimate.of_half_widths(dead_time_s, lag_s, dead_time_half_s=2 * response_half_s,
                                       lag_half_s=2 * response_half_s,
                                       response_half_s=response_half_s)


def test_half_widths_are_kept():
    one = hose(3.0)
    assert one.dead_time.half_width == pytest.approx(0.1)
    assert one.lag.half_width == pytest.approx(0.1)
    assert one.response.half_width == pytest.approx(0.05)
    assert one.response.value == 4.0


def test_values_that_agree_are_joined_and_get_surer():
    revision, after = revised(hose(3.0), hose(3.04, 0.98))
    assert revision is Revision.AGREES
    assert 3.0 < after.dead_time_s < 3.04
    assert after.response.half_width == pytest.approx(0.05 / np.sqrt(2), rel=1e-6)
    _, mostly_old = revised(hose(3.0, response_half_s=0.01), hose(3.04))
    assert mostly_old.dead_time_s == pytest.approx(3.0, abs=0.005)


def test_a_sure_deviation_replaces_and_an_unsure_one_is_left_aside():
    revision, after = revised(hose(3.0), hose(3.5))
    assert (revision, after.dead_time_s) == (Revision.REPLACES, 3.5)
    wide = hose(3.5, response_half_s=0.25)
    revision, after = revised(hose(3.0, response_half_s=0.01), wide)
    assert (revision, after.dead_time_s) == (Revision.REFUSED, 3.0)


def test_values_that_were_typed_in_give_way_to_any_measurement():
    typed = HoseEstimate(3.0, 1.0)
    assert revised(typed, hose(3.02))[0] is Revision.AGREES
    revision, after = revised(typed, hose(3.5))
    assert (revision, after.dead_time_s) == (Revision.REPLACES, 3.5)
    with pytest.raises(ValueError, match="covariance"):
        revised(typed, typed)
