"""A hopper stepped over a scale, over the wires; and what may be wrong with the scale."""

from __future__ import annotations

import asyncio
import itertools
from dataclasses import replace

import pytest

from firmware_protocol.catch_scale import FULL_BLOCK, ScaleStatusBits
from firmware_protocol.pmx import FeederStateCode
from firmware_protocol.registers import WordOrder
from lmctl.config.measuring import ScaleSettings
from lmctl.errors import ConfigError, MachineError
from lmctl.machine.measuring.scale_lag import measure_scale_lag
from lmctl.machine.measuring.step_plan import plan_steps
from lmctl.machine.scale.driver import CatchScaleDriver
from simulators.feeder.config import FeederConfig
from simulators.modbus_errors import ExceptionReplyError, RequestIgnoredError
from simulators.modbus_server import serve_tcp
from simulators.scale.config import ScaleConfig
from simulators.scale.device import SimulatedCatchScale
from simulators.virtual_time import run_in_virtual_time
from tests.machine.feeder_cell import simulated
from tests.machine.measuring_cell import HOPPER, TRUTH, Hands, measuring_cell


def run(act, *args, **settings):
    async def whole():
        async with measuring_cell(*args, **settings) as cell:
            return await act(cell)

    return run_in_virtual_time(whole())


def refused(act, *args, **settings) -> str:
    with pytest.raises(MachineError) as caught:
        run(act, *args, **settings)
    return caught.value.render()


def test_the_truth_is_within_the_intervals_and_powder_is_off_after_the_test() -> None:
    async def act(cell):
        result = await cell.test().run()
        return result, cell.device.state(cell.device.advance_to_now()), cell.notices

    result, state, notices = run(act)
    fit = result.response.one_lag
    for found, truth in ((fit.dead_time_s, TRUTH.dead_time_s), (fit.lag_s, TRUTH.lag_s),
                         (fit.slope, 1.04), (fit.offset_g_min, 0.0)):
        assert abs(found.value - truth) < 1.5 * found.half_width
    assert result.is_precise
    assert result.more_s == 0
    assert result.doubts == ()
    assert state in (FeederStateCode.NOT_READY, FeederStateCode.READY)
    assert 1 <= len(notices) <= 3


def test_a_test_that_is_too_short_says_how_long_to_go_on() -> None:
    async def act(cell):
        return await cell.test(limit_s=110.0).run()

    result = run(act, noise_rsd=0.1)
    assert not result.is_precise
    assert result.more_s > 30.0


def test_the_scales_own_lag_comes_from_the_weight() -> None:
    async def act(cell):
        return await measure_scale_lag(cell.scale, Hands(cell.pan), 100.0)

    lag_s = run(act, ScaleConfig(lag_s=0.45))
    low, high = lag_s.interval
    assert low <= 0.45 <= high
    assert high - low < 0.05


def test_a_wrong_weight_and_none_are_reported() -> None:
    async def wrong(cell):
        await measure_scale_lag(cell.scale, Hands(cell.pan, 95.0), 100.0)

    async def nobody(cell):
        hands = Hands(cell.pan)
        hands.late_s = 1e6
        await measure_scale_lag(cell.scale, hands, 100.0)

    async def heavy(cell):
        await measure_scale_lag(cell.scale, Hands(cell.pan), 5000.0)

    async def left_on(cell):
        hands = Hands(cell.pan)
        hands.take_off_weight = hands.put_on_weight  # the wrong way round
        await measure_scale_lag(cell.scale, hands, 100.0)

    assert "the weight is still on it" in refused(left_on)
    assert "95.00 g for the weight of 100 g" in refused(wrong)
    assert "no weight of 100 g came" in refused(nobody)
    assert "too much" in refused(heavy)


async def whole_test(cell) -> None:
    await cell.test(limit_s=120.0).run()


def after(seconds: float, what) -> object:
    """A test during which something happens to the scale or feeder."""
    async def act(cell):
        timer = asyncio.get_running_loop().call_later(seconds, what, cell)
        try:
            await whole_test(cell)
        finally:
            timer.cancel()

    return act


def spoilt(pan: SimulatedCatchScale, row: str, value: int) -> None:
    """From now on a register of the scale holds a value of its own."""
    words = pan._words

    def forged() -> list[int]:
        return FULL_BLOCK.encode(FULL_BLOCK.decode(words()) | {row: value})

    pan._words = forged


def not_tared(cell) -> None:
    def refuse(address, words):
        raise ExceptionReplyError(4)

    cell.pan.write = refuse


def shaken_by_the_tare(cell) -> None:
    tare = cell.pan.write

    def then_shake(address, words):
        tare(address, words)
        spoilt(cell.pan, "STATUS", int(ScaleStatusBits.SELF_TEST_OK))

    cell.pan.write = then_shake


def drifts_when_powder_stops(cell) -> None:
    stop = cell.device._stop_discs

    def then_drift(time_s):
        if cell.device.discs_on:
            cell.pan.config = replace(cell.pan.config, drift_g_min=5.0)
        stop(time_s)

    cell.device._stop_discs = then_drift


