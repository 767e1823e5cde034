"""A slope that drifts, seen through the device that brings it up to date."""

from dataclasses import replace

import numpy as np
import pytest

from firmware_protocol.pmx import FeederCommandBits
from simulators.feeder.config import FeederConfig, HopperConfig
from simulators.feeder.device import PmxFeederDevice

STEADY = HopperConfig(
    channel=1, material="316L", density_g_mm3=0.008, catch_efficiency=0.75, dead_time_s=3.0,
    lag_s=1.0, feed_factor_g_rev=2.0, n_min_rpm=0.0, n_max_rpm=30.0, fill_g=1e5,
)
FEED = FeederCommandBits.ENABLE_REMOTE | FeederCommandBits.GAS_ON | FeederCommandBits.FEED_ON


def fed_for(hopper: HopperConfig, seconds: float, step_s: float) -> PmxFeederDevice:
    """12 g/min for so long, the device asked every step_s."""
    clock = {"s": 0.0}
    device = PmxFeederDevice(FeederConfig("F", (hopper,), preflow_s=0.0), lambda: clock["s"])
    device.write(0, [int(FeederCommandBits.ENABLE_REMOTE), 1, 60_000, 1, 0, 0])
    device.write(10, [1])
    device.write(20, [0, 400, 0, 1200])
    device.write(6, [1])
    device.write(0, [int(FEED), 2])
    for number, at_s in enumerate(np.arange(step_s, seconds + step_s / 2, step_s), start=3):
        clock["s"] = float(at_s)
        device.write(1, [number & 0xFFFF])
    return device


def test_two_percent_an_hour():
    device = fed_for(replace(STEADY, slope_drift_per_h=0.02), 3600.0, 30.0)
    process = device.hoppers[1].process
    assert process.nozzle_flow_g_s(np.array([600.0, 3600.0])) * 60 == pytest.approx(
        [12.0 * (1 + 0.02 / 6), 12.0 * 1.02], abs=0.001)
    assert device.hoppers[1].process.disc_rpm(3600.0) == pytest.approx(6.0)


def test_the_drift_does_not_depend_on_how_often_the_device_is_asked():
    drifting = replace(STEADY, slope_drift_per_h=0.3, slope_change_to_empty=-0.3, fill_g=2000.0)
    seldom, often = (fed_for(drifting, 1800.0, step_s) for step_s in (45.0, 3.0))
    times = np.linspace(0.0, 1800.0, 300)
    assert seldom.hoppers[1].process.nozzle_flow_g_s(times) == pytest.approx(
        often.hoppers[1].process.nozzle_flow_g_s(times), rel=1e-12)


def test_the_reference_of_the_safety_checks_does_not_drift():
    device = fed_for(replace(STEADY, slope_drift_per_h=0.3), 1800.0, 30.0)
    flow = device.hoppers[1].fault_free_process.nozzle_flow_g_s(np.array([1800.0]))
    assert 60 * flow == pytest.approx([12.0])
