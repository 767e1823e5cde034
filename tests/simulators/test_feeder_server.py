"""The feeder's wire: what pymodbus frames, the device answers, and nonsense gets an exception."""

import asyncio
import os
import struct
import tty

import pytest

from simulators import virtual_time
from simulators.feeder.config import FeederConfig, HopperConfig
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.server import serve_pty, serve_tcp

CONFIG = FeederConfig(
    "F1", (HopperConfig(1, "316L", 0.008, 0.7, 3.0, 1.0, 2.0, 0.3, 30.0, 1e3),), device_id=5
)


def framed(pdu: bytes, number: int = 1, device: int = 5) -> bytes:
    return struct.pack(">HHHB", number, 0, len(pdu) + 1, device) + pdu


def asked(*requests: bytes, wait_s: float = 0.1) -> bytes:
    """What comes back on one TCP connection, each request sent after the one before settled."""
    async def main():
        device = PmxFeederDevice(CONFIG, asyncio.get_running_loop().time)
        server = await serve_tcp(device)
        host, _, port = server.endpoint.removeprefix("modbus-tcp://").partition(":")
        reader, writer = await asyncio.open_connection(host, int(port))
        for request in requests:
            writer.write(request)
            await asyncio.sleep(wait_s)
        writer.close()
        await writer.wait_closed()
        await server.close()
        return await reader.read()

    return virtual_time.run_in_virtual_time(main())


def test_a_read_and_a_write():
    assert asked(framed(b"\x04\x00\x00\x00\x01")) == framed(b"\x04\x02\x50\x4d")
    write = b"\x10\x00\x14\x00\x01\x02\x01\xf4"
    assert asked(framed(write)) == framed(b"\x10\x00\x14\x00\x01")
    assert asked(framed(b"\x06\x00\x14\x01\xf4")) == framed(b"\x06\x00\x14\x01\xf4")


def test_a_request_byte_by_byte():
    request = framed(b"\x03\x00\x02\x00\x02")
    parts = [request[i : i + 1] for i in range(len(request))]
    assert asked(*parts) == framed(b"\x03\x04\x03\xe8\x00\x01")


@pytest.mark.parametrize(
    ("pdu", "answer"),
    [
        (b"\x01\x00\x00\x00\x01", b"\x81\x01"),  # coils: there are none
        (b"\x05\x00\x00\xff\x00", b"\x85\x01"),
        (b"\x04\x00\x18\x00\x01", b"\x84\x02"),
        (b"\x03\x00\x24\x00\x01", b"\x83\x02"),
        (b"\x06\x00\x03\x00\x09", b"\x86\x03"),
        (b"\x06\x00\x02\x00\x00", b"\x86\x04"),
        (b"\x17\x01\xf4\x00\x01\x00\x14\x00\x01\x02\x00\x07", b"\x17\x02\x50\x4d"),
        (b"\x17\x01\xf4\x00\x01\x00\x03\x00\x01\x02\x00\x07", b"\x97\x03"),
    ],
)
def test_exceptions(pdu, answer):
    assert asked(framed(pdu)) == framed(answer)


@pytest.mark.parametrize("pdu", [b"\x63\x00", b"\x04\x00\x00\x00\x7e", b"\x04\x00"])
def test_nonsense_gets_an_exception_and_the_next_request_an_answer(pdu):
    answers = asked(framed(pdu), framed(b"\x04\x00\x00\x00\x01", number=2))
    assert answers.endswith(framed(b"\x04\x02\x50\x4d", number=2))
    assert len(answers) > len(framed(b"\x04\x02\x50\x4d"))


def test_another_devices_request_is_left_alone():
    assert asked(framed(b"\x04\x00\x00\x00\x01", device=6)) == b""


def crc(data: bytes) -> bytes:
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return value.to_bytes(2, "little")


def test_rtu_on_a_pty_whole_in_parts_and_with_a_wrong_checksum():
    request = b"\x05\x04\x00\x00\x00\x01"
    answer = b"\x05\x04\x02\x50\x4d"

    async def main():
        device = PmxFeederDevice(CONFIG, asyncio.get_running_loop().time)
        server = await serve_pty(device)
        path = server.endpoint.removeprefix("modbus-rtu://").partition("?")[0]
        host = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(host)

        async def reply_to(*parts: bytes) -> bytes:
            for part in parts:
                os.write(host, part)
                await asyncio.sleep(0.1)
            try:
                return os.read(host, 100)
            except BlockingIOError:
                return b""

        whole = request + crc(request)
        assert await reply_to(whole) == answer + crc(answer)
        single_bytes = (whole[i : i + 1] for i in range(len(whole)))
        assert await reply_to(*single_bytes) == answer + crc(answer)
        assert await reply_to(request + b"\0\0") == b""
        assert await reply_to(whole) == answer + crc(answer)
        os.close(host)
        await server.close()

    virtual_time.run_in_virtual_time(main())
