"""Feeders with register maps of their own: four habits, each against a device made from the same
map and against one written by hand from its manual."""

import asyncio
from contextlib import asynccontextmanager
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import pytest

from firmware_protocol.map_file import load_map, parse_map, shipped_map
from firmware_protocol.pmx_alarms import CLIPPED
from lmctl.config.machine import FeederSettings
from lmctl.errors import MachineError
from lmctl.machine.feeder.driver import FeederDriver
from lmctl.machine.manual.inspect_modbus import inspect_feeder
from lmctl.run.cell.feeder_conditions import FeederSnapshot, feeder_conditions
from simulators import virtual_time
from simulators.feeder.config import FeederConfig
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.mapped_device import MappedFeederDevice
from simulators.feeder.server import FeederRegisters
from simulators.modbus_quirks import ModbusQuirks
from simulators.modbus_server import serve_pty, serve_tcp
from tests.machine.feeder_cell import TRUTH, Ears, hopper, now
from tests.machine.independent_feeders import FEEDERS

EXAMPLES = Path(str(files("lmctl.examples")))
MAPS = {name: load_map(EXAMPLES / f"feeder-{name}.toml") for name in FEEDERS}
#: What the device of each map resolves of a flow [g/min].
STEP_G_MIN = {"coils": 0.01, "rtu": 0.002, "tcp": 0.001, "analog": 75 / 27648}
TWO = FeederConfig("F1", (TRUTH, replace(TRUTH, channel=2)))


def hoppers():
    return hopper("A", 1), hopper("B", 2)


def settings(endpoint, device_map, **keys):
    feeder = FeederSettings(name="F1", endpoint=endpoint, map="of the test", **keys)
    return feeder.with_device_map(device_map)


@asynccontextmanager
async def from_the_map(device_map, wire="tcp", config=TWO):
    """A simulated device made of the map itself. Yields its endpoint and its truth."""
    has_watchdog = device_map.feeder.has_watchdog
    device = PmxFeederDevice(replace(config, has_watchdog=has_watchdog), now)
    units = MappedFeederDevice(device, device_map).units()
    own = units.pop(None)
    serve = serve_tcp if wire == "tcp" else serve_pty
    keywords = {} if wire == "tcp" else {"baud": 115_200}
    server = await serve(
        own, units={one.device_id: one for one in units.values()},
        quirks=ModbusQuirks(0, device_map.max_registers, device_map.function_codes), **keywords)
    try:
        yield server.endpoint, device
    finally:
        await server.close()


@asynccontextmanager
async def driven(endpoint, device_map, **keys):
    driver = await FeederDriver.open(settings(endpoint, device_map, **keys), hoppers())
    driver.callbacks = ears = Ears()
    try:
        yield driver, ears
    finally:
        await driver.close()


async def feed(driver, a, b):
    await driver.start_gas()
    driver.set_flows({"A": a, "B": b})
    await driver.start_powder()
    await driver.wait_until_stable(40.0)


def true_flows(device):
    device.advance_to_now()
    return [60 * one.process.disc_flow_g_s(now()) for one in device.hoppers.values()]


@pytest.mark.parametrize("wire", ["tcp", "rtu"])
@pytest.mark.parametrize("name", MAPS)
def test_a_device_made_from_the_map_feeds_what_is_set_and_stops(name, wire):
    async def main():
        async with from_the_map(MAPS[name], wire) as (endpoint, device):
            async with driven(endpoint, MAPS[name]) as (driver, ears):
                await feed(driver, 6.0, 17.31)
                assert true_flows(device) == pytest.approx([6.0, 17.31], abs=0.02)
                driver.set_flows({"A": 0.0, "B": 40.0})
                await asyncio.sleep(3.0)
                assert true_flows(device) == pytest.approx([0.0, 40.0], abs=0.02)
                status = await driver.complete_status()
                assert ears.faults == []
                assert status.feeding
                await driver.stop_powder()
                assert not device.discs_on
                assert device.is_gas_flowing(now())
                await driver.stop_gas()
                assert not device.is_gas_flowing(now())
                off_s = device.gas[-1][0]
                assert off_s - device.spans[-1].end_s == pytest.approx(10.0, abs=1.1)
            assert ears.faults == []

    virtual_time.run_in_virtual_time(main())


