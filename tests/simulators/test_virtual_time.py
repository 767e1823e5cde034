import asyncio
import os
import signal
import socket
import threading
import time
import tty

import pytest

from simulators import virtual_time
from simulators.virtual_time import DeadlockError, VirtualTimeLoop

TICK_S = 1.0 / 1024.0  # a binary fraction: its multiples are exact, so durations compare with ==


def test_the_clock_starts_at_zero_and_hours_take_no_time():
    async def main() -> tuple[float, float]:
        loop = asyncio.get_running_loop()
        start_s = loop.time()
        await asyncio.sleep(30 * 24 * 3600.0)
        return start_s, loop.time()

    began = time.monotonic()
    assert virtual_time.run_in_virtual_time(main()) == (0.0, 30 * 24 * 3600.0)
    assert time.monotonic() - began < 1.0


@pytest.mark.parametrize("origin_s", [0.0, 0.1, 12345.678, 3.1e7, 1e12])
def test_a_jump_lands_on_the_timer_and_fires_only_what_is_due(origin_s):
    async def main() -> list[tuple[str, float]]:
        loop = asyncio.get_running_loop()
        await asyncio.sleep(origin_s)
        fired: list[tuple[str, float]] = []
        first_s = loop.time() + 0.3
        later_s = (first_s + 1e-3) if first_s + 1e-3 > first_s else first_s * (1 + 1e-15)
        done = asyncio.Event()
        loop.call_at(later_s, lambda: (fired.append(("later", loop.time())), done.set()))
        loop.call_at(first_s, lambda: fired.append(("first", loop.time())))
        loop.call_at(first_s, lambda: fired.append(("also first", loop.time())))
        await done.wait()
        assert fired == [("first", first_s), ("also first", first_s), ("later", later_s)]
        return fired

    assert len(virtual_time.run_in_virtual_time(main())) == 3


def test_many_tiny_timers_neither_spin_nor_drift():
    turns = 0

    async def main() -> float:
        nonlocal turns
        loop = asyncio.get_running_loop()
        due_s = 1.0e5
        await asyncio.sleep(due_s)
        for step in range(1, 1001):
            reached = loop.create_future()
            loop.call_at(due_s + step * 1e-10, reached.set_result, None)
            await reached
            turns += 1
        return loop.time()

    assert virtual_time.run_in_virtual_time(main()) == 1.0e5 + 1000 * 1e-10
    assert turns == 1000


def test_waiting_for_nothing_is_a_deadlock_and_cleanup_still_runs():
    cleaned = []

    async def main() -> None:
        try:
            await asyncio.sleep(1.5)
            await asyncio.Event().wait()
        finally:
            await asyncio.sleep(2.0)
            cleaned.append(asyncio.get_running_loop().time())

    with pytest.raises(DeadlockError, match=r"no byte, timer or thread job.*1\.500000 s"):
        virtual_time.run_in_virtual_time(main())
    assert cleaned == [3.5]


def test_a_connected_but_silent_socket_is_a_deadlock_too():
    async def main() -> None:
        left, right = socket.socketpair()
        with left, right:
            left.setblocking(False)
            await asyncio.get_running_loop().sock_recv(left, 1)

    with pytest.raises(DeadlockError):
        virtual_time.run_in_virtual_time(main())


def test_the_clock_stands_still_while_a_thread_works():
    async def main() -> tuple[str, float, bool]:
        loop = asyncio.get_running_loop()
        release = threading.Event()
        overtaken = []
        loop.call_later(5.0, overtaken.append, True)
        loop.call_soon(lambda: threading.Timer(0.05, release.set).start())

        def job() -> str:
            release.wait()
            return "done"

        result = await loop.run_in_executor(None, job)
        return result, loop.time(), bool(overtaken)

    assert virtual_time.run_in_virtual_time(main()) == ("done", 0.0, False)


