"""What goes wrong with a feeder is noticed in time, and told once, in words."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import numpy as np
import pytest

from firmware_protocol.pmx import FeederCommandBits
from lmctl.errors import MachineError
from simulators import virtual_time
from simulators.feeder.config import FeederConfig
from tests.machine.feeder_cell import ONE, TRUTH, disc_rpm, driven, feeding, now, only_tcp

pytestmark = pytest.mark.usefixtures("wire")


def fault_of(act, config: FeederConfig = ONE, within_s: float = 3.0):
    """Feed, let `act(device, server)` spoil it, and return the faults and how late the first is."""
    async def main():
        async with driven(config) as (driver, device, server, ears):
            await feeding(driver)
            spoilt_s = now()
            heard_s = []
            driver.callbacks.on_fault = lambda reason: (
                ears.faults.append(reason), heard_s.append(now())
            )
            act(device, server)
            await asyncio.sleep(20.0)
            assert driver.fault is not None
            assert driver.fault.what == f"feeder F1: {ears.faults[0]}"
            assert driver.fault.hint
            assert heard_s[0] - spoilt_s <= within_s
            return ears.faults

    return virtual_time.run_in_virtual_time(main())


def test_an_alarm_is_reported_once_in_words():
    assert fault_of(lambda device, _: device.set_estop_open(True)) == [
        "the emergency-stop chain is open"
    ]


def test_an_empty_hopper_is_reported_by_the_name_it_has_in_the_cell():
    config = FeederConfig("F1", (replace(TRUTH, fill_g=1.0),))
    assert fault_of(lambda *_: None, config) == ["hopper A: it is empty"]


def test_a_restart_is_noticed():
    assert fault_of(lambda device, _: device.restart()) == ["the device restarted"]


def test_the_local_switch_is_noticed():
    (reason,) = fault_of(lambda device, _: device.set_local_mode(True))
    assert "LOCAL" in reason


def test_silence_is_noticed_within_the_watchdog_time():
    def fall_silent(device, server):
        server.go_offline()

    (reason,) = fault_of(fall_silent, within_s=2.1)
    assert reason.startswith("no answer for 1.")


def test_data_that_stand_still_are_noticed():
    def freeze(device, server):
        t, moving = now(), device.now
        device.now = lambda: t  # the device's own clock, and so its TICK
        assert moving() == t

    (reason,) = fault_of(freeze)
    assert "same data" in reason


def test_a_recipe_that_is_not_taken_over_is_noticed():
    async def main():
        async with driven() as (driver, device, _, ears):
            await feeding(driver)
            device._commit = lambda time_s: None
            driver.set_flows({"A": 9.0})
            await asyncio.sleep(5.0)
            (reason,) = ears.faults
            assert reason.startswith("it runs recipe")

    virtual_time.run_in_virtual_time(main())


def test_another_host_that_takes_command_away_is_noticed():
    (reason,) = fault_of(lambda device, _: device.write(0, [0]))
    assert "remote control" in reason


def test_another_host_that_stops_powder_is_noticed():
    (reason,) = fault_of(
        lambda device,
        _: device.write(0, [int(FeederCommandBits.ENABLE_REMOTE | FeederCommandBits.GAS_ON)])
    )
    assert reason == "powder stopped by itself (state STOPPING)"


def test_a_host_that_stalls_finds_powder_stopped_by_the_watchdog():
    async def main():
        async with driven() as (driver, device, _, ears):
            await feeding(driver)
            driver._cycle._task.cancel()
            await asyncio.sleep(3.0)
            assert disc_rpm(device) == 0.0
            driver._cycle.start()
            await asyncio.sleep(1.0)
            assert ears.faults == ["the host's heartbeat stopped, and its watchdog tripped"]
            with pytest.raises(MachineError, match="heartbeat stopped"):
                await driver.start_gas()
            await driver.reset_alarms()
            assert driver.fault is None
            await feeding(driver)
            assert disc_rpm(device) == 3.0

    virtual_time.run_in_virtual_time(main())


def test_an_alarm_with_a_cause_that_remains_cannot_be_reset():
    async def main():
        async with driven() as (driver, device, _, _):
            device.set_estop_open(True)
            await asyncio.sleep(1.0)
            with pytest.raises(MachineError, match="the cause of the alarm is still there"):
                await driver.reset_alarms()

    virtual_time.run_in_virtual_time(main())


@only_tcp
def test_a_tcp_link_that_comes_back_in_time_is_no_fault():
    async def main():
        async with driven() as (driver, device, server, ears):
            await feeding(driver)
            server.disconnect_hosts()
            await asyncio.sleep(5.0)
            assert ears.faults == []
            driver.set_flows({"A": 10.0})
            await asyncio.sleep(0.1)
            assert disc_rpm(device) == 5.0

    virtual_time.run_in_virtual_time(main())


def test_a_lost_answer_repeats_the_recipe_under_a_new_number():
    async def main():
        async with driven() as (driver, device, _, ears):
            await feeding(driver)
            ask, lost = driver._link._ask, []

            async def losing(*args, **settings):
                answer = await ask(*args, **settings)
                if not lost:
                    lost.append(answer)
                    from lmctl.machine.modbus.client import NoReplyError
                    raise NoReplyError("lost")
                return answer

            driver._link._ask = losing
            before = device.seq_applied
            driver.set_flows({"A": 9.0})
            await asyncio.sleep(1.2)
            assert lost
            assert device.seq_applied == before + 2
            assert disc_rpm(device) == 4.5
            assert ears.faults == []

    virtual_time.run_in_virtual_time(main())


def test_one_dead_feeder_leaves_the_other_alone():
    async def main():
        async with driven() as (dead, _, dead_server, dead_ears), driven() as (alive, _, _, ears):
            await asyncio.gather(feeding(dead), feeding(alive))
            await dead_server.close()
            ears.statuses.clear()
            await asyncio.sleep(20.0)
            assert len(dead_ears.faults) == 1
            assert ears.faults == []
            assert max(np.diff([s.time_s for s in ears.statuses])) <= 0.5 + 1e-9

    virtual_time.run_in_virtual_time(main())
