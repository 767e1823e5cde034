"""What a feeder warns of: in words, by hopper where that is known, and the same while it lasts."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.pmx import HopperStatusBits
from lmctl.machine.feeder.readings import HopperReading
from lmctl.machine.feeder.warnings import WarningReader
from simulators import virtual_time
from simulators.feeder.config import FeederConfig
from simulators.feeder.injected_defects import InjectedDefects
from tests.machine.feeder_cell import ONE, TRUTH, driven, feeding, hopper

LOW, DRIFT, UNSTEADY, OLD, CLIPPED = (1 << bit for bit in range(5))
FINE = HopperReading(
    time_s=0.0, flags=HopperStatusBits.PRESENT, setpoint_g_min=6.0, flow_estimated_g_min=6.0,
    flow_weighed_g_min=6.0, weight_g=1000.0, level_percent=50.0, carrier_L_min=4.0,
)


def one(name="A", **changes):
    return {name: replace(FINE, **changes)}


def low(**changes):
    return replace(FINE, flags=HopperStatusBits.LEVEL_LOW, **changes)


def reader(n_hoppers=1, names=None):
    return WarningReader("F1", names or {1: "A"}, n_hoppers)


@pytest.mark.parametrize(("word", "hoppers", "what", "hint"), [
    (LOW, {"A": low(level_percent=9.0, weight_g=180.4)},
     "hopper A of feeder F1: the level is low (9 %, 180 g left)", "fill it soon"),
    (LOW, {"A": low(level_percent=None, weight_g=None)},
     "hopper A of feeder F1: the level is low", "fill it soon"),
    (DRIFT, one(flow_weighed_g_min=5.2),
     "hopper A of feeder F1: the weighed flow differs from the estimate by more than 5 % "
     "(A 5.20 of 6.00 g/min)", "recalibrate"),
    (DRIFT, one(flow_weighed_g_min=None),
     "hopper A of feeder F1: the weighed flow differs from the estimate by more than 5 %",
     "recalibrate"),
    (UNSTEADY, one(), "hopper A of feeder F1: the flow is unsteady, by more than 3 %", "moisture"),
    (OLD, one(), "hopper A of feeder F1: its calibration is old", "before the next job"),
    (CLIPPED, one(flags=HopperStatusBits.LIMITED),
     "hopper A of feeder F1: the set-point was clipped", "speed range"),
    (1 << 7, one(), "hopper A of feeder F1: warning bit 7, which its register map does not list",
     "manual"),
])
def test_each_warning_says_what_where_and_what_next(word, hoppers, what, hint):
    (warning,) = reader().read(word, hoppers)
    assert warning.text == what
    assert hint in warning.remedy
    assert (warning.feeder, warning.hopper) == ("F1", "A")


def test_of_several_hoppers_a_level_is_reported_by_name_and_what_has_no_flag_without():
    two = {"A": FINE, "B": low(level_percent=8.0, weight_g=90.0)}
    found = reader(2, {1: "A", 2: "B"}).read(LOW | OLD, two)
    assert [(w.number, w.hopper) for w in found] == [(51, "B"), (54, "")]
    assert found[1].text == "feeder F1, one of its hoppers: its calibration is old"


@pytest.mark.parametrize("word", [LOW, CLIPPED])
def test_a_level_of_a_hopper_that_is_not_in_use_is_not_reported(word):
    assert reader(2).read(word, one()) == ()


def test_before_hoppers_are_read_nothing_is_said_of_them():
    reads = reader()
    assert reads.read(LOW | DRIFT, {}) == ()
    found = reads.read(LOW | DRIFT, {"A": low(flow_weighed_g_min=5.0)})
    assert [w.text.partition("(")[2] for w in found] == [
        "50 %, 1000 g left)", "A 5.00 of 6.00 g/min)"]


def test_a_second_hopper_that_runs_low_is_reported_though_the_word_is_the_same():
    reads = reader(2, {1: "A", 2: "B"})
    first = reads.read(LOW, {"A": low(), "B": FINE})
    both = reads.read(LOW, {"A": low(), "B": low()})
    assert [w.hopper for w in first] == ["A"]
    assert [w.hopper for w in both] == ["A", "B"]


def test_figures_stay_those_with_which_it_appeared():
    reads = reader()
    first = reads.read(LOW, {"A": low(level_percent=9.0)})
    assert reads.read(LOW, {"A": low(level_percent=8.0)}) is first


@given(st.lists(st.tuples(st.integers(0, 31), st.booleans(), st.booleans()), max_size=40))
def test_whatever_comes_and_goes_it_is_the_same_object_exactly_while_it_is_the_same(story):
    reads, last, hoppers = reader(), (), {}
    for word, is_low, again in story:
        if again or not hoppers:
            flags = HopperStatusBits.LEVEL_LOW if is_low else HopperStatusBits(0)
            hoppers = {"A": replace(FINE, flags=flags | HopperStatusBits.LIMITED)}
        now = reads.read(word, hoppers)
        has_low = HopperStatusBits.LEVEL_LOW in hoppers["A"].flags
        assert [w.number - 51 for w in now] == [
            bit for bit in range(5) if word >> bit & 1 and (bit != 0 or has_low)]
        assert (now is last) == ([w.number for w in now] == [w.number for w in last])
        last = now


@pytest.mark.parametrize("map_minor", [0, 1])
@pytest.mark.usefixtures("wire")
def test_a_driver_shows_a_level_that_sinks_while_it_feeds(map_minor):
    async def main():
        config = FeederConfig("F1", (replace(TRUTH, fill_g=20.0),), map_minor=map_minor)
        async with driven(config) as (driver, _, _, ears):
            await feeding(driver, 6.0)
            await asyncio.sleep(160.0)
            assert driver.status.warnings == ()
            await asyncio.sleep(20.0)  # 0.1 g a second
            (warning,) = driver.status.warnings
            assert warning.hopper == "A"
            assert warning.text == "hopper A of feeder F1: the level is low (10 %, 2 g left)"
            assert ears.faults == []
            objects = {id(status.warnings) for status in ears.statuses[-4:]}
            assert objects == {id(driver.status.warnings)}

    virtual_time.run_in_virtual_time(main())


def test_a_driver_shows_what_has_no_cause_in_the_process_and_that_it_has_gone():
    async def main():
        async with driven(ONE) as (driver, device, _, _ears):
            await feeding(driver)
            device.defects = InjectedDefects()
            undo = device.defects.override_register(0, "WARNING", lambda word: word | OLD)
            await asyncio.sleep(1.1)
            assert [w.number for w in driver.status.warnings] == [54]
            undo()
            await asyncio.sleep(1.1)
            assert driver.status.warnings == ()

    virtual_time.run_in_virtual_time(main())


def test_a_clipped_set_point_shows_in_the_next_answer_and_its_hopper_soon_after():
    async def main():
        async with driven(ONE, hopper("A")) as (driver, device, _, ears):
            await feeding(driver, 10.0)
            assert not driver.status.clipped
            device.set_max_disc_rpm(1, 1.0)
            await asyncio.sleep(driver.period_s + 0.01)
            assert driver.status.clipped
            await asyncio.sleep(4 * driver.period_s)
            assert [(w.number, w.hopper) for w in driver.status.warnings] == [(55, "A")]
            # The disc does what the device asks of it: no other reading tells.
            reading = driver.status.hoppers["A"]
            assert reading.flow_estimated_g_min == pytest.approx(reading.setpoint_g_min)
            assert ears.faults == []

    virtual_time.run_in_virtual_time(main())


def test_an_alarm_names_the_others_that_came_with_it():
    async def main():
        async with driven(ONE) as (driver, device, _, ears):
            await feeding(driver)
            device.raise_alarm(103)
            device.raise_alarm(102)
            await asyncio.sleep(2.0)
            assert ears.faults == [
                "the mixer pressure is too high (and 1 more: the gas supply pressure is low)"]

    virtual_time.run_in_virtual_time(main())
