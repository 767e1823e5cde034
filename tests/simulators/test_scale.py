"""The simulated catch scale: mass through its lag and display, stamps, tare, and its faults."""

from __future__ import annotations

import asyncio
import math

import numpy as np
import pytest

from firmware_protocol.catch_scale import CSC_MAP, FULL_BLOCK, TARE_KEY, ScaleStatusBits
from simulators.modbus_errors import ExceptionReplyError, RequestIgnoredError
from simulators.scale.config import ScaleConfig
from simulators.scale.device import SimulatedCatchScale


class Pan:
    """A scale, its clock, and an even flow onto it."""

    def __init__(self, flow_g_s: float = 0.0, **settings) -> None:
        self.t, self.flow_g_s = 50.0, flow_g_s
        self.scale = SimulatedCatchScale(
            ScaleConfig(**settings), lambda: self.t, lambda at: np.full(len(at), self.flow_g_s))

    def read(self, after_s: float = 0.0) -> dict:
        self.t += after_s
        return FULL_BLOCK.decode(self.scale.read_input(0, FULL_BLOCK.count))

    def tare(self) -> None:
        self.scale.write(CSC_MAP.wire_address("TARE"), [TARE_KEY])

    def status(self) -> ScaleStatusBits:
        return ScaleStatusBits(self.read()["STATUS"])


def test_a_weight_comes_through_the_lag_to_the_step_of_the_display() -> None:
    pan = Pan(lag_s=0.5, pan_g=0.0, cycle_s=0.1)
    pan.scale.put_on(100.0)
    for after_s in (0.5, 1.0, 1.5):
        shown = pan.read(0.5)["MASS"]
        assert shown == pytest.approx(100.0 * -math.expm1(-after_s / 0.5), abs=0.0051)
    assert pan.read(10.0)["MASS"] == 100.0


@pytest.mark.parametrize("every_s", [0.03, 0.1, 0.2, 0.7])
def test_an_even_flow_lags_by_the_lag_however_often_it_is_read(every_s: float) -> None:
    pan = Pan(flow_g_s=0.175, lag_s=0.3, pan_g=0.0)
    for _ in range(int(20 / every_s)):
        seen = pan.read(every_s)
        since_s = seen["STAMP"] / 1000.0 - 50.0
        if since_s > 3.0:
            assert seen["MASS"] == pytest.approx(0.175 * (since_s - 0.3), abs=0.0051)
        assert 0 <= seen["NOW"] - seen["STAMP"] <= 101


def test_tare_makes_the_load_zero_and_is_counted() -> None:
    pan = Pan(pan_g=120.0)
    assert pan.read(5.0)["MASS"] == 120.0
    assert ScaleStatusBits.TARED not in pan.status()
    pan.tare()
    assert pan.read()["MASS"] == 0.0
    assert pan.read()["TARE_COUNT"] == 1
    assert ScaleStatusBits.TARED in pan.status()
    stubborn = Pan(pan_g=120.0, tare_works=False)
    stubborn.read(5.0)
    stubborn.tare()
    assert (stubborn.read()["MASS"], stubborn.read()["TARE_COUNT"]) == (120.0, 0)


def test_stable_means_that_the_display_stands() -> None:
    pan = Pan(pan_g=0.0)
    pan.read(3.0)
    assert ScaleStatusBits.STABLE in pan.status()
    pan.scale.put_on(50.0)
    pan.read(0.3)
    assert ScaleStatusBits.STABLE not in pan.status()
    pan.read(6.0)
    assert ScaleStatusBits.STABLE in pan.status()


def test_it_saturates_drifts_sticks_and_is_bumped() -> None:
    full = Pan(flow_g_s=1.0, capacity_g=130.0, pan_g=120.0)
    assert full.read(30.0)["MASS"] == 130.0
    assert ScaleStatusBits.OVERLOAD in full.status()
    drifting = Pan(pan_g=0.0, drift_g_min=0.6)
    assert drifting.read(60.0)["MASS"] == pytest.approx(0.6, abs=0.01)
    stuck = Pan(flow_g_s=0.2, pan_g=0.0)
    stood_g = stuck.read(5.0)["MASS"]
    stuck.scale.set_stuck()
    after = stuck.read(5.0)
    assert after["MASS"] == stood_g
    assert after["STAMP"] == 60_000
    bumped = Pan(pan_g=0.0)
    bumped.read(2.0)
    bumped.scale.bump(3.0)
    assert bumped.read(0.2)["MASS"] == pytest.approx(3.0, abs=0.01)


def test_it_refuses_what_it_does_not_have_and_may_fall_silent() -> None:
    pan = Pan()
    for act in (lambda: pan.scale.read_input(0, 30), lambda: pan.scale.write(1, [0]),
                lambda: pan.scale.write(0, [5])):
        with pytest.raises(ExceptionReplyError):
            act()
    pan.scale.set_silent()
    with pytest.raises(RequestIgnoredError):
        pan.read()


def test_a_scale_at_a_place_catches_powder_only_from_above_it() -> None:
    """The nozzle is at rest at x 0, y 0: 5 mm from the scale."""
    from dataclasses import replace

    near, far = (bench_caught_g_s(replace(ScaleConfig(), x_mm=3.0, y_mm=4.0, reach_mm=reach_mm))
                 for reach_mm in (5.5, 4.5))
    everywhere = bench_caught_g_s(ScaleConfig())
    assert near == everywhere > 0.05
    assert far == 0.0


def bench_caught_g_s(scale: ScaleConfig) -> float:
    """What falls onto the scale of the shipped bench while hopper A runs at 4 g/min."""
    from dataclasses import replace
    from importlib.resources import files

    from simulators.bench import Bench
    from simulators.bench_config import BenchConfig
    from simulators.virtual_time import run_in_virtual_time

    config = BenchConfig.parse((files("lmctl.examples") / "bench.toml").read_text())

    async def main() -> float:
        async with Bench(replace(config, scale=scale), ephemeral_ports=True) as bench:
            process = bench.feeders["F1"].hoppers[1].process
            process.command_rpm(0.0, 1.6)
            await asyncio.sleep(60.0)
            shown = FULL_BLOCK.decode(bench.scale.read_input(0, FULL_BLOCK.count))
            return (shown["MASS"] - scale.pan_g) / 60.0

    return run_in_virtual_time(main())
