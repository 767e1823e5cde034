"""Gas, powder and recipes: what the feeder driver asks for is what the feeder does."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import numpy as np
import pytest

from firmware_protocol.pmx import FeederStateCode, FeederStatusBits, HopperStatusBits
from lmctl.config.machine import FeederSettings
from lmctl.machine.feeder.driver import FeederDriver
from simulators import virtual_time
from simulators.feeder.config import FeederConfig
from tests.machine.feeder_cell import ONE, TRUTH, disc_rpm, driven, feeding, hopper, now, simulated

pytestmark = pytest.mark.usefixtures("wire")

TWO = FeederConfig("F1", (TRUTH, replace(TRUTH, channel=2, material="WC")))
maps = pytest.mark.parametrize("map_minor", [0, 1])


@maps
def test_from_opening_to_powder_and_back(map_minor):
    async def main():
        config = replace(ONE, map_minor=map_minor)
        async with driven(config) as (driver, device, _, ears):
            assert driver.identity.has_mirror == bool(map_minor)
            assert driver.status.state in (FeederStateCode.NOT_READY, FeederStateCode.READY)
            started_s = now()
            await driver.start_gas()
            assert now() - started_s >= 3.0
            assert driver.status.gas_ok
            driver.set_flows({"A": 6.0})
            await driver.start_powder()
            assert driver.status.feeding
            assert disc_rpm(device) == 3.0
            fed_s = now()
            await driver.wait_until_stable(30.0)
            assert 7.5 <= now() - fed_s <= 9.0
            assert driver.status.mixer_pressure_mbar == 40.0
            await asyncio.sleep(2.1)
            reading = driver.status.hoppers["A"]
            assert reading.flow_estimated_g_min == 6.0
            assert reading.setpoint_g_min == pytest.approx(6.0)
            assert HopperStatusBits.RUNNING in reading.flags
            assert reading.weight_g == pytest.approx(1000.0 - 1.0, abs=0.3)
            await driver.stop_powder()
            assert disc_rpm(device) == 0.0
            stopped_s = now()
            await driver.stop_gas()
            assert 10.0 <= now() - stopped_s <= 11.0
            assert driver.status.state is FeederStateCode.READY
            assert ears.faults == []

    virtual_time.run_in_virtual_time(main())


def test_a_feeder_with_a_patient_watchdog_is_asked_more_often_while_someone_waits():
    """A status every 15 s comes too seldom to see gas or discs start in time."""

    async def main():
        async with driven(watchdog_s=60.0) as (driver, _, _, ears):
            for act, within_s in ((driver.start_gas(), 6.0), (driver.start_powder(), 3.0),
                                  (driver.stop_powder(), 3.0), (driver.stop_gas(), 13.0)):
                began_s = now()
                await act
                assert now() - began_s < within_s
            received = len(ears.statuses)
            await asyncio.sleep(60.0)
            assert len(ears.statuses) - received <= 5
            assert ears.faults == []

    virtual_time.run_in_virtual_time(main())


@maps
def test_a_reading_says_what_its_disc_may_be_coming_from(map_minor):
    """A recipe and the reading of a hopper may be one request."""

    async def main():
        async with driven(replace(ONE, map_minor=map_minor)) as (driver, _, _, _):
            driver.set_flows({"A": 6.0})
            await feeding(driver)
            await asyncio.sleep(3.0)
            assert driver.status.hoppers["A"].previous_setpoints_g_min == ()
            driver.request_hopper_readings()
            driver.set_flows({"A": 3.0})
            await asyncio.sleep(1.1)  # two cycles: on an old map hoppers show in the status after
            reading = driver.status.hoppers["A"]
            assert reading.setpoint_g_min == pytest.approx(3.0)
            assert reading.previous_setpoints_g_min == (6.0,)
            await asyncio.sleep(2.1)
            assert driver.status.hoppers["A"].previous_setpoints_g_min == ()

    virtual_time.run_in_virtual_time(main())


def test_gas_can_be_cut_short():
    async def main():
        async with driven() as (driver, device, _, _):
            await feeding(driver)
            await driver.stop_powder()
            stopped_s = now()
            await driver.stop_gas(post_flow=False)
            assert now() - stopped_s < 1.0
            assert not device.is_gas_flowing(now())

    virtual_time.run_in_virtual_time(main())


def test_two_hoppers_of_one_feeder_change_together():
    async def main():
        async with driven(TWO, hopper("A", 1), hopper("B", 2)) as (driver, device, _, _):
            await feeding(driver)
            changes = []
            commit = device._commit
            device._commit = lambda t: (changes.append(t), commit(t))
            driver.set_flows({"A": 4.0, "B": 12.0})
            await asyncio.sleep(0.1)
            assert (disc_rpm(device, 1), disc_rpm(device, 2)) == (2.0, 6.0)
            assert len(changes) == 1
            await asyncio.sleep(2.0)
            assert driver.status.hoppers["B"].flow_estimated_g_min == 12.0

    virtual_time.run_in_virtual_time(main())


def test_the_second_hopper_alone():
    async def main():
        async with driven(TWO, hopper("B", 2)) as (driver, device, _, _):
            await feeding(driver)
            assert (disc_rpm(device, 1), disc_rpm(device, 2)) == (0.0, 3.0)

    virtual_time.run_in_virtual_time(main())


def test_the_latest_flows_count_and_equal_ones_are_not_sent():
    async def main():
        async with driven() as (driver, device, _, _):
            await feeding(driver)
            applied = device.seq_applied
            for flow in (7.0, 8.0, 9.0):
                driver.set_flows({"A": flow})
            await asyncio.sleep(0.05)
            assert disc_rpm(device) == 4.5
            assert device.seq_applied == applied + 1
            for flow in (9.0, 9.004, 8.996):
                driver.set_flows({"A": flow})
                await asyncio.sleep(1.0)
            assert device.seq_applied == applied + 1
            driver.set_flows({"A": 9.01})
            await asyncio.sleep(0.05)
            assert device.seq_applied == applied + 2

    virtual_time.run_in_virtual_time(main())


def test_set_points_reach_the_device_without_waiting_for_the_cycle():
    async def main():
        async with driven() as (driver, device, _, _):
            await feeding(driver)
            sent, seen = [], []
            for i in range(50):
                driver.set_flows({"A": 6.0 + i * 0.1})
                sent.append((now(), 6.0 + i * 0.1))
                await asyncio.sleep(0.1)
                seen.append(disc_rpm(device) * 2.0)
            assert seen == pytest.approx([flow for _, flow in sent])

    virtual_time.run_in_virtual_time(main())


@maps
def test_requests_are_few(map_minor):
    """Each costs a third of a millisecond: a dry run's speed hangs on their number."""
    async def main():
        async with driven(replace(ONE, map_minor=map_minor)) as (driver, _, _, ears):
            await feeding(driver)
            requests, ask = [], driver._link._ask
            driver._link._ask = lambda *a, **k: (requests.append(now()), ask(*a, **k))[1]
            await asyncio.sleep(20.0)
            turns, hopper_reads = 40, 10
            expected = turns if map_minor else 2 * turns + hopper_reads
            assert abs(len(requests) - expected) <= 2
            assert max(np.diff([s.time_s for s in ears.statuses])) <= 0.5 + 1e-9

    virtual_time.run_in_virtual_time(main())


