"""A silent device on a serial line is looked for at other rates and ids, over ptys."""

from __future__ import annotations

import os
import termios
from importlib.resources import files

from lmctl.config.machine import load_profile
from lmctl.config.modbus_device import ModbusDevice
from lmctl.machine.manual.search_lines import find_device, find_rate
from lmctl.machine.motion.endpoint import parse_motion_endpoint
from lmctl.run.cell.doctor import check_inspection, inspect_cell
from simulators import virtual_time
from simulators.faults.link_tap import LinkTap, drop_all
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.server import FeederRegisters
from simulators.modbus_server import serve_pty
from simulators.pty_transport import PtyTransport
from tests.machine.feeder_cell import ONE, now

_SPEEDS = {termios.B9600: 9600, termios.B19200: 19200, termios.B38400: 38400,
           termios.B57600: 57600, termios.B115200: 115200}


def rate_of(path):
    """How the host has set the line that ends at a pty."""
    line = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        return _SPEEDS.get(termios.tcgetattr(line)[4], -1)
    finally:
        os.close(line)


class Controller:
    """Answers `?` at one rate, and is silent at every other."""

    def __init__(self, rate):
        self.rate, self.line = rate, None  # the line is a pty, made with this as its receiver

    def data_received(self, data):
        if rate_of(self.line.path) == self.rate:
            self.line.write(b"<Idle|WPos:0.000,0.000,0.000|FS:0,0>\r\n" * data.count(b"?"))


def test_the_rate_of_a_controller_is_found():
    async def main(rate):
        controller = Controller(rate)
        controller.line = PtyTransport(controller)
        found = await find_rate(parse_motion_endpoint(f"serial://{controller.line.path}"), 9600)
        controller.line.close()
        return found

    assert virtual_time.run(main(115_200)) == 115_200
    assert virtual_time.run(main(38_400)) == 38_400
    assert virtual_time.run(main(None)) is None


def test_the_id_of_a_device_is_found():
    async def main(asked):
        server = await serve_pty(FeederRegisters(PmxFeederDevice(ONE, now)))
        found = await find_device(ModbusDevice(endpoint=server.endpoint, device_id=asked))
        await server.close()
        return found

    what, hint = virtual_time.run(main(7))
    assert what == "device id 1 answers there, and id 7 was asked"
    assert "set device_id = 1" in hint


def test_the_rate_of_a_device_is_found():
    """(A pty has no parity: it keeps none that is set.)"""
    async def main():
        edge = LinkTap()
        server = await serve_pty(FeederRegisters(PmxFeederDevice(ONE, now)), edge=edge)
        path = server.endpoint.partition("//")[2].partition("?")[0]

        def at_its_rate_only(data, deliver):
            if rate_of(path) == 9600:
                deliver(data)

        edge.add_filter("to_device", at_its_rate_only)
        found = await find_device(ModbusDevice(endpoint=server.endpoint, device_id=1))
        await server.close()
        return found

    what, hint = virtual_time.run(main())
    assert "it answers at 9600 baud" in what
    assert "?baud=9600&parity=" in hint


def test_doctor_says_where_silent_devices_were_found(tmp_path):
    """The controller at another rate, a feeder under another id, and one that is not there."""
    async def main():
        controller = Controller(115_200)
        controller.line = PtyTransport(controller)
        server = await serve_pty(FeederRegisters(PmxFeederDevice(ONE, now)))
        edge = LinkTap()
        edge.add_filter("to_device", drop_all)
        dead = await serve_pty(FeederRegisters(PmxFeederDevice(ONE, now)), edge=edge)
        profile = load_profile(files("lmctl.examples") / "cell.toml")
        motion = profile.motion.model_copy(
            update={"endpoint": f"serial://{controller.line.path}", "baud": 9600})
        first, second = profile.feeder
        feeders = (first.model_copy(update={"endpoint": server.endpoint, "device_id": 9}),
                   second.model_copy(update={"endpoint": dead.endpoint}))
        profile = profile.model_copy(update={"motion": motion, "feeder": feeders})
        found = check_inspection(await inspect_cell(profile, tmp_path, search=True), profile)
        for one in (server, dead):
            await one.close()
        controller.line.close()
        return found

    found = virtual_time.run(main())
    (motion,), (first,), (second,) = found.values()
    assert "a Grbl answers there at 115200 baud, and 9600 is set" in motion.text
    assert motion.hint == "set motion.baud = 115200 in the machine profile"
    assert "device id 1 answers there, and id 9 was asked" in first.text
    assert "nor does anything answer at other ids and rates" in second.text


def test_a_device_on_a_network_is_not_looked_for():
    async def main():
        return await find_device(ModbusDevice(endpoint="modbus-tcp://127.0.0.1:1"))

    assert virtual_time.run(main()) is None
