"""Powder fed, integrated from orders and from what feeders report of their discs."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.pmx import HopperStatusBits
from lmctl.machine.feeder.readings import HopperReading
from lmctl.run.powder.fed import FedPowder


def reading(time_s, flow_g_min, *, weight_g=None, flags=HopperStatusBits.PRESENT):
    return HopperReading(time_s, flags, flow_g_min, flow_g_min, None, weight_g, None, None)


def test_orders_give_the_amount_where_discs_follow_them():
    fed = FedPowder(["A", "B"], 0.0)
    fed.set_flows(1.0, (6.0, 12.0))
    fed.on_readings(4.0, (reading(4.0, 6.0), reading(4.0, 12.0)))
    fed.set_flows(11.0, (0.0, 12.0))
    assert fed.fed_g(0.5) == (0.0, 0.0)
    assert fed.fed_g(31.0) == pytest.approx((1.0, 6.0))


def test_a_slow_disc_counts_as_slow_from_its_report_on():
    fed = FedPowder(["A"], 0.0)
    fed.set_flows(0.0, (6.0,))
    fed.on_readings(10.0, (reading(10.0, 4.5),))
    assert fed.fed_g(20.0) == pytest.approx((1.0 + 0.75,))
    fed.on_readings(20.0, (reading(20.0, 6.0),))
    assert fed.fed_g(30.0) == pytest.approx((1.0 + 0.75 + 1.0,))


def test_a_disc_on_its_way_to_a_new_order_is_not_taken_for_a_slow_one():
    fed = FedPowder(["A"], 0.0)
    fed.set_flows(0.0, (6.0,))
    fed.set_flows(10.0, (12.0,))
    fed.on_readings(10.3, (reading(10.3, 9.0),))
    assert fed.fed_g(70.0) == pytest.approx((1.0 + 12.0,))


def test_what_is_taken_and_what_is_left_are_all_that_was_fed():
    fed = FedPowder(["A"], 0.0)
    fed.set_flows(0.0, (60.0,))
    assert fed.take_fed_g(2.0, 5.0) == pytest.approx({"A": 3.0})
    assert fed.take_remaining_fed_g(6.0) == pytest.approx({"A": 3.0})
    assert fed.take_remaining_fed_g(6.0) == pytest.approx({"A": 0.0})


def test_scales_are_read_forward_by_what_was_fed_since():
    fed = FedPowder(["A"], 0.0)
    fed.set_flows(0.0, (60.0,))
    fed.on_readings(2.0, (reading(2.0, 60.0, weight_g=100.0),))
    assert fed.weight_g(5.0) == pytest.approx({"A": 97.0})
    fed.on_readings(6.0, (reading(6.0, 60.0, weight_g=5000.0, flags=HopperStatusBits.REFILLING),))
    assert fed.weight_g(6.0) == {}  # it does not weigh while it is refilled


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.floats(0.05, 2.0), st.floats(0.0, 60.0)), min_size=1, max_size=30))
def test_any_row_of_orders_adds_up_however_it_is_asked_for(orders):
    fed = FedPowder(["A"], 0.0)
    t, true_g, flow = 0.0, 0.0, 0.0
    for lasting_s, new_flow in orders:
        true_g += flow / 60.0 * lasting_s
        t += lasting_s
        fed.set_flows(t, (new_flow,))
        assert fed.fed_g(t)[0] == pytest.approx(true_g)
        halfway = fed.fed_g(t - lasting_s / 2)[0]
        assert halfway == pytest.approx(true_g - flow / 60.0 * lasting_s / 2)
        flow = new_flow