@pytest.mark.parametrize("flow", [float("nan"), -0.1, 60.1, float("inf")])
def test_flows_that_cannot_be_meant(flow):
    async def main():
        async with driven() as (driver, _, _, _):
            with pytest.raises(ValueError, match="hopper A"):
                driver.set_flows({"A": flow})
            with pytest.raises(ValueError, match="every hopper"):
                driver.set_flows({"A": 1.0, "B": 1.0})
            with pytest.raises(ValueError, match="hopper A"):
                driver.set_flows({"B": 1.0})

    virtual_time.run_in_virtual_time(main())


def test_closing_leaves_the_discs_stopped_and_the_device_content():
    async def main():
        async with simulated(ONE) as (device, server):
            driver = await FeederDriver.open(
                FeederSettings(name="F1", endpoint=server.endpoint), [hopper()]
            )
            await feeding(driver)
            await driver.close()
            assert disc_rpm(device) == 0.0
            await asyncio.sleep(100.0)
            device.advance_to_now()
            assert device.state(now()) is FeederStateCode.NOT_READY
            assert not device.alarms

    virtual_time.run_in_virtual_time(main())


def test_a_second_host_numbers_its_recipes_on():
    """Beginning again at 1 would repeat the number that runs, and commit nothing."""
    async def main():
        async with simulated(ONE) as (device, server):
            feeder = FeederSettings(name="F1", endpoint=server.endpoint)
            for flow in (6.0, 8.0, 10.0):
                driver = await FeederDriver.open(feeder, [hopper()])
                await feeding(driver, flow)
                assert disc_rpm(device) == flow / 2
                await driver.close()

    virtual_time.run_in_virtual_time(main())


def test_status_flags_reach_the_listener():
    async def main():
        async with driven() as (driver, _, _, ears):
            await feeding(driver)
            assert FeederStatusBits.STABLE | FeederStatusBits.REMOTE in ears.statuses[-1].flags
            assert driver.status_age_s <= 0.5

    virtual_time.run_in_virtual_time(main())