@pytest.mark.parametrize("name", MAPS)
def test_a_device_written_by_hand_feeds_what_is_set_and_stops(name):
    async def main():
        device = FEEDERS[name]()
        async with device.served() as endpoint:
            async with driven(endpoint, MAPS[name]) as (driver, ears):
                assert device.flows_g_min == (0.0, 0.0)
                await feed(driver, 6.0, 17.31)
                step = STEP_G_MIN[name]
                assert device.flows_g_min == pytest.approx((6.0, 17.31), abs=step)
                fed_before = device.fed_g(2)
                await asyncio.sleep(30.0)
                assert device.fed_g(2) - fed_before == pytest.approx(17.31 / 2, rel=0.01)
                driver.set_flows({"A": 0.0, "B": 40.0})
                await asyncio.sleep(1.0)
                assert device.flows_g_min == pytest.approx((0.0, 40.0), abs=step)
                await asyncio.sleep(4 * driver.period_s)  # hoppers are read so often
                status = driver.status
                reported = status.hoppers["B"].flow_estimated_g_min
                assert reported == (None if name == "analog" else pytest.approx(40.0, abs=0.01))
                assert ears.faults == []
                await driver.stop_powder()
                assert device.flows_g_min == (0.0, 0.0)
                assert device.gas_on
                await driver.stop_gas()
            assert ears.faults == []
            assert name == "rtu" or not device.gas_on

    virtual_time.run_in_virtual_time(main())


def test_gas_off_at_once_does_not_wait_for_the_post_flow():
    async def main():
        device = FEEDERS["tcp"]()
        async with device.served() as endpoint, driven(endpoint, MAPS["tcp"]) as (driver, _):
            await feed(driver, 6.0, 6.0)
            stopped_s = now()
            await driver.stop_gas(post_flow=False)
            assert not device.gas_on
            assert now() - stopped_s < 1.5

    virtual_time.run_in_virtual_time(main())


def test_the_words_of_a_hand_written_device_are_read_in_its_units():
    async def main():
        device = FEEDERS["rtu"]()
        async with device.served() as endpoint, driven(endpoint, MAPS["rtu"]) as (driver, _):
            await feed(driver, 6.0, 60.0)
            status = await driver.complete_status()
            weight_g = 5000 - device.fed_g(2)
            # Read within four cycles; a gram a second goes out meanwhile.
            assert weight_g <= status.hoppers["B"].weight_g <= weight_g + 3.0
            assert status.hoppers["A"].flow_weighed_g_min == pytest.approx(6.0)
            assert status.hoppers["A"].level_percent == 50.0
            assert status.total_gas_L_min == 8.0
            assert status.hoppers["A"].carrier_L_min == 4.0
            assert status.mixer_pressure_mbar is None

    virtual_time.run_in_virtual_time(main())


def test_coils_toggle_pulse_and_enable_only_the_hoppers_in_use():
    async def main():
        device = FEEDERS["coils"]()
        async with device.served() as endpoint, driven(endpoint, MAPS["coils"]) as (driver, ears):
            await feed(driver, 6.0, 6.0)
            beats = device.beats
            await asyncio.sleep(10.0)
            assert device.beats - beats >= 4 * 10.0 / settings("modbus-tcp://x", MAPS["coils"]
                                                               ).watchdog_s - 1
            assert (device.coils[10], device.coils[11]) == (1, 1)
            await driver.reset_alarms()
            assert device.resets == 1
            assert device.coils[3] == 0
            assert driver.status.feeding
            assert ears.faults == []
            status = await driver.complete_status()
            assert status.hoppers["A"].flow_estimated_g_min == pytest.approx(6.0)
            alarms = device.inputs
            device.inputs = lambda: alarms() | {4: 1}
            await asyncio.sleep(3.0)
            assert driver.status.alarm.text == "a disc drive reports a fault"

    virtual_time.run_in_virtual_time(main())


@pytest.mark.parametrize(("name", "word", "other"), [("rtu", 0, 1), ("analog", 8192, 751),
                                                     ("coils", 0, 4472)])
