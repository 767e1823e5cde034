"""Byte links: what goes out when, and what is said when there is no link."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import fcntl
import os
import socket
import tty

import pytest
import serial

from lmctl.errors import ConfigError, MachineError
from lmctl.machine.motion import links
from lmctl.machine.motion.endpoint import MotionEndpoint, parse_motion_endpoint
from lmctl.machine.motion.links import ByteLink, open_link


def nothing(_: object) -> None:
    """A callback for events that a test ignores."""


@pytest.fixture
def pty():
    """Both ends of a raw pty: (near descriptor, path of the far end)."""
    near, far = os.openpty()
    tty.setraw(far)
    os.set_blocking(near, False)
    yield near, os.ttyname(far)
    os.close(far)
    os.close(near)


@pytest.mark.parametrize(
    ("text", "endpoint"),
    [
        ("tcp://127.0.0.1:2323", MotionEndpoint("tcp://127.0.0.1:2323", "tcp", "127.0.0.1", 2323)),
        ("tcp://[::1]:23", MotionEndpoint("tcp://[::1]:23", "tcp", "::1", 23)),
        ("serial:///dev/ttyUSB0",
         MotionEndpoint("serial:///dev/ttyUSB0", "serial", path="/dev/ttyUSB0")),
        ("pty:///dev/pts/3", MotionEndpoint("pty:///dev/pts/3", "pty", path="/dev/pts/3")),
    ],
)
def test_endpoints(text, endpoint):
    assert parse_motion_endpoint(text) == endpoint


@pytest.mark.parametrize(
    "text",
    ["", "tcp", "tcp://", "tcp://host", "tcp://:23", "tcp://host:x", "tcp://host:99999",
     "tcp://host:0", "tcp://host:23/path", "serial://", "serial:///", "pty:", "/dev/ttyUSB0",
     "modbus-tcp://127.0.0.1:502", "tcp://[::1:23", "\x00", "tcp://a b:-1"],
)
def test_text_that_is_no_endpoint(text):
    with pytest.raises(ConfigError) as refused:
        parse_motion_endpoint(text)
    assert "tcp://" in refused.value.hint


def test_tcp_carries_bytes_both_ways_and_says_when_it_ends(in_virtual_time):
    async def main() -> None:
        listener = socket.create_server(("127.0.0.1", 0))
        received, lost = [], []
        endpoint = f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        link = await open_link(endpoint, 0, received.append, lost.append)
        far, _ = listener.accept()
        assert far.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) == 0
        assert link._device.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        link.write(b"G1 X1\n")
        link.write_realtime(b"?")
        assert far.recv(100) == b"G1 X1\n?"
        far.sendall(b"ok\r\n")
        await asyncio.sleep(0.1)
        assert b"".join(received) == b"ok\r\n"
        far.close()
        await asyncio.sleep(0.1)
        assert lost == [f"the link {endpoint} was lost: the far end closed it"]
        link.write(b"more\n")
        link.write_realtime(b"!")
        assert link.unsent_bytes == 0
        await asyncio.sleep(0.1)
        assert len(lost) == 1
        link.close()
        listener.close()

    in_virtual_time(main())


def test_a_full_socket_keeps_the_rest_here_and_realtime_bytes_overtake_it(in_virtual_time):
    async def main() -> None:
        listener = socket.create_server(("127.0.0.1", 0))
        link = await open_link(
            f"tcp://127.0.0.1:{listener.getsockname()[1]}", 0, nothing, nothing
        )
        far, _ = listener.accept()
        far.setblocking(False)
        data = bytes(range(0x41, 0x5B)) * 1_000_000
        link.write(data)
        held = link.unsent_bytes
        assert 0 < held < len(data)
        link.write_realtime(b"!")
        link.write_realtime(b"?")
        got = bytearray()
        while len(got) < len(data) + 2:
            try:
                got += far.recv(1 << 20)
            except BlockingIOError:
                await asyncio.sleep(0)
        assert got.index(b"!?") == len(data) - held
        assert got.replace(b"!?", b"") == data
        assert link.unsent_bytes == 0
        link.close()
        far.close()
        listener.close()

    in_virtual_time(main())


@pytest.mark.parametrize("baud", [9_600, 115_200, 1_000_000])
def test_a_serial_writer_stays_a_little_ahead_of_the_wire_and_keeps_it_busy(
    in_virtual_time, pty, baud
):
    near, path = pty
    rate = baud / 10
    most_ahead = max(16, 0.005 * rate)
    data = bytes(range(0x41, 0x5B)) * 20

    async def main() -> float:
        loop = asyncio.get_running_loop()
        link = await open_link(f"serial://{path}", baud, nothing, nothing)
        start_s = loop.time()
        link.write(data[:100])
        link.write(data[100:])
        got = b""
        while len(got) < len(data):
            await asyncio.sleep(0.0001)
            with contextlib.suppress(BlockingIOError):
                got += os.read(near, 4096)
            ahead = len(got) - (loop.time() - start_s) * rate
            assert ahead <= most_ahead + 1e-6
            if len(got) < len(data):
                assert ahead >= 0  # never behind: the wire is not kept waiting
        link.close()
        assert got == data
        return loop.time() - start_s

    took_s = in_virtual_time(main())
    assert took_s <= len(data) / rate


def test_realtime_bytes_pass_the_lines_that_wait_for_a_serial_wire(in_virtual_time, pty):
    near, path = pty

    async def main() -> None:
        link = await open_link(f"serial://{path}", 115_200, nothing, nothing)
        link.write(b"G1 X1\n" * 170)  # a full window of grblHAL
        link.write_realtime(b"!")
        sent = b""
        while not sent.endswith(b"!"):  # a pty hands its bytes over a moment later
            with contextlib.suppress(BlockingIOError):
                sent += os.read(near, 4096)
        assert len(sent) <= 0.005 * 11_520 + 1
        assert link.unsent_bytes == 1020 - len(sent) + 1
        link.discard_unsent()
        link.write_realtime(b"\x18")
        await asyncio.sleep(1.0)
        assert os.read(near, 4096) == b"\x18"
        link.close()

    in_virtual_time(main())


def test_a_pty_is_not_paced(in_virtual_time, pty):
    near, path = pty

    async def main() -> None:
        link = await open_link(f"pty://{path}", 1200, nothing, nothing)
        link.write(b"G1 X1\n" * 100)
        assert link.unsent_bytes == 0
        assert len(os.read(near, 4096)) == 600
        link.close()

    in_virtual_time(main())


def test_native_usb_is_not_paced(pty, tmp_path):
    by_id = tmp_path / "usb-board-if00"
    by_id.symlink_to(tmp_path / "ttyACM0")
    assert links._is_usb_native(str(by_id))
    assert links._is_usb_native("/dev/ttyACM1")
    assert not links._is_usb_native("/dev/ttyUSB0")


def test_a_port_that_goes_away_is_a_loss(in_virtual_time):
    near, far = os.openpty()
    path = os.ttyname(far)

    async def main() -> None:
        lost = []
        link = await open_link(f"serial://{path}", 115_200, nothing, lost.append)
        os.close(near)
        await asyncio.sleep(0.1)
        assert len(lost) == 1
        assert lost[0].startswith(f"the link serial://{path} was lost: ")
        link.write(b"G1 X1\n")
        link.close()

    in_virtual_time(main())
    os.close(far)


def refusal(run, endpoint: str, baud: int = 115_200) -> MachineError:
    async def main() -> ByteLink:
        return await open_link(endpoint, baud, nothing, nothing, timeout_s=2.0)

    with pytest.raises(MachineError) as refused:
        run(main())
    assert endpoint in refused.value.where[0]
    assert refused.value.hint
    return refused.value


def test_a_port_that_is_not_there(in_virtual_time):
    assert "does not exist" in refusal(in_virtual_time, "serial:///dev/ttyNONE0").what


def test_a_port_in_use(in_virtual_time, pty):
    _, path = pty
    other = os.open(path, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    assert "in use by another program" in refusal(in_virtual_time, f"serial://{path}").what
    os.close(other)


def test_a_file_that_is_no_port(in_virtual_time, tmp_path):
    (tmp_path / "notes.txt").write_text("no port")
    error = refusal(in_virtual_time, f"serial://{tmp_path}/notes.txt")
    assert "is not a serial port" in error.what
    error = refusal(in_virtual_time, f"pty://{tmp_path}")
    assert "is not a serial port" in error.what


@pytest.mark.parametrize(
    ("number", "words"),
    [(errno.EACCES, "no permission"), (errno.EBUSY, "in use"), (errno.EIO, "is not a serial port")],
)
def test_what_the_system_answers_is_said_in_words(in_virtual_time, monkeypatch, number, words):
    def refuse(*_, **__):
        raise serial.SerialException(number, f"could not open port: {os.strerror(number)}")

    monkeypatch.setattr(serial, "Serial", refuse)
    assert words in refusal(in_virtual_time, "serial:///dev/ttyUSB0").what


def test_a_baud_rate_the_port_refuses(in_virtual_time, monkeypatch):
    def refuse(*_, **__):
        raise ValueError("Invalid baud rate: 12345")

    monkeypatch.setattr(serial, "Serial", refuse)
    error = refusal(in_virtual_time, "serial:///dev/ttyUSB0", 12_345)
    assert "Invalid baud rate" in error.what
    assert "motion.baud" in error.hint


def test_nothing_listens(in_virtual_time):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    assert "nothing listens" in refusal(in_virtual_time, f"tcp://127.0.0.1:{port}").what


@pytest.mark.parametrize(
    ("error", "words"),
    [(TimeoutError(), "did not accept a connection within 2 s"),
     (OSError(errno.EHOSTUNREACH, "No route to host"), "no route to host"),
     (socket.gaierror(-2, "Name or service not known"), "the name '127.0.0.1' is not known")],
)
def test_other_ways_a_connection_fails(in_virtual_time, monkeypatch, error, words):
    async def fail(*_):
        raise error

    monkeypatch.setattr(asyncio.SelectorEventLoop, "sock_connect", fail)
    assert words in refusal(in_virtual_time, "tcp://127.0.0.1:23").what


@pytest.mark.parametrize(
    "text", ["serial:///dev/ttyUSB0?baud=9600", "pty:///dev/pts/3?baud=9600", "tcp://h:23?baud=9600"]
)
def test_keys_behind_an_endpoint_are_refused_by_name(text):
    with pytest.raises(ConfigError, match="unknown key 'baud'") as caught:
        parse_motion_endpoint(text)
    assert "it takes no keys" in caught.value.hint
    if not text.startswith("tcp"):
        assert "baud = 9600 into [motion]" in caught.value.hint
