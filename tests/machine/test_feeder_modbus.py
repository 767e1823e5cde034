"""The Modbus adapter: endpoints, exceptions, limits, and requests that are broken off."""

import asyncio

import pytest
from pymodbus.framer import FramerRTU

from lmctl.config.modbus_device import ModbusDevice
from lmctl.errors import ConfigError, MachineError
from lmctl.machine.modbus.client import ModbusExceptionError, ModbusLink, NoReplyError
from lmctl.machine.modbus.endpoint import RtuEndpoint, TcpEndpoint, parse_modbus_endpoint
from simulators import virtual_time
from simulators.feeder.config import FeederConfig, HopperConfig
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.server import serve_pty, serve_tcp

CONFIG = FeederConfig("F1", (HopperConfig(1, "316L", 0.008, 0.7, 3.0, 1.0, 2.0, 0.3, 30.0, 1e3),))


def test_endpoints():
    assert parse_modbus_endpoint("modbus-tcp://10.0.0.6") == TcpEndpoint(
        "modbus-tcp://10.0.0.6", "10.0.0.6", 502
    )
    assert parse_modbus_endpoint("modbus-tcp://h:5021/").port == 5021
    text = "modbus-rtu:///dev/ttyS1?baud=38400&parity=o&stop=2"
    assert parse_modbus_endpoint(text) == RtuEndpoint(text, "/dev/ttyS1", 38_400, "O", 2)
    plain = parse_modbus_endpoint("modbus-rtu://COM3")
    assert (plain.path, plain.baud, plain.parity) == ("COM3", 19_200, "E")
    assert plain.character_s == pytest.approx(11 / 19_200)


@pytest.mark.parametrize(
    "text",
    ["", "modbus-tcp://", "tcp://127.0.0.1:502", "modbus-tcp://h:0", "modbus-tcp://h:70000",
     "modbus-tcp://h:x", "modbus-tcp://h/path", "modbus-rtu://", "modbus-tcp://[::1"],
)
def test_what_is_no_endpoint(text):
    with pytest.raises(ConfigError, match="not an endpoint") as caught:
        parse_modbus_endpoint(text)
    assert "modbus-tcp://" in caught.value.hint


@pytest.mark.parametrize(
    ("text", "words"),
    [("modbus-rtu:///dev/x?baud=", "key 'baud' has no value"),
     ("modbus-rtu:///dev/x?baud=fast", "baud=fast will not do"),
     ("modbus-rtu:///dev/x?baud=1", "baud=1 will not do"),
     ("modbus-rtu:///dev/x?parity=M&stop=3", "parity=M and stop=3 will not do"),
     ("modbus-rtu:///dev/x?speed=9600&bits=7", "unknown key 'speed'; unknown key 'bits'"),
     ("modbus-rtu:///dev/x?baud=9600&baud=19200", "key 'baud' is given twice"),
     ("modbus-rtu:///dev/x?9600", "unknown key '9600'"),
     ("modbus-rtu:///dev/x?&", "'&' is no key=value")],
)
def test_keys_of_a_serial_line_that_are_wrong_are_named_with_the_valid_ones(text, words):
    with pytest.raises(ConfigError, match="is not an endpoint") as caught:
        parse_modbus_endpoint(text)
    assert words in caught.value.what
    assert "baud=300..4000000 (19200), parity=N, E or O (E), stop=1 or 2 (1)" in caught.value.hint


def test_a_network_address_takes_no_keys():
    with pytest.raises(ConfigError, match="unknown key 'baud'") as caught:
        parse_modbus_endpoint("modbus-tcp://h?baud=9600")
    assert "it takes no keys" in caught.value.hint


def linked(wire: str, act, timeout_s: float = 0.5):
    """Run act(link, device) against the simulated feeder."""
    async def main():
        device = PmxFeederDevice(CONFIG, asyncio.get_running_loop().time)
        server = await (serve_tcp if wire == "tcp" else serve_pty)(device)
        link = await ModbusLink.open(
            ModbusDevice(endpoint=server.endpoint, device_id=1), timeout_s=timeout_s)
        try:
            return await act(link, device)
        finally:
            await link.close()
            await server.close()

    return virtual_time.run_in_virtual_time(main())


wires = pytest.mark.parametrize("wire", ["tcp", "rtu"])


@wires
def test_reads_writes_and_exchanges(wire):
    async def act(link, device):
        await link.write(20, [1, 2, 3])
        assert list(await link.read_holding(20, 3)) == [1, 2, 3]
        assert list(await link.exchange(20, [7], 500, 1)) == [0x504D]
        assert list(await link.read_input(0, 1)) == [0x504D]
        assert device.holding.read(20, 1) == [7]

    linked(wire, act)


@wires
@pytest.mark.parametrize(
    ("address", "words", "code", "words_for_it"),
    [(3, [9], 3, "beyond its limits"), (900, [1], 2, "no such register"),
     (2, [0], 4, "present state")],
)
def test_exceptions_come_in_words(wire, address, words, code, words_for_it):
    async def act(link, _):
        with pytest.raises(ModbusExceptionError, match=words_for_it) as caught:
            await link.write(address, words)
        assert caught.value.code == code
        assert isinstance(caught.value, MachineError)
        with pytest.raises(ModbusExceptionError):
            await link.exchange(address, words, 500, 1)

    linked(wire, act)


