"""The hopper against closed truths, and against a plain time-stepped model of the same physics."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulators.feeder import hose
from simulators.feeder.config import HopperConfig
from simulators.feeder.process import HopperProcess

PLAIN = HopperConfig(
    channel=1, material="316L", density_g_mm3=0.00799, catch_efficiency=0.75, dead_time_s=3.0,
    lag_s=1.0, feed_factor_g_rev=3.0, n_min_rpm=0.3, n_max_rpm=25.0, fill_g=20_000.0,
)


def flow(process: HopperProcess, *times: float) -> list[float]:
    return process.nozzle_flow_g_s(np.array(times)).tolist()


def test_a_step_reaches_the_nozzle_after_the_dead_time_and_settles_by_the_lag():
    hopper = HopperProcess(PLAIN)
    hopper.command_rpm(10.0, 4.0)
    full = 3.0 * 4.0 / 60
    assert flow(hopper, 9.0, 12.999, 13.0, 14.0, 16.91, 100.0) == pytest.approx(
        [0, 0, 0, full * (1 - math.exp(-1)), full * (1 - math.exp(-3.91)), full]
    )
    assert hopper.disc_rpm(10.0) == pytest.approx(4.0)


def test_without_lags_the_nozzle_repeats_the_disc_late():
    hopper = HopperProcess(replace(PLAIN, lag_s=0.0))
    hopper.command_rpm(0.0, 4.0)
    hopper.command_rpm(5.0, 2.0)
    assert flow(hopper, 2.9, 3.0, 7.9, 8.0) == pytest.approx([0.0, 0.2, 0.2, 0.1])


def test_a_lasting_ramp_is_followed_one_lag_behind():
    hopper = HopperProcess(PLAIN)
    hopper.command_rpm(0.0, 5.0)
    hopper.command_rpm(50.0, 25.0, ramp_s=100.0)  # 0.2 rpm a second
    at_100_s = 5.0 + 0.2 * (100.0 - 50.0 - PLAIN.dead_time_s - PLAIN.lag_s)
    assert flow(hopper, 100.0)[0] == pytest.approx(3.0 * at_100_s / 60, rel=1e-12)
    assert hopper.setpoint_rpm(100.0) == pytest.approx(15.0)
    assert hopper.is_ramping(149.9)
    assert not hopper.is_ramping(150.0)


def test_equal_drive_and_hose_lags_make_the_double_lag():
    hopper = HopperProcess(replace(PLAIN, drive_lag_s=1.0, dead_time_s=0.0))
    hopper.command_rpm(0.0, 20.0)
    x = np.linspace(0.0, 8.0, 50)
    assert hopper.nozzle_flow_g_s(x) == pytest.approx(1.0 - (1.0 + x) * np.exp(-x), abs=1e-12)


def test_below_the_least_speed_the_disc_stands():
    hopper = HopperProcess(PLAIN)
    hopper.command_rpm(0.0, 0.29)
    assert hopper.disc_rpm(10.0) == 0.0
    assert hopper.setpoint_rpm(10.0) == 0.29
    hopper.command_rpm(10.0, 0.3)
    assert hopper.disc_rpm(10.0) == pytest.approx(0.3)
    assert flow(hopper, 13.0, 100.0) == pytest.approx([0.0, 3.0 * 0.3 / 60])


def test_a_ramp_through_the_dead_band_jumps_where_it_leaves_it():
    hopper = HopperProcess(replace(PLAIN, lag_s=0.0, dead_time_s=0.0))
    hopper.command_rpm(0.0, 1.0, ramp_s=10.0)
    assert flow(hopper, 2.999, 3.001) == pytest.approx([0.0, 3.0 * 0.3001 / 60])
    hopper.command_rpm(20.0, 0.0, ramp_s=10.0)
    assert flow(hopper, 26.999, 27.001) == pytest.approx([3.0 * 0.3001 / 60, 0.0])


def test_no_disc_turns_faster_than_it_can():
    hopper = HopperProcess(PLAIN)
    hopper.command_rpm(0.0, 99.0)
    assert hopper.disc_rpm(1.0) == pytest.approx(25.0)


def test_the_offset_belongs_to_a_turning_disc_only():
    hopper = HopperProcess(replace(PLAIN, offset_g_min=0.6))
    hopper.command_rpm(0.0, 1.0)
    assert flow(hopper, 60.0)[0] == pytest.approx(3.6 / 60)
    assert hopper.disc_rpm(1.0) == pytest.approx(1.0)
    hopper.command_rpm(60.0, 0.0)
    assert flow(hopper, 120.0)[0] == pytest.approx(0.0, abs=1e-12)


def test_an_empty_hopper_feeds_exactly_its_fill_and_no_more():
    hopper = HopperProcess(replace(PLAIN, fill_g=30.0))
    hopper.command_rpm(0.0, 20.0)  # 1 g/s
    hopper.command_rpm(10.0, 10.0)  # 0.5 g/s: the rest, 20 g, lasts 40 s
    assert hopper.empty_s == pytest.approx(50.0)
    assert hopper.fed_g(49.0) == pytest.approx(29.5)
    assert hopper.fed_g(60.0) == 30.0
    assert hopper.disc_rpm(60.0) == pytest.approx(10.0)  # it turns, with nothing in it
    hopper.command_rpm(50.0, 20.0)
    hopper.command_rpm(70.0, 20.0)
    t = np.linspace(0.0, 100.0, 200_001)
    delivered = np.trapezoid(hopper.nozzle_flow_g_s(t), t)
    assert delivered == pytest.approx(30.0, rel=1e-6)
    assert flow(hopper, 99.0)[0] == pytest.approx(0.0, abs=1e-9)


def test_slower_feeding_puts_the_end_off():
    hopper = HopperProcess(replace(PLAIN, fill_g=30.0))
    hopper.command_rpm(0.0, 20.0)
    assert hopper.empty_s == pytest.approx(30.0)
    hopper.command_rpm(29.0, 0.0)
    assert hopper.empty_s == math.inf
    assert hopper.fed_g(1e6) == pytest.approx(29.0)


def test_powder_runs_out_when_it_is_said_to_through_ramp_and_drive_lag():
    for fill_g in (1.0, 2.0, 40.0, 99.0):
        hopper = HopperProcess(replace(PLAIN, fill_g=fill_g, drive_lag_s=0.5))
        full = HopperProcess(replace(PLAIN, drive_lag_s=0.5))
        for process in (hopper, full):
            process.command_rpm(0.0, 20.0, ramp_s=8.0)
        assert full.fed_g(hopper.empty_s) == pytest.approx(fill_g, rel=1e-9)


def test_a_new_command_replaces_what_had_not_begun():
    hopper = HopperProcess(PLAIN)
    hopper.command_rpm(0.0, 20.0, ramp_s=100.0)
    hopper.command_rpm(50.0, 0.0)
    assert flow(hopper, 60.0, 200.0) == pytest.approx([flow(hopper, 60.0)[0], 0.0], abs=1e-9)
    assert hopper.fed_g(500.0) == pytest.approx(12.5, rel=0.01)


@pytest.mark.parametrize(("time_s", "rpm"), [(5.0, -1.0), (5.0, math.nan), (4.0, 1.0),
                                             (math.inf, 1.0), (math.nan, 1.0)])
def test_impossible_commands_are_refused(time_s, rpm):
    hopper = HopperProcess(PLAIN)
    hopper.command_rpm(5.0, 1.0)
    with pytest.raises(ValueError, match=r"command|cannot go"):
        hopper.command_rpm(time_s, rpm)


def test_noise_is_unsteady_repeatable_and_even_on_average():
    def record(seed: int) -> np.ndarray:
        hopper = HopperProcess(replace(PLAIN, noise_rsd=0.02, seed=seed))
        hopper.command_rpm(0.0, 20.0)
        return hopper.nozzle_flow_g_s(np.linspace(20.0, 620.0, 20_000))

    assert np.array_equal(record(1), record(1))
    assert not np.array_equal(record(1), record(2))
    assert record(1).mean() == pytest.approx(1.0, abs=1e-3)
    assert record(1).std() == pytest.approx(0.02, rel=0.15)


def stepped(config: HopperConfig, commands, times: np.ndarray, dt: float = 4e-3) -> np.ndarray:
    """The same chain by small steps: ramp, dead band, drive, dead time, lag, level."""
    n = round(float(times[-1]) / dt) + 2
    into, out = np.zeros(n), np.zeros(n)
    setpoint = disc = y = fed = 0.0
    target, rate, pending = 0.0, math.inf, list(commands)
    late = round(config.dead_time_s / dt)
    for i in range(n):
        if pending and i * dt >= pending[0][0] - dt / 2:
            _, target, ramp_s = pending.pop(0)
            target = min(target, config.n_max_rpm)
            rate = abs(target - setpoint) / ramp_s if ramp_s else math.inf
        step = min(abs(target - setpoint), rate * dt)
        setpoint += math.copysign(step, target - setpoint)
        turning = setpoint >= config.n_min_rpm and setpoint > 0
        wanted = (config.offset_g_min + config.feed_factor_g_rev * setpoint) / 60 * turning
        keep = math.exp(-dt / config.drive_lag_s) if config.drive_lag_s else 0.0
        disc = wanted + (disc - wanted) * keep
        into[i] = disc if fed < config.fill_g else 0.0
        fed += disc * dt
        y_in = into[i - late] if i >= late else 0.0
        keep = math.exp(-dt / config.lag_s) if config.lag_s else 0.0
        y = y_in + (y - y_in) * keep
        out[i] = y
    return np.interp(times, np.arange(n) * dt, out)


@settings(max_examples=20, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.floats(0.01, 3.0), st.sampled_from([0.0, 0.2, 0.5, 4.0, 25.0, 40.0]),
            st.sampled_from([0.0, 0.1, 1.7, 6.0]),
        ),
        min_size=1, max_size=6,
    ),
    st.sampled_from([0.0, 0.3, 1.0]), st.sampled_from([0.5, 1.0]), st.sampled_from([5.0, 1e4]),
)
def test_the_closed_answer_is_what_small_steps_give(steps, drive_lag_s, lag_s, fill_g):
    config = replace(PLAIN, drive_lag_s=drive_lag_s, lag_s=lag_s, dead_time_s=0.5, fill_g=fill_g,
                     offset_g_min=0.3)
    starts = list(itertools.accumulate(round(gap, 2) for gap, _, _ in steps))
    commands = [(t, rpm, ramp) for t, (_, rpm, ramp) in zip(starts, steps, strict=True)]
    hopper = HopperProcess(config)
    for command in commands:
        hopper.command_rpm(*command)
    times = np.linspace(0.0, starts[-1] + 8.0, 60)
    exact = hopper.nozzle_flow_g_s(times)
    peak = max(0.05, config.feed_factor_g_rev * config.n_max_rpm / 60)
    assert exact == pytest.approx(stepped(config, commands, times), abs=0.03 * peak)
    assert (exact >= -1e-12).all()


def test_a_long_history_keeps_its_answers_and_its_size(monkeypatch):
    monkeypatch.setattr(hose, "MAX_PIECES", 1000)
    short, long = HopperProcess(PLAIN), HopperProcess(PLAIN)
    for i in range(5000):
        long.command_rpm(i * 0.1, 5.0 + i % 7)
    monkeypatch.setattr(hose, "MAX_PIECES", 1 << 20)
    for i in range(5000):
        short.command_rpm(i * 0.1, 5.0 + i % 7)
    times = np.linspace(480.0, 520.0, 400)
    assert long.nozzle_flow_g_s(times) == pytest.approx(short.nozzle_flow_g_s(times), rel=1e-12)
    with pytest.raises(ValueError, match="forgotten"):
        long.nozzle_flow_g_s(np.array([1.0]))


@pytest.mark.parametrize("time_s", [0.3, 1.0, 4.0])
def test_noise_is_correlated_over_its_time(time_s):
    hopper = HopperProcess(replace(PLAIN, noise_rsd=0.03, noise_time_s=time_s, seed=5, fill_g=1e6))
    hopper.command_rpm(0.0, 20.0)
    step_s = time_s / 4
    noise = hopper.nozzle_flow_g_s(20.0 + step_s * np.arange(40_000)) - 1.0
    assert noise.std() == pytest.approx(0.03, rel=0.03)
    for lag in (1, 4, 8):
        found = (noise[:-lag] * noise[lag:]).mean() / noise.var()
        assert found == pytest.approx(math.exp(-lag / 4), abs=0.04)


def test_noise_does_not_depend_on_when_it_is_asked_for():
    times = np.linspace(10.0, 900.0, 500)
    at_once, late_first = (
        HopperProcess(replace(PLAIN, noise_rsd=0.03, noise_time_s=0.5)) for _ in range(2))
    for hopper in (at_once, late_first):
        hopper.command_rpm(0.0, 20.0)
    late_first.nozzle_flow_g_s(times[::-1][:3])
    one_by_one = [late_first.nozzle_flow_g_s(times[i : i + 1])[0] for i in range(500)]
    assert at_once.nozzle_flow_g_s(times) == pytest.approx(one_by_one, rel=1e-12)


def test_the_slope_factor_is_of_the_turning_part_only():
    hopper = HopperProcess(replace(PLAIN, offset_g_min=0.6, slope_factor=1.05))
    hopper.command_rpm(0.0, 4.0)
    assert 60 * flow(hopper, 100.0)[0] == pytest.approx(0.6 + 1.05 * 3.0 * 4.0)
    assert hopper.disc_rpm(100.0) == pytest.approx(4.0)


def test_pulses_come_with_the_grooves_of_the_disc():
    hopper = HopperProcess(replace(PLAIN, pulsation_rsd=0.1, pulses_per_rev=6.0, lag_s=0.0))
    hopper.command_rpm(0.0, 5.0)  # half a pulse a second
    t = np.arange(10.0, 50.0, 1e-3)
    wave = hopper.nozzle_flow_g_s(t) / 0.25 - 1.0
    assert np.sqrt((wave**2).mean()) == pytest.approx(0.1, rel=1e-3)
    rising = t[1:][(wave[:-1] < 0) & (wave[1:] >= 0)]
    assert np.diff(rising) == pytest.approx(np.full(len(rising) - 1, 2.0), abs=2e-3)


def test_the_slope_drifts_with_time_and_level():
    """Against dm/dt = f (1 + k m/M), which grows by an exponential, and a straight drift."""
    level = HopperProcess(replace(PLAIN, fill_g=10_000.0, slope_change_to_empty=-0.2))
    hourly = HopperProcess(replace(PLAIN, slope_drift_per_h=0.02))
    for hopper in (level, hourly):
        hopper.command_rpm(0.0, 20.0)  # 1 g/s
        for t in np.arange(10.0, 3600.0, 10.0):
            hopper.follow_drift(float(t))
    rate = -0.2 / 10_000.0
    assert level.fed_g(3600.0) == pytest.approx(math.expm1(rate * 3600) / rate, rel=1e-3)
    assert hourly.disc_flow_g_s(3600.0) == pytest.approx(1.02, abs=1e-4)
    assert hourly.fed_g(3600.0) == pytest.approx(3600.0 * 1.01, rel=1e-4)


def test_more_carrier_gas_brings_powder_sooner():
    half = replace(PLAIN, carrier_L_min=4.0, carrier_share=0.5, lag_s=0.0)
    for carrier, late_s in ((4.0, 3.0), (8.0, 2.25), (2.0, 4.5), (0.0, 3.0)):
        hopper = HopperProcess(half)
        hopper.set_carrier_L_min(0.0, carrier)
        hopper.command_rpm(10.0, 20.0)
        assert flow(hopper, 10.0 + late_s - 1e-6, 10.0 + late_s) == [0.0, pytest.approx(1.0)]


def test_powder_does_not_overtake_what_went_before():
    hopper = HopperProcess(replace(PLAIN, carrier_share=1.0))
    hopper.command_rpm(0.0, 20.0)
    hopper.set_carrier_L_min(100.0, 400.0)
    hopper.command_rpm(100.5, 0.0)
    t = np.linspace(0.0, 150.0, 150_001)
    assert hopper.nozzle_flow_g_s(t).min() >= 0.0
    assert hopper.nozzle_flow_g_s(t)[t > 110.0].max() == pytest.approx(0.0, abs=1e-3)