def test_another_device_is_recognised_before_anything_is_written(name, word, other):
    async def main():
        device = FEEDERS[name]()
        true = device.reported
        device.reported = lambda unit, code: true(unit, code) | {word: other}
        async with device.served() as endpoint:
            with pytest.raises(MachineError, match="is no") as refused:
                await FeederDriver.open(settings(endpoint, MAPS[name]), hoppers())
            assert f"is {other}, not" in refused.value.render()
        assert device.written == []

    virtual_time.run_in_virtual_time(main())


@pytest.mark.parametrize(("name", "place"), [("rtu", (1, 120)), ("tcp", (12, 11)),
                                             ("coils", (1, 20)),
                                             ("analog", (1, 521))])
def test_a_set_point_that_does_not_arrive_is_a_fault(name, place):
    """Written in order and read back: the device answers, and keeps another value."""
    async def main():
        device = FEEDERS[name]()
        async with device.served() as endpoint, driven(endpoint, MAPS[name]) as (driver, ears):
            await feed(driver, 6.0, 6.0)
            device.ignored.add(place)
            driver.set_flows({"A": 7.0, "B": 9.21})
            await asyncio.sleep(5.0)
            assert any("runs recipe" in fault for fault in ears.faults)

    virtual_time.run_in_virtual_time(main())


def test_a_set_point_beyond_the_limits_of_the_map_is_clipped_and_told():
    """A slope that has fallen asks for more than 10 V: the mixture is no longer the planned one."""
    async def main():
        device = FEEDERS["analog"]()
        async with device.served() as endpoint, driven(endpoint, MAPS["analog"]) as (driver, ears):
            await feed(driver, 6.0, 50.0)
            assert not driver.status.clipped
            driver.correct_slope("B", 0.5)
            await asyncio.sleep(5 * driver.period_s)
            assert device.flows_g_min == pytest.approx((6.0, 75.0), abs=0.01)
            assert driver.status.clipped
            assert [one.hopper for one in driver.status.warnings if one.number == CLIPPED] == ["B"]
            assert ears.faults == []

    virtual_time.run_in_virtual_time(main())


def test_a_stop_that_does_not_arrive_is_repeated_and_reported():
    """Nothing but the outputs read back shows what an analog feeder does."""
    async def main():
        device = FEEDERS["analog"]()
        async with device.served() as endpoint:
            driver = await FeederDriver.open(settings(endpoint, MAPS["analog"]), hoppers())
            await feed(driver, 6.0, 6.0)
            device.ignored.add((1, 512))
            with pytest.raises(MachineError, match="powder did not stop"):
                await driver.stop_powder()
            device.ignored.clear()
            await driver.stop_powder()
            assert device.flows_g_min == (0.0, 0.0)
            await driver.close()

    virtual_time.run_in_virtual_time(main())


@pytest.mark.parametrize("name", ["tcp", "analog"])
def test_a_device_without_watchdog_says_so_for_as_long_as_it_is_used(name):
    async def main():
        async with from_the_map(MAPS[name]) as (endpoint, _):
            async with driven(endpoint, MAPS[name]) as (driver, _):
                await driver.complete_status()
                (warning,) = driver.status.warnings
                assert "no watchdog" in warning.text
                assert "relay" in warning.text
            look = await inspect_feeder(settings(endpoint, MAPS[name]), hoppers())
            assert dict(look.identity.substitutions)["watchdog"]

    virtual_time.run_in_virtual_time(main())


def test_a_watchdog_of_the_map_stops_the_device_when_the_host_is_silent():
    async def main():
        async with from_the_map(MAPS["rtu"]) as (endpoint, device):
            driver = await FeederDriver.open(settings(endpoint, MAPS["rtu"], watchdog_s=2.0),
                                             hoppers())
            await feed(driver, 6.0, 6.0)
            silent_s = now()
            await driver._cycle.stop()
            await asyncio.sleep(10.0)
            device.advance_to_now()
            assert not device.discs_on
            assert 1.4 <= device.spans[-1].end_s - silent_s <= 2.1
            await driver.close()

    virtual_time.run_in_virtual_time(main())


