"""The feeder driver whole, against the simulated device on the same wires, in virtual time."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace

import numpy as np
import pytest

from firmware_protocol.pmx import Command, HopperFlags, State, Status
from lmctl.config.machine import Feeder, Hopper
from lmctl.errors import ConfigError, MachineError
from lmctl.machine.feeder import FeederDriver
from lmctl.machine.feeder_status import FeederListener
from simulators import virtual_time
from simulators.feeder.config import FeederConfig, HopperConfig
from simulators.feeder.device import PmxDevice
from simulators.feeder.server import serve_pty, serve_tcp
from simulators.modbus_server import ModbusServer

TRUTH = HopperConfig(
    channel=1, material="316L", density_g_mm3=0.008, catch_efficiency=0.7, dead_time_s=3.0,
    lag_s=1.0, feed_factor_g_rev=2.0, n_min_rpm=0.3, n_max_rpm=30.0, fill_g=1000.0,
)
ONE = FeederConfig("F1", (TRUTH,))
TWO = FeederConfig("F1", (TRUTH, replace(TRUTH, channel=2, material="WC")))


SERVING = {"by": serve_tcp}


@pytest.fixture(autouse=True, params=["tcp", "rtu"])
def wire(request, monkeypatch) -> str:
    """Every test here runs over either wire."""
    monkeypatch.setitem(SERVING, "by", serve_tcp if request.param == "tcp" else serve_pty)
    return request.param


def hopper(name: str = "A", channel: int = 1, **changes) -> Hopper:
    return Hopper(**{"name": name, "feeder": "F1", "channel": channel, "material": "316L",
                     "dead_time_s": 3.0, "lag_s": 1.0, "max_flow_g_min": 60.0} | changes)


class Ears(FeederListener):
    def __init__(self) -> None:
        self.statuses, self.faults = [], []
        super().__init__(self.statuses.append, self.faults.append)


@asynccontextmanager
async def simulated(config: FeederConfig) -> AsyncIterator[tuple]:
    device = PmxDevice(config, asyncio.get_running_loop().time)
    server: ModbusServer = await SERVING["by"](device)
    try:
        yield device, server
    finally:
        await server.close()


@asynccontextmanager
async def driven(
    config: FeederConfig = ONE, *hoppers: Hopper, **settings
) -> AsyncIterator[tuple[FeederDriver, PmxDevice, ModbusServer, Ears]]:
    async with simulated(config) as (device, server):
        feeder = Feeder(name="F1", endpoint=server.endpoint, **settings)
        driver = await FeederDriver.open(feeder, hoppers or (hopper(),))
        driver.listener = ears = Ears()
        try:
            yield driver, device, server, ears
        finally:
            await driver.close()


def now() -> float:
    return asyncio.get_running_loop().time()


def disc_rpm(device: PmxDevice, channel: int = 1) -> float:
    device.settle()
    return device.hoppers[channel].process.disc_rpm(now())


async def feeding(driver: FeederDriver, flow_g_min: float = 6.0) -> None:
    await driver.start_gas()
    driver.set_flows({h.name: flow_g_min for h in driver.hoppers})
    await driver.feed_on()
    await driver.stable(30.0)


only_tcp = pytest.mark.parametrize("wire", ["tcp"], indirect=True)
maps = pytest.mark.parametrize("map_minor", [0, 1])


@maps
def test_from_opening_to_powder_and_back(map_minor):
    async def main():
        config = replace(ONE, map_minor=map_minor)
        async with driven(config) as (driver, device, _, ears):
            assert driver.identity.has_mirror == bool(map_minor)
            assert driver.status.state in (State.NOT_READY, State.READY)
            started_s = now()
            await driver.start_gas()
            assert now() - started_s >= 3.0
            assert driver.status.gas_ok
            driver.set_flows({"A": 6.0})
            await driver.feed_on()
            assert driver.status.feeding
            assert disc_rpm(device) == 3.0
            fed_s = now()
            await driver.stable(30.0)
            assert 7.5 <= now() - fed_s <= 9.0
            assert driver.status.total_flow_g_min == 6.0
            await asyncio.sleep(2.1)
            reading = driver.status.hoppers["A"]
            assert reading.flow_est_g_min == 6.0
            assert reading.setpoint_g_min == pytest.approx(6.0)
            assert HopperFlags.RUNNING in reading.flags
            assert reading.weight_g == pytest.approx(1000.0 - 1.0, abs=0.3)
            await driver.feed_off()
            assert disc_rpm(device) == 0.0
            stopped_s = now()
            await driver.gas_off()
            assert 10.0 <= now() - stopped_s <= 11.0
            assert driver.status.state is State.READY
            assert ears.faults == []

    virtual_time.run(main())


def test_gas_can_be_cut_short():
    async def main():
        async with driven() as (driver, device, _, _):
            await feeding(driver)
            await driver.feed_off()
            stopped_s = now()
            await driver.gas_off(post_flow=False)
            assert now() - stopped_s < 1.0
            assert not device.gas_flows(now())

    virtual_time.run(main())


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
            assert driver.status.hoppers["B"].flow_est_g_min == 12.0

    virtual_time.run(main())


def test_the_second_hopper_alone():
    async def main():
        async with driven(TWO, hopper("B", 2)) as (driver, device, _, _):
            await feeding(driver)
            assert (disc_rpm(device, 1), disc_rpm(device, 2)) == (0.0, 3.0)

    virtual_time.run(main())


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

    virtual_time.run(main())


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

    virtual_time.run(main())


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

    virtual_time.run(main())


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

    virtual_time.run(main())


def test_closing_leaves_the_discs_stopped_and_the_device_content():
    async def main():
        async with simulated(ONE) as (device, server):
            driver = await FeederDriver.open(
                Feeder(name="F1", endpoint=server.endpoint), [hopper()]
            )
            await feeding(driver)
            await driver.close()
            assert disc_rpm(device) == 0.0
            await asyncio.sleep(100.0)
            device.settle()
            assert device.state(now()) is State.NOT_READY
            assert not device.alarms

    virtual_time.run(main())


def test_a_second_host_numbers_its_recipes_on():
    """Beginning again at 1 would repeat the number that runs, and commit nothing."""
    async def main():
        async with simulated(ONE) as (device, server):
            feeder = Feeder(name="F1", endpoint=server.endpoint)
            for flow in (6.0, 8.0, 10.0):
                driver = await FeederDriver.open(feeder, [hopper()])
                await feeding(driver, flow)
                assert disc_rpm(device) == flow / 2
                await driver.close()

    virtual_time.run(main())


# --- what may go wrong


def fault_of(act, config: FeederConfig = ONE, within_s: float = 3.0):
    """Feed, let `act(device, server)` spoil it, and return the faults and how late the first is."""
    async def main():
        async with driven(config) as (driver, device, server, ears):
            await feeding(driver)
            spoilt_s = now()
            heard_s = []
            driver.listener.on_fault = lambda reason: (
                ears.faults.append(reason), heard_s.append(now())
            )
            act(device, server)
            await asyncio.sleep(20.0)
            assert driver.fault is not None
            assert driver.fault.what == f"feeder F1: {ears.faults[0]}"
            assert driver.fault.hint
            assert heard_s[0] - spoilt_s <= within_s
            return ears.faults

    return virtual_time.run(main())


def test_an_alarm_is_told_once_in_words():
    assert fault_of(lambda device, _: device.open_estop_chain(True)) == [
        "the emergency-stop chain is open"
    ]


def test_an_empty_hopper_is_told_by_the_name_it_has_in_the_cell():
    config = FeederConfig("F1", (replace(TRUTH, fill_g=1.0),))
    assert fault_of(lambda *_: None, config) == ["hopper A: it is empty"]


def test_a_restart_is_noticed():
    assert fault_of(lambda device, _: device.restart()) == ["the device restarted"]


def test_the_local_switch_is_noticed():
    (reason,) = fault_of(lambda device, _: device.turn_local(True))
    assert "LOCAL" in reason


def test_silence_is_noticed_within_the_watchdog_time():
    def fall_silent(device, server):
        server.stop()

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

    virtual_time.run(main())


def test_another_host_that_takes_command_away_is_noticed():
    (reason,) = fault_of(lambda device, _: device.write(0, [0]))
    assert "remote control" in reason


def test_another_host_that_stops_powder_is_noticed():
    (reason,) = fault_of(
        lambda device, _: device.write(0, [int(Command.ENABLE_REMOTE | Command.GAS_ON)])
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
            await driver.acknowledge()
            assert driver.fault is None
            await feeding(driver)
            assert disc_rpm(device) == 3.0

    virtual_time.run(main())


def test_an_alarm_with_a_cause_that_remains_cannot_be_reset():
    async def main():
        async with driven() as (driver, device, _, _):
            device.open_estop_chain(True)
            await asyncio.sleep(1.0)
            with pytest.raises(MachineError, match="the cause of the alarm is still there"):
                await driver.acknowledge()

    virtual_time.run(main())


@only_tcp
def test_a_tcp_link_that_comes_back_in_time_is_no_fault():
    async def main():
        async with driven() as (driver, device, server, ears):
            await feeding(driver)
            server.drop_hosts()
            await asyncio.sleep(5.0)
            assert ears.faults == []
            driver.set_flows({"A": 10.0})
            await asyncio.sleep(0.1)
            assert disc_rpm(device) == 5.0

    virtual_time.run(main())


def test_a_lost_answer_repeats_the_recipe_under_a_new_number():
    async def main():
        async with driven() as (driver, device, _, ears):
            await feeding(driver)
            ask, lost = driver._link._ask, []

            async def losing(*args, **settings):
                answer = await ask(*args, **settings)
                if not lost:
                    lost.append(answer)
                    from lmctl.machine.modbus import NoAnswerError
                    raise NoAnswerError("lost")
                return answer

            driver._link._ask = losing
            before = device.seq_applied
            driver.set_flows({"A": 9.0})
            await asyncio.sleep(1.2)
            assert lost
            assert device.seq_applied == before + 2
            assert disc_rpm(device) == 4.5
            assert ears.faults == []

    virtual_time.run(main())


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

    virtual_time.run(main())


def test_a_booting_device_is_waited_for():
    async def main():
        async with driven(replace(ONE, boot_s=4.0)) as (driver, _, _, _):
            assert 4.0 <= now() <= 5.0
            await feeding(driver)

    virtual_time.run(main())


def test_a_device_at_local_does_not_open():
    async def main():
        async with simulated(ONE) as (device, server):
            device.turn_local(True)
            with pytest.raises(MachineError, match="LOCAL"):
                await FeederDriver.open(Feeder(name="F1", endpoint=server.endpoint), [hopper()])

    virtual_time.run(main())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"channel": 2}, "has 1 hoppers"),
        ({"max_flow_g_min": 60.1}, "cannot feed 60.1 g/min"),
    ],
)
def test_a_profile_that_does_not_fit_the_device(changes, words):
    async def main():
        async with simulated(ONE) as (_, server):
            with pytest.raises(MachineError, match=words) as caught:
                await FeederDriver.open(
                    Feeder(name="F1", endpoint=server.endpoint), [hopper(**changes)]
                )
            assert caught.value.hint

    virtual_time.run(main())


def test_a_device_of_another_kind_or_map_is_refused(monkeypatch):
    async def main():
        async with simulated(ONE) as (_, server):
            for name, words in (("DEVICE_ID", "no PMX feeder"), ("MAP_MAJOR", "register map")):
                monkeypatch.setattr(f"simulators.feeder.readings.{name}", 7)
                with pytest.raises(MachineError, match=words):
                    await FeederDriver.open(
                        Feeder(name="F1", endpoint=server.endpoint), [hopper()]
                    )
                monkeypatch.undo()

    virtual_time.run(main())


@only_tcp
def test_nobody_there():
    async def main():
        async with simulated(ONE) as (_, server):
            endpoint = server.endpoint
            with pytest.raises(MachineError, match="feeder F1: it does not answer"):
                await FeederDriver.open(
                    Feeder(name="F1", endpoint=endpoint, device_id=9), [hopper()]
                )
        with pytest.raises(MachineError, match=r"nothing answers at 127\.0\.0\.1") as caught:
            await FeederDriver.open(Feeder(name="F1", endpoint=endpoint), [hopper()])
        assert caught.value.exit_code == 4
        with pytest.raises(MachineError, match="cannot open the serial port /dev/nosuch"):
            await FeederDriver.open(
                Feeder(name="F1", endpoint="modbus-rtu:///dev/nosuch"), [hopper()]
            )
        with pytest.raises(ConfigError, match="not an endpoint"):
            await FeederDriver.open(Feeder(name="F1", endpoint="tcp://127.0.0.1:502"), [hopper()])

    virtual_time.run(main())


def test_status_flags_reach_the_listener():
    async def main():
        async with driven() as (driver, _, _, ears):
            await feeding(driver)
            assert Status.STABLE | Status.REMOTE in ears.statuses[-1].flags
            assert driver.status_age_s <= 0.5

    virtual_time.run(main())