def answers_every_fifth_time(cell) -> None:
    asked, words = itertools.count(), cell.pan._words

    def mostly_lost() -> list[int]:
        if next(asked) % 4:
            raise RequestIgnoredError
        return words()

    cell.pan._words = mostly_lost


def no_gas(cell) -> None:
    cell.device.is_gas_ok = lambda _: False


@pytest.mark.parametrize(("words", "act", "config"), [
    ("its self-test failed", after(1.0, lambda cell: spoilt(cell.pan, "STATUS", 0)), ScaleConfig()),
    ("it is overloaded", whole_test, ScaleConfig(capacity_g=100.0)),
    ("does not come to rest before the tare", whole_test, ScaleConfig(noise_g=1.0)),
    ("does not come to rest after the tare", after(0.5, shaken_by_the_tare), ScaleConfig()),
    ("it does not tare: it cannot", after(0.5, not_tared), ScaleConfig()),
    ("drifts by", after(0.5, drifts_when_powder_stops), ScaleConfig()),
    ("too few readings before the test", after(0.5, answers_every_fifth_time), ScaleConfig()),
    ("carrier gas has stopped", after(50.0, no_gas), ScaleConfig()),
    ("drifts by", whole_test, ScaleConfig(drift_g_min=0.5)),
    ("shows 120.0 g", whole_test, ScaleConfig(tare_works=False)),
    ("it holds 5 g", whole_test, ScaleConfig(capacity_g=5.0, pan_g=0.0)),
    ("has stood at", after(60.0, lambda cell: cell.pan.set_stuck()), ScaleConfig()),
    ("it is full", after(50.0, lambda cell: cell.pan.put_on(3000.0)), ScaleConfig()),
    ("jumped by", after(60.05, lambda cell: cell.pan.bump(2.0)), ScaleConfig()),
    ("gives no readings", after(50.0, lambda cell: cell.pan.set_silent()), ScaleConfig()),
])
def test_what_is_wrong_with_a_scale_is_named(words: str, act, config: ScaleConfig) -> None:
    told = refused(act, config)
    assert words in told
    assert "hint: " in told


def test_no_powder_on_the_scale_is_named() -> None:
    assert "no powder arrives" in refused(whole_test, carries_powder=False)


def test_gas_that_stops_ends_the_test() -> None:
    def gas_off(cell) -> None:
        cell.device.raise_alarm(201)

    told = refused(after(50.0, gas_off))
    assert "feeder F1" in told


def test_a_slope_that_runs_away_is_not_settled() -> None:
    async def act(cell):
        return await cell.test(limit_s=150.0).run()

    doubts = run(act, slope_drift_per_h=4.0, noise_rsd=0.01).doubts
    assert any("does not settle" in doubt for doubt in doubts)


def test_a_hopper_without_range_is_refused_before_anything_moves() -> None:
    with pytest.raises(ConfigError, match="1:8"):
        plan_steps(HOPPER.model_copy(update={"min_flow_g_min": 5.0}))
    with pytest.raises(ConfigError, match="too short"):
        plan_steps(HOPPER, 60.0)


def test_another_device_and_another_word_order_are_no_scale() -> None:
    async def other() -> None:
        async with simulated(FeederConfig("F1", (TRUTH,))) as (_, server):
            await CatchScaleDriver.open(ScaleSettings(endpoint=server.endpoint))

    async def swapped() -> None:
        pan = SimulatedCatchScale(ScaleConfig(word_order=WordOrder.CDAB),
                                  asyncio.get_running_loop().time, lambda at: 0.0 * at)
        server = await serve_tcp(pan)
        try:
            await asyncio.sleep(5.0)
            await CatchScaleDriver.open(ScaleSettings(endpoint=server.endpoint))
        finally:
            await server.close()

    async def other_map() -> None:
        async with measuring_cell() as cell:
            spoilt(cell.pan, "MAP_VERSION", 9 << 8)
            await CatchScaleDriver.open(cell.scale._settings)

    async def silent() -> None:
        async with measuring_cell() as cell:
            cell.pan.set_silent()
            await CatchScaleDriver.open(cell.scale._settings)

    async def absent() -> None:
        await CatchScaleDriver.open(ScaleSettings(endpoint="modbus-tcp://127.0.0.1:1"))

    for opening, told in ((other_map, "map 9.0; map 1 is known"), (absent, "catch scale: "),
                          (silent, "catch scale: it does not answer")):
        with pytest.raises(MachineError) as caught:
            run_in_virtual_time(opening())
        assert told in caught.value.render()
        assert caught.value.hint
    with pytest.raises(MachineError, match="no CSC scale"):
        run_in_virtual_time(other())
    with pytest.raises(MachineError, match="word order"):
        run_in_virtual_time(swapped())


def test_a_hopper_that_runs_empty_ends_the_test() -> None:
    assert "empty" in refused(whole_test, fill_g=8.0)