def test_an_alarm_is_told_in_the_words_of_the_map():
    async def main():
        async with (
            from_the_map(MAPS["rtu"]) as (endpoint, device),
            driven(endpoint, MAPS["rtu"]) as (driver, ears),
        ):
            await feed(driver, 6.0, 6.0)
            device.raise_alarm(202)
            await asyncio.sleep(2.0)
            assert ears.faults == ["a screw does not turn"]
            await driver.reset_alarms()
            assert driver.status.alarm is None

    virtual_time.run_in_virtual_time(main())


def test_a_feeder_that_only_takes_a_set_point_stops_by_zero():
    """Gas is switched by hand, and nothing starts or stops its discs but their set-points."""
    text = """
        name = "bare"
        device = "feeder"
        hoppers = 2
        hopper_register = [{ name = "SET", address = 10, step = 1, unit = "g/min",
                             counts_per_unit = 100, writable = true }]
        [hopper_values]
        flow_setpoint_g_min = "SET"
        [missing]
        feed = "zero_flow"
        gas = "by_hand"
        identity = "none"
        atomic_recipe = "ordered_writes"
        watchdog = "interlock"
        remote = "always"
        gas_ok = "timed"
        feeding = "commanded"
        stable = "timed"
        post_flow = "timed"
        flow = "none"
        alarm = "none"
        clock = "none"
    """
    # An inline table is one line.
    bare = parse_map(text.replace('unit = "g/min",\n', 'unit = "g/min",'))

    async def main():
        async with from_the_map(bare) as (endpoint, device):
            async with driven(endpoint, bare) as (driver, ears):
                await feed(driver, 6.0, 17.31)
                assert true_flows(device) == pytest.approx([6.0, 17.31], abs=0.02)
                await driver.stop_powder()
                assert true_flows(device) == [0.0, 0.0]
                await driver.stop_gas()
                assert {"gas", "watchdog"} == {
                    one.text.split(" has no ")[1].split(":")[0] for one in driver.status.warnings}
            assert ears.faults == []

    virtual_time.run_in_virtual_time(main())


def test_the_map_of_a_pmx_says_enough_to_drive_one():
    """The same device, once by its own driver and once through its map file alone."""
    text = (Path(str(files("firmware_protocol"))) / "maps/pmx.toml").read_text()
    by_map = parse_map(text.replace("hoppers = 4", "hoppers = 2"))

    async def main():
        async with from_the_map(by_map) as (endpoint, device):
            async with driven(endpoint, by_map) as (driver, ears):
                await feed(driver, 6.0, 17.31)
                assert true_flows(device) == pytest.approx([6.0, 17.31], abs=0.02)
                await driver.stop_powder()
                await driver.stop_gas()
            assert ears.faults == []

    virtual_time.run_in_virtual_time(main())


def test_a_profile_may_name_the_pmx_map():
    """Then the device is driven as without a map: recipes change at once."""
    async def main():
        device = PmxFeederDevice(TWO, now)
        server = await serve_tcp(FeederRegisters(device))
        async with driven(server.endpoint, shipped_map("pmx")) as (driver, _):
            await feed(driver, 6.0, 6.0)
            assert driver.identity.device == ""
            assert driver.identity.feed_factor_g_rev == {"A": 2.0, "B": 2.0}
        await server.close()

    virtual_time.run_in_virtual_time(main())


def test_conditions_of_a_run_claim_nothing_that_the_device_does_not_report():
    async def main():
        async with from_the_map(MAPS["analog"]) as (endpoint, _):
            look = await inspect_feeder(settings(endpoint, MAPS["analog"]), hoppers())
        reading = FeederSnapshot(look.identity, look.status, look.hopper_limits)
        told = [one.text for one in feeder_conditions(
            reading, settings(endpoint, MAPS["analog"]), hoppers(), send_horizon_s=1.0)]
        assert told[0].startswith("analog feeders behind an I/O module, by its register map")
        assert "no flow: no flow is reported: a jammed disc is not noticed" in told
        assert sum("no watchdog" in text for text in told) == 1
        assert "no alarm" not in told
        for claim in ("e-stop", "lids", "switch at", "watchdog quiet", "other host",
                      "clock runs"):
            assert not any(claim in text for text in told), claim

    virtual_time.run_in_virtual_time(main())