def test_a_failing_thread_job_starts_the_clock_again():
    async def main() -> float:
        loop = asyncio.get_running_loop()
        with pytest.raises(ZeroDivisionError):
            await loop.run_in_executor(None, lambda: 1 // 0)
        await asyncio.sleep(1.0)
        return loop.time()

    assert virtual_time.run_in_virtual_time(main()) == 1.0


def test_name_resolution_does_not_move_the_clock():
    async def main() -> float:
        loop = asyncio.get_running_loop()
        loop.call_later(60.0, lambda: None)
        await loop.getaddrinfo("localhost", 80)
        return loop.time()

    assert virtual_time.run_in_virtual_time(main()) == 0.0


async def _echo_after_a_tick(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while byte := await reader.read(1):
        await asyncio.sleep(TICK_S)
        writer.write(byte)
    writer.close()


def test_tcp_bytes_in_flight_are_never_jumped_over():
    rounds = 2000

    async def main() -> float:
        loop = asyncio.get_running_loop()
        server = await asyncio.start_server(_echo_after_a_tick, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        for _ in range(rounds):
            writer.write(b"x")
            assert await asyncio.wait_for(reader.readexactly(1), 2 * TICK_S) == b"x"
        writer.close()
        assert await reader.read() == b""
        await writer.wait_closed()
        server.close()
        return loop.time()

    assert virtual_time.run_in_virtual_time(main()) == rounds * TICK_S


def test_pty_bytes_in_flight_are_never_jumped_over():
    rounds = 4000

    async def main() -> float:
        loop = asyncio.get_running_loop()
        master, slave = os.openpty()
        tty.setraw(master)
        tty.setraw(slave)
        answers: asyncio.Queue[bytes] = asyncio.Queue()

        def request_arrived() -> None:
            byte = os.read(master, 64)
            loop.call_later(TICK_S, os.write, master, byte)

        loop.add_reader(master, request_arrived)
        loop.add_reader(slave, lambda: answers.put_nowait(os.read(slave, 64)))
        for _ in range(rounds):
            os.write(slave, b"x")
            assert await asyncio.wait_for(answers.get(), 2 * TICK_S) == b"x"
        loop.remove_reader(master)
        loop.remove_reader(slave)
        os.close(master)
        os.close(slave)
        return loop.time()

    assert virtual_time.run_in_virtual_time(main()) == rounds * TICK_S


def test_interrupt_cancels_main_and_runs_its_cleanup():
    cleaned = []

    async def main() -> None:
        loop = asyncio.get_running_loop()
        loop.call_later(2.0, os.kill, os.getpid(), signal.SIGINT)
        loop.call_later(1e9, lambda: None)
        try:
            await asyncio.Event().wait()
        finally:
            await asyncio.sleep(1.0)
            cleaned.append(loop.time())

    with pytest.raises(KeyboardInterrupt):
        virtual_time.run_in_virtual_time(main())
    assert cleaned == [3.0]


def test_interrupt_reaches_a_loop_that_waits_for_a_thread():
    async def main() -> None:
        loop = asyncio.get_running_loop()
        release = threading.Event()
        threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT)).start()
        try:
            await loop.run_in_executor(None, release.wait)
        finally:
            release.set()

    with pytest.raises(KeyboardInterrupt):
        virtual_time.run_in_virtual_time(main())


def test_speed_paces_the_clock_and_jumps_still_land_exactly():
    async def main() -> float:
        for _ in range(10):
            await asyncio.sleep(TICK_S * 16)
        return asyncio.get_running_loop().time()

    began = time.monotonic()
    assert virtual_time.run_in_virtual_time(main(), speed=2.0) == 10 * TICK_S * 16
    assert 0.07 < time.monotonic() - began < 0.5


def test_paced_idling_waits_for_outside_bytes():
    async def main() -> float:
        loop = asyncio.get_running_loop()
        left, right = socket.socketpair()
        with left, right:
            left.setblocking(False)
            threading.Timer(0.05, right.send, (b"x",)).start()
            assert await loop.sock_recv(left, 1) == b"x"
        return loop.time()

    assert 0.04 < virtual_time.run_in_virtual_time(main(), speed=1.0) < 1.0


def test_each_run_has_its_own_clock_and_closes_its_loop():
    loops = []

    async def main() -> float:
        loops.append(asyncio.get_running_loop())
        await asyncio.sleep(1.0)
        return loops[-1].time()

    assert [virtual_time.run_in_virtual_time(main()),
            virtual_time.run_in_virtual_time(main())] == [1.0, 1.0]
    assert all(loop.is_closed() for loop in loops)


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan")])
def test_a_speed_that_is_no_speed_is_refused(speed):
    with pytest.raises(ValueError, match="speed must be above 0"):
        VirtualTimeLoop(speed)
    with pytest.raises(ValueError, match="speed must be above 0"):
        virtual_time.run_in_virtual_time(asyncio.sleep(1.0), speed=speed)