@wires
def test_an_unanswered_request_fails_after_its_time_and_ages_the_link(wire):
    async def act(link, _):
        loop = asyncio.get_running_loop()
        await link.read_input(0, 1)
        link._device_id = 9
        asked_s = loop.time()
        with pytest.raises(NoReplyError, match="does not answer"):
            await link.read_input(0, 1)
        assert loop.time() - asked_s == pytest.approx(0.5)
        assert link.answer_age_s == pytest.approx(0.5)
        link._device_id = 1
        await link.read_input(0, 1)
        assert link.answer_age_s == 0.0

    linked(wire, act)


@wires
def test_a_request_broken_off_does_not_lend_its_answer_to_the_next(wire):
    async def act(link, device):
        for _ in range(20):
            asking = asyncio.ensure_future(link.read_input(0, 1))
            await asyncio.sleep(0)
            await asyncio.sleep(0)
            asking.cancel()
            await asyncio.gather(asking, return_exceptions=True)
            assert list(await link.read_input(3, 1)) == [1]  # N_HOPPERS, never DEVICE_ID

    linked(wire, act)


def test_a_serial_line_stays_quiet_until_a_late_answer_is_over():
    async def act(link, _):
        loop = asyncio.get_running_loop()
        asking = asyncio.ensure_future(link.read_input(0, 1))
        await asyncio.sleep(0)
        asking.cancel()
        await asyncio.gather(asking, return_exceptions=True)
        broken_off_s = loop.time()
        await link.read_input(0, 1)
        assert loop.time() - broken_off_s >= 0.5

    linked("rtu", act)


@pytest.mark.parametrize("count", [0, 126, -1])
def test_no_request_reads_more_than_the_protocol_allows(count):
    async def act(link, _):
        for read in (link.read_input, link.read_holding):
            with pytest.raises(ValueError, match="1 to 125 registers"):
                await read(0, count)

    linked("tcp", act)


def test_no_request_writes_more_than_the_protocol_allows():
    async def act(link, _):
        with pytest.raises(ValueError, match="1 to 123 registers"):
            await link.write(0, [0] * 124)
        with pytest.raises(ValueError, match="1 to 121 registers"):
            await link.exchange(0, [0] * 122, 0, 1)

    linked("tcp", act)


def test_an_answer_that_states_fewer_registers_than_it_has_is_none():
    def state_one_less(data, deliver):
        frame = data[:2] + bytes([data[2] - 2]) + data[3:-2]
        deliver(frame + FramerRTU.compute_CRC(frame).to_bytes(2, "big"))

    async def main():
        server = await serve_pty(PmxFeederDevice(CONFIG, asyncio.get_running_loop().time))
        link = await ModbusLink.open(ModbusDevice(endpoint=server.endpoint), timeout_s=0.5)
        server.edge.add_filter("to_host", state_one_less)
        try:
            with pytest.raises(NoReplyError) as refused:
                await link.read_input(0, 4)
        finally:
            await link.close()
            await server.close()
        return refused.value.what

    assert "answers with 3 registers where 4 were asked for" in virtual_time.run_in_virtual_time(
        main())


def test_input_registers_that_no_holding_register_shows_cannot_be_read_without_code_04():
    async def main():
        server = await serve_tcp(PmxFeederDevice(CONFIG, asyncio.get_running_loop().time))
        link = await ModbusLink.open(
            ModbusDevice(endpoint=server.endpoint, function_codes=(3, 16)), timeout_s=0.5)
        try:
            with pytest.raises(ValueError, match="register 6 is shown by no holding register"):
                await link.read_input(6, 1)
        finally:
            await link.close()
            await server.close()

    virtual_time.run_in_virtual_time(main())


def test_requests_of_several_tasks_do_not_mix():
    async def act(link, _):
        answers = await asyncio.gather(*(link.read_input(a, 1) for a in (0, 3, 0, 3, 0, 3)))
        assert [list(answer) for answer in answers] == [[0x504D], [1]] * 3

    linked("rtu", act)


def test_a_gateway_that_takes_and_drops_connections_is_left_alone_but_once_a_second():
    """Connected is not answered: the wait between attempts grows until something answers."""
    async def main():
        loop = asyncio.get_running_loop()
        device = PmxFeederDevice(CONFIG, loop.time)
        server = await serve_tcp(device)
        link = await ModbusLink.open(
            ModbusDevice(endpoint=server.endpoint, device_id=1), timeout_s=0.5)
        await link.read_input(0, 2)
        port = int(server.endpoint.rsplit(":", 1)[1])
        await server.close()
        came_s = []

        def turned_away(reader, writer):
            came_s.append(loop.time())
            writer.close()

        gateway = await asyncio.start_server(turned_away, "127.0.0.1", port)
        await asyncio.sleep(60.0)
        gateway.close()
        await gateway.wait_closed()
        server = await serve_tcp(device, port=port)
        await asyncio.sleep(1.1)
        words = await link.read_input(0, 2)
        await link.close()
        await server.close()
        return came_s, words

    came_s, words = virtual_time.run_in_virtual_time(main())
    assert 55 <= len(came_s) <= 66
    assert len(words) == 2
