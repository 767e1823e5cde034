"""Feeders that boot, stand at LOCAL, do not fit the profile, or are not there."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lmctl.config.machine import FeederSettings
from lmctl.errors import ConfigError, MachineError
from lmctl.machine.feeder.driver import FeederDriver
from simulators import virtual_time
from tests.machine.feeder_cell import ONE, driven, feeding, hopper, now, only_tcp, simulated

pytestmark = pytest.mark.usefixtures("wire")


def test_a_booting_device_is_waited_for():
    async def main():
        async with driven(replace(ONE, boot_s=4.0)) as (driver, _, _, _):
            assert 4.0 <= now() <= 5.0
            await feeding(driver)

    virtual_time.run_in_virtual_time(main())


def test_a_device_at_local_does_not_open():
    async def main():
        async with simulated(ONE) as (device, server):
            device.set_local_mode(True)
            with pytest.raises(MachineError, match="LOCAL"):
                await FeederDriver.open(FeederSettings(name="F1", endpoint=server.endpoint),
                                        [hopper()])

    virtual_time.run_in_virtual_time(main())


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
                    FeederSettings(name="F1", endpoint=server.endpoint), [hopper(**changes)]
                )
            assert caught.value.hint

    virtual_time.run_in_virtual_time(main())


def test_a_device_of_another_kind_or_map_is_refused(monkeypatch):
    async def main():
        async with simulated(ONE) as (_, server):
            for name, words in (("DEVICE_ID", "no PMX feeder"),
                                ("MAP_MAJOR_VERSION", "register map")):
                monkeypatch.setattr(f"simulators.feeder.readings.{name}", 7)
                with pytest.raises(MachineError, match=words):
                    await FeederDriver.open(
                        FeederSettings(name="F1", endpoint=server.endpoint), [hopper()]
                    )
                monkeypatch.undo()

    virtual_time.run_in_virtual_time(main())


@only_tcp
def test_no_one_there():
    async def main():
        async with simulated(ONE) as (_, server):
            endpoint = server.endpoint
            with pytest.raises(MachineError, match="feeder F1: it does not answer"):
                await FeederDriver.open(
                    FeederSettings(name="F1", endpoint=endpoint, device_id=9), [hopper()]
                )
        with pytest.raises(MachineError, match=r"nothing answers at 127\.0\.0\.1") as caught:
            await FeederDriver.open(FeederSettings(name="F1", endpoint=endpoint), [hopper()])
        assert caught.value.exit_code == 4
        with pytest.raises(MachineError, match="cannot open the serial port /dev/nosuch"):
            await FeederDriver.open(
                FeederSettings(name="F1", endpoint="modbus-rtu:///dev/nosuch"), [hopper()]
            )
        with pytest.raises(ConfigError, match="not an endpoint"):
            await FeederDriver.open(FeederSettings(name="F1", endpoint="tcp://127.0.0.1:502"),
                                    [hopper()])

    virtual_time.run_in_virtual_time(main())
