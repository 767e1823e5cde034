"""The simulated controller behind its wires, on virtual time."""

import asyncio
import os
import tty
from collections import deque

import pytest

from simulators import virtual_time
from simulators.motion.config import MotionConfig
from simulators.motion.server import open_pty, serve_tcp
from simulators.motion.simulator import MotionSimulator

LASER_CELL = {30: 1000, 32: 1, 110: 6000, 111: 6000, 112: 6000, 120: 500, 121: 500, 122: 500}
BOTH = pytest.mark.parametrize("dialect", ["grbl", "grblhal"])


def sim_of(dialect="grblhal", **more):
    return MotionSimulator(MotionConfig(dialect=dialect, settings=LASER_CELL, **more))


def zigzag(count):
    return [f"N{k} G1 X{k * 0.3:.3f} Y{k % 2} F1800 S500\n".encode() for k in range(1, count + 1)]


async def stream(reader, writer, lines, window):
    """Send lines by character counting; the answers."""
    waiting, used, answers, rest = deque(), 0, [], b""
    left = deque(lines)
    while left or waiting:
        batch = b""
        while left and used + len(left[0]) <= window:
            waiting.append(len(left[0]))
            used += len(left[0])
            batch += left.popleft()
        if batch:
            writer(batch)
        *whole, rest = (rest + await reader()).split(b"\r\n")
        for answer in whole:
            answers.append(answer)
            used -= waiting.popleft()
    return answers


async def tcp_job(dialect, count):
    loop = asyncio.get_running_loop()
    sim = sim_of(dialect)
    server = await serve_tcp(sim)
    reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
    window = 127 if dialect == "grbl" else 1023
    lines = [b"M4 S0\n", *zigzag(count)]
    answers = await stream(lambda: reader.read(4096), writer.write, lines, window)
    acknowledged_s = loop.time()
    early = len(sim.executed_line_numbers)
    await asyncio.sleep(60.0)
    blocks = sim.trace.blocks()
    result = (
        answers, acknowledged_s, early, sim.executed_line_numbers, sim.rx_overrun_bytes,
        sim.position_mm,
        blocks.end_s.tolist(), blocks.start_s.tolist(),
    )  # fmt: skip
    writer.close()
    await writer.wait_closed()
    server.close()
    sim.close()
    return result


@BOTH
def test_a_streamed_job_is_executed_once_in_order_and_the_same_every_time(dialect):
    first = virtual_time.run_in_virtual_time(tcp_job(dialect, 300))
    answers, acknowledged_s, early, executed, overruns, position_mm, ends_s, _ = first
    assert answers == [b"ok"] * 301
    assert executed == list(range(1, 301))
    assert overruns == 0
    assert position_mm == pytest.approx((90.0, 0.0, 0.0))
    assert early < 300  # ok is not executed
    assert acknowledged_s < ends_s[-1]
    assert virtual_time.run_in_virtual_time(tcp_job(dialect, 300)) == first


@BOTH
def test_a_pty_carries_a_job_too(dialect):
    async def main():
        loop = asyncio.get_running_loop()
        sim = sim_of(dialect)
        pty = open_pty(sim)
        port = os.open(pty.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(port)
        arrived = asyncio.Queue()
        loop.add_reader(port, lambda: arrived.put_nowait(os.read(port, 4096)))
        window = 127 if dialect == "grbl" else 1023
        answers = await stream(arrived.get, lambda data: os.write(port, data), zigzag(200), window)
        await asyncio.sleep(60.0)
        loop.remove_reader(port)
        os.close(port)
        executed = sim.executed_line_numbers
        pty.close()
        sim.close()
        return answers, executed

    answers, executed = virtual_time.run_in_virtual_time(main())
    assert answers == [b"ok"] * 200
    assert executed == list(range(1, 201))


def test_a_client_may_leave_and_motion_goes_on():
    async def main():
        sim = sim_of()
        server = await serve_tcp(sim)
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(b"G1 X10 F600\n")
        assert await reader.readline() == b"ok\r\n"
        writer.close()
        await writer.wait_closed()
        await asyncio.sleep(10.0)
        assert sim.position_mm == (10.0, 0.0, 0.0)
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(b"?")
        report = await reader.readline()
        writer.close()
        await writer.wait_closed()
        server.close()
        sim.close()
        return report

    assert virtual_time.run_in_virtual_time(main()).startswith(b"<Idle|MPos:10.000,0.000,0.000|")


def test_a_second_client_is_turned_away():
    async def main():
        sim = sim_of()
        server = await serve_tcp(sim)
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(b"\n")
        await reader.readline()
        other, other_writer = await asyncio.open_connection("127.0.0.1", server.port)
        assert await other.read() == b""
        other_writer.close()
        writer.write(b"\n")
        answer = await reader.readline()
        writer.close()
        await writer.wait_closed()
        server.close()
        sim.close()
        return answer

    assert virtual_time.run_in_virtual_time(main()) == b"ok\r\n"


def test_answers_of_one_instant_come_in_one_piece():
    async def main():
        sim = sim_of()
        written = []
        sim.attach_client(written.append)
        sim.receive(b"G0 X1\nG0 X2\n\n$G\n")
        sim.close()
        return written

    (data,) = virtual_time.run_in_virtual_time(main())
    assert data.count(b"ok\r\n") == 4


def test_the_door_input_stops_a_job_without_a_host():
    async def main():
        sim = sim_of()
        sim.receive(b"M4 S500\nG1 X100 F600\n")
        await asyncio.sleep(1.0)
        sim.set_door(True)
        await asyncio.sleep(5.0)
        x, _, _ = sim.position_mm
        sim.close()
        return x, sim.trace.sample([0.5, 5.0]).power_fraction.tolist()

    x, power = virtual_time.run_in_virtual_time(main())
    assert 9.0 < x < 12.0
    assert power == [0.5, 0.0]


def test_the_record_is_true_in_the_middle_of_a_long_move():
    async def main():
        sim = sim_of()
        sim.receive(b"G1 X100 F600\n")
        await asyncio.sleep(3.0)
        sample = sim.trace.sample([2.5])
        unfinished = sim.trace.blocks().is_complete.tolist()
        sim.close()
        return sample.position_mm[0, 0], sample.speed_mm_s[0], unfinished, sim.executed_line_numbers

    x, speed, complete, executed = virtual_time.run_in_virtual_time(main())
    assert (x, speed) == (pytest.approx(24.9), 10.0)
    assert (complete, executed) == ([False], [])
