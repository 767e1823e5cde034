"""Process values of layers from samples: truths that can be worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lmctl.report.reported_values import PartScales, ReportedValueGatherer
from lmctl.report.value_range import range_of

HEADER = {"kind": "header", "hoppers": [
    {"name": "A", "material": "steel", "dead_time_s": 3.0, "lag_s": 1.0},
    {"name": "B", "material": "carbide", "dead_time_s": 1.0, "lag_s": 0.0},
]}
SCALES = PartScales(2.0, ("steel", "carbide"), {"steel": 100.0, "carbide": 50.0})


def samples(at, flows, *, beam=100.0, line=0, gas=None):
    n = len(at)
    return {
        "kind": "samples", "at": list(at), "line": [line] * n, "feed_mm_min": [600.0] * n,
        "s_word": [beam] * n, "flow_g_min": {name: list(flow) for name, flow in flows.items()},
        **({} if gas is None else {"carrier_L_min": {"A": [gas] * n, "B": [None] * n}}),
    }


def order(t, **flows):
    return {"kind": "setpoint", "t": t, "flow_g_min": flows}


def gathered(*records, scales=SCALES):
    gatherer = ReportedValueGatherer(scales)
    for record in (HEADER, {"kind": "layer_opened", "layer": 0, "lines": [0, 9]}, *records):
        gatherer.take(record)
    return gatherer.values()


def test_steady_flows_give_the_mixture_by_volume_deposited():
    at = np.arange(0.2, 60.0, 0.2)
    values = gathered(
        order(0.0, A=6.0, B=4.0),
        samples(at[:100], {"A": [6.0] * 100, "B": [4.0] * 100}, beam=0.0),
        samples(at[100:], {"A": [6.0] * 199, "B": [4.0] * 199}, gas=4.0))[0]
    steel = 6.0 * 100 / (6.0 * 100 + 4.0 * 50)
    for value in (values.fractions["steel"].least, values.fractions["steel"].greatest):
        assert value == pytest.approx(steel, abs=1e-6)
    assert values.speed_mm_s.mean == pytest.approx(10.0)
    assert values.power_W.mean == pytest.approx(200.0)
    assert set(values.carrier_L_min) == {"A"}
    assert values.shield_gas_L_min is None


def mixture_at(moment_s, *orders, reported):
    """The share of steel inferred at a moment from what is reported five times a second."""
    at = np.arange(0.2, moment_s + 1e-9, 0.2)
    dark = samples(at, {name: [flow(t) for t in at] for name, flow in reported.items()}, beam=0.0)
    dark["s_word"][-1] = 1.0
    found = gathered(*orders, dark, scales=PartScales(None, SCALES.materials, SCALES.deposit_mm3_g))
    assert found[0].power_W is None
    return found[0].fractions["steel"].mean


@pytest.mark.parametrize("moment_s", [14.0, 15.0, 20.0])
def test_a_step_arrives_after_the_dead_time_and_follows_the_lag(moment_s):
    """A feeder reports its disc seconds late: that delays nothing."""
    found = mixture_at(
        moment_s, order(0.0, A=0.0, B=8.0), order(10.03, A=12.0),
        reported={"A": lambda t: 12.0 if t > 13.8 else 0.0, "B": lambda t: 8.0})
    flow = 12.0 * (1.0 - math.exp(-(moment_s - 13.03)))
    assert found == pytest.approx(flow * 100 / (flow * 100 + 8.0 * 50), abs=1e-6)


def test_a_disc_that_does_not_follow_is_taken_as_it_reports():
    found = mixture_at(60.0, order(0.0, A=12.0, B=8.0),
                       reported={"A": lambda t: 12.0 if t < 20.0 else 3.0, "B": lambda t: 8.0})
    assert found == pytest.approx(3.0 * 100 / (3.0 * 100 + 8.0 * 50), abs=1e-6)


def test_layers_are_parted_by_the_lines_executed_and_holes_are_left_out():
    values = gathered(
        {"kind": "layer_opened", "layer": 1, "lines": [10, 19]},
        samples([0.2, 0.4], {"A": [1.0, 3.0], "B": [None, None]}, line=9),
        samples([0.6, 0.8], {"A": [5.0, 5.0], "B": [2.0, 2.0]}, line=10))
    assert values[0].flow_g_min["A"].mean == pytest.approx(2.0)
    assert "B" not in values[0].flow_g_min
    assert values[1].flow_g_min["B"].greatest == 2.0


def test_without_the_job_no_power_and_no_mixture_is_claimed():
    found = gathered(samples([0.2], {"A": [1.0], "B": [1.0]}), scales=PartScales())[0]
    assert (found.power_W, found.fractions) == (None, {})


def test_joined_ranges_are_those_of_all_samples():
    rng = np.random.default_rng(1)
    values, weights = rng.normal(size=50), rng.uniform(0.1, 2.0, 50)
    whole = range_of(values, weights)
    parts = range_of(values[:20], weights[:20]).joined_with(range_of(values[20:], weights[20:]))
    assert (parts.least, parts.greatest) == (whole.least, whole.greatest)
    assert parts.mean == pytest.approx(np.average(values, weights=weights))
    assert range_of(np.array([np.nan]), np.array([1.0])) is None
