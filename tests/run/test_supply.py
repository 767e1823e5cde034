"""How long a hopper's powder lasts by the program: against a plain sum over its flow."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmctl.machine.feeder.readings import HopperReading
from lmctl.run.powder.supply import REFILL_NOTICE_S, SupplyForecast, usable_powder_g

flows = st.lists(st.floats(0.0, 1.0), min_size=2, max_size=6)


def forecast_of(layers):
    """One hopper; each layer 60 s long with its flow at even knots [g/s]."""
    made = [
        SimpleNamespace(
            index=index, flow_s=np.linspace(60.0 * index, 60.0 * (index + 1), len(flow)),
            flow_g_s=np.array(flow)[:, None])
        for index, flow in enumerate(layers)
    ]
    manifest = SimpleNamespace(layers=[
        SimpleNamespace(start_s=60.0 * index, end_s=60.0 * (index + 1))
        for index in range(len(layers))
    ])
    return SupplyForecast(manifest, made.__getitem__, ["A"]), made


@settings(max_examples=50, deadline=None)
@given(layers=st.lists(flows, min_size=1, max_size=5), start=st.floats(0.0, 1.0),
       left_g=st.floats(0.1, 100.0))
def test_powder_lasts_until_the_flow_has_used_it_up(layers, start, left_g):
    forecast, made = forecast_of(layers)
    s = 60.0 * start
    for _ in layers:
        forecast.read_ahead(s)
    until_s = forecast.lasts_until_s(0, s, left_g)
    times = np.concatenate([layer.flow_s for layer in made])
    flow = np.concatenate([layer.flow_g_s[:, 0] for layer in made])
    grid = np.linspace(s, times[-1], 20_001)
    used_g = np.concatenate([[0.0], np.cumsum(np.diff(grid) * np.interp(
        (grid[1:] + grid[:-1]) / 2.0, times, flow))])
    if until_s is None:
        assert used_g[-1] <= left_g + 0.2
    else:
        assert np.interp(until_s, grid, used_g) == pytest.approx(left_g, abs=0.2 + 0.02 * left_g)


def test_one_layer_is_read_at_a_time_and_none_far_ahead_or_behind():
    forecast, _ = forecast_of([[1.0, 1.0]] * 60)
    for _ in range(100):
        forecast.read_ahead(0.0)
    assert len(forecast._needs) == pytest.approx(1.2 * REFILL_NOTICE_S / 60.0, abs=1)
    forecast.read_ahead(600.0)
    assert forecast._needs[0].layer == 10
    assert forecast.lasts_until_s(0, 600.0, 90.0) == pytest.approx(690.0)
    assert forecast.lasts_until_s(0, 600.0, 9e9) is None
    assert forecast.layer_at(690.0) == 12


@pytest.mark.parametrize(("weight_g", "percent", "usable"), [
    (None, 50.0, None), (1000.0, 50.0, 900.0), (60.0, 3.0, 0.0), (100.0, None, 95.0),
    (100.0, 0.0, 95.0),
])
def test_a_reserve_of_a_full_hopper_is_not_counted_on(weight_g, percent, usable):
    reading = HopperReading(0.0, None, 0.0, 0.0, 0.0, weight_g, percent, 4.0)
    assert usable_powder_g(reading) == (None if usable is None else pytest.approx(usable))
