"""The motion wire at its limit: lines a second, and how long a hold takes to reach the wire.

The far end is a process of its own in real time: the simulated controller behind a pty that
carries 115,200 baud (11,520 bytes a second) each way, and whose receive buffer of 128 (Grbl) or
1,024 bytes (grblHAL) loses and counts what does not fit. It runs with the priority of hardware
where the system allows that. Beside lmctl, in the same run: printcore of Printrun. It sends line
numbers and checksums that no Grbl takes, so its far end answers every line at once, which favours
it. A hold is timed from the call in the host to the byte's arrival at the far end, while lines
stream; busy means two spinning processes for each core.

A million lines by TCP, in virtual time, show that no byte is lost.

Prints one JSON object. --lines N shortens that last row, --holds N the others.

    pip install --no-deps printrun      # its own dependencies are a graphical user interface
    python tests/benchmarks/streaming.py
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import logging
import os
import random
import re
import selectors
import subprocess
import sys
import threading
import time
import tty
from collections import deque
from collections.abc import Callable, Iterator
from itertools import count, islice
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # also without being installed

from firmware_protocol.device import GrblDevice
from firmware_protocol.dialect import GRBL
from lmctl.machine.motion import MotionDriver, MotionListener
from simulators import virtual_time
from simulators.motion.config import MotionConfig
from simulators.motion.server import serve_tcp
from simulators.motion.sim import MotionSim

BAUD = 115_200
BYTES_S = BAUD / 10
RX = {"grbl": 128, "grblhal": 1024}
RATE_LINES = 4000
WARM_LINES = 100  # not counted: the way to the start, and the first fill of the planner
SPINNERS_PER_CORE = 2
# So lively a machine that the wire is the narrowest place: 0.05 mm at 100 mm/s take 0.5 ms.
SETTINGS = {30: 1000, 32: 1, 110: 60_000, 111: 60_000, 112: 60_000, 120: 50_000, 121: 50_000,
            122: 50_000, 130: 300, 131: 300, 132: 200}


def main() -> None:
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--lines", type=int, default=1_000_000)
    options.add_argument("--holds", type=int, default=200)
    options.add_argument("--far-end", help=argparse.SUPPRESS)
    chosen = options.parse_args()
    if chosen.far_end:
        far_end(chosen.far_end)
        return
    # What else runs here: above one, the idle rows are not idle.
    found: dict[str, Any] = {"load_average_before": round(os.getloadavg()[0], 2)}
    overruns = 0
    for firmware, rx_bytes in RX.items():
        with FarEnd(firmware) as far:
            asyncio.run(stream(far, RATE_LINES))
        found[f"rate_over_limit_{rx_bytes}"] = round(far.rate_over_limit, 4)
        found[f"lines_s_{rx_bytes}"] = round(far.lines_s, 1)
        overruns += far.said["overruns"]
    for load in ("idle", "busy"):
        with spinning(SPINNERS_PER_CORE * (os.cpu_count() or 1) if load == "busy" else 0):
            took = []
            for firmware, rx_bytes in RX.items():
                with FarEnd(firmware) as far:
                    took += asyncio.run(stream_and_hold(far, chosen.holds // 2))
                found[f"hold_p99_ms_{load}_{rx_bytes}"] = p99_ms(took[-(chosen.holds // 2) :])
                overruns += far.said["overruns"]
            found[f"hold_p99_ms_{load}"] = p99_ms(took)
            found[f"hold_median_ms_{load}"] = round(1e3 * float(np.median(took)), 2)
            found |= printcore_figures(load, chosen.holds)
    if "printcore_hold_p99_ms_busy" in found:
        found["hold_p99_vs_printcore_busy"] = round(
            found["hold_p99_ms_busy"] / found["printcore_hold_p99_ms_busy"], 4
        )
    found["hardware_priority"] = far.said["hardware_priority"]
    begun_s = time.perf_counter()
    found["overruns"] = overruns + virtual_time.run(lines_by_tcp(chosen.lines))
    found["tcp_lines"] = chosen.lines
    found["tcp_lines_s"] = round(chosen.lines / (time.perf_counter() - begun_s))
    print(json.dumps(found, indent=2))


def p99_ms(took_s: list[float]) -> float:
    return round(1e3 * float(np.percentile(took_s, 99, method="higher")), 2)


def program() -> Iterator[bytes]:
    """Lines of some 25 bytes up and down one axis, without end."""
    for number in count():
        step = number % 3000
        x_mm = 10 + 0.05 * min(step, 3000 - step)
        yield b"N%d G1 X%.3f Y5.000" % (number % 10_000_000, x_mm)


@contextlib.contextmanager
def spinning(processes: int) -> Iterator[None]:
    """So many processes that do nothing else than load the cores."""
    spinners = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(processes)
    ]
    try:
        yield
    finally:
        for spinner in spinners:
            spinner.kill()
            spinner.wait()


# lmctl as the host -------------------------------------------------------------------------------


async def stream(far: FarEnd, lines: int) -> None:
    """Send lines as fast as they go, to the last answer."""
    driver = await open_driver(f"serial://{far.path}")
    done = asyncio.Event()
    driver.listener = MotionListener(
        on_progress=lambda: done.set() if driver.acknowledged == lines + 1 else None
    )
    driver.submit([b"G21 G90 G94 F6000", *islice(program(), lines)])
    await asyncio.wait_for(done.wait(), 60.0)
    await driver.close()


async def stream_and_hold(far: FarEnd, holds: int) -> list[float]:
    """Hold and resume a stream at random moments; seconds from each call to the wire."""
    driver = await open_driver(f"serial://{far.path}")
    source = program()

    def refill() -> None:
        if driver.queued < 100:
            driver.submit(islice(source, 200))

    driver.submit([b"G21 G90 G94 F6000"])
    driver.listener = MotionListener(on_progress=refill)
    refill()
    took, chance = [], random.Random(1)
    for _ in range(holds):
        await asyncio.sleep(chance.uniform(0.1, 0.2))
        called_s = time.monotonic()
        await driver.hold(seen_within_s=5.0)
        took.append(far.hold_arrival_s() - called_s)
        await driver.resume()
    await driver.close()
    return took


async def open_driver(endpoint: str) -> MotionDriver:
    return await MotionDriver.open(endpoint, baud=BAUD, status_period_s=0.2)


async def lines_by_tcp(lines: int) -> int:
    """Stream lines to a simulated grblHAL by TCP; the bytes that it lost. In virtual time."""
    sim = MotionSim(MotionConfig(dialect="grblhal", settings=SETTINGS | {10: 511}))
    server = await serve_tcp(sim)
    driver = await open_driver(f"tcp://127.0.0.1:{server.port}")
    source, done = islice(program(), lines), asyncio.Event()

    def refill() -> None:
        if driver.queued < 500:
            driver.submit(islice(source, 1000))
        if driver.acknowledged == lines + 1:
            done.set()

    driver.listener = MotionListener(on_progress=refill)
    driver.submit([b"G21 G90 G94 F6000"])
    await done.wait()
    await driver.close()
    server.close()
    sim.close()
    await asyncio.sleep(0)
    return sim.overruns


# printcore as the host ---------------------------------------------------------------------------


def printcore_figures(load: str, holds: int) -> dict[str, Any]:
    try:
        from printrun import gcoder
        from printrun.printcore import printcore
    except ImportError as missing:
        print(f"{missing}: pip install --no-deps printrun, for its rows", file=sys.stderr)
        return {}
    logging.disable()  # it says on the log what it cannot analyse
    found = {}
    with FarEnd("any") as far:
        core = printcore(far.path, BAUD)
        wait_until(lambda: core.online)
        text = [line.partition(b" ")[2].decode() for line in islice(program(), RATE_LINES)]
        core.startprint(gcoder.LightGCode(text))
        wait_until(lambda: not core.printing)
        leave(core)
    found[f"printcore_lines_s_{load}"] = round(far.lines_s, 1)
    with FarEnd("any") as far:
        core = printcore(far.path, BAUD)
        wait_until(lambda: core.online)
        core.startprint(gcoder.LightGCode(text * (holds // 20 + 1)))
        took, chance = [], random.Random(1)
        for _ in range(holds):
            time.sleep(chance.uniform(0.1, 0.2))
            called_s = time.monotonic()
            core.send_now("!")
            took.append(far.hold_arrival_s() - called_s)
        still = core.printing
        core.cancelprint()
        leave(core)
    assert still, "printcore ran out of lines"
    found[f"printcore_hold_p99_ms_{load}"] = p99_ms(took)
    found[f"printcore_hold_median_ms_{load}"] = round(1e3 * float(np.median(took)), 2)
    return found


def leave(core: Any) -> None:
    wait_until(lambda: core.print_thread is None and core.send_thread is not None
               and core.send_thread.is_alive())
    core.disconnect()


def wait_until(condition: Callable[[], bool], deadline_s: float = 120.0) -> None:
    end_s = time.monotonic() + deadline_s
    while not condition():
        if time.monotonic() > end_s:
            raise TimeoutError
        time.sleep(0.01)


# the far end -------------------------------------------------------------------------------------


class FarEnd:
    """The far end's process, for a `with`.

    path : the pty for the host; said : what it says of itself at the end
    """

    def __init__(self, firmware: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, __file__, "--far-end", firmware],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )
        assert self._process.stdout is not None
        self._out = self._process.stdout
        self.path = self._out.readline().strip()
        self.said: dict[str, Any] = {}

    def hold_arrival_s(self) -> float:
        """When the next hold was on the wire, on the clock all processes share."""
        return float(self._out.readline())

    def __enter__(self) -> FarEnd:
        return self

    def __exit__(self, *_: object) -> None:
        out, _ = self._process.communicate()
        self.said = json.loads(out.strip().splitlines()[-1])

    @property
    def lines_s(self) -> float:
        """Lines a second, the first of all left out."""
        return float(self.said["lines"] / self.said["took_s"])

    @property
    def rate_over_limit(self) -> float:
        """Those, over what the wire could carry of lines of that length."""
        return self.lines_s / (BYTES_S * self.said["lines"] / self.said["bytes"])


class Wire:
    """One direction: bytes put in come out whole pieces at a time, when the last has passed.

    deliver(piece, arrival_s)
    """

    _PIECES = re.compile(rb"[^\n!?~]*[\n!?~]|[^\n!?~]+")

    def __init__(self, deliver: Callable[[bytes, float], None]) -> None:
        self._loop = asyncio.get_running_loop()
        self._deliver = deliver
        self._under_way: deque[tuple[float, bytes]] = deque()
        self._free_s = 0.0

    def put(self, data: bytes) -> None:
        if not self._under_way:
            self._free_s = max(self._free_s, self._loop.time())
        first = not self._under_way
        for piece in self._PIECES.findall(data):
            self._free_s += len(piece) / BYTES_S
            self._under_way.append((self._free_s, piece))
        if first and self._under_way:
            self._loop.call_at(self._under_way[0][0], self._due)

    def _due(self) -> None:
        while self._under_way and self._under_way[0][0] <= self._loop.time():
            arrival_s, piece = self._under_way.popleft()
            self._deliver(piece, arrival_s)
        if self._under_way:
            self._loop.call_at(self._under_way[0][0], self._due)


class Obliging:
    """A controller that answers every line at once, whatever it says."""

    def __init__(self) -> None:
        self._device = GrblDevice(GRBL)
        self._write: Callable[[bytes], None] = lambda data: None

    def attach(self, write: Callable[[bytes], None]) -> None:
        self._write = write

    def receive(self, data: bytes) -> None:
        self._device.receive_data(data)
        while self._device.take_line() is not None:
            self._write(b"ok\r\n")

    @property
    def overruns(self) -> int:
        return self._device.overruns


def far_end(firmware: str) -> None:
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    # The default selector rounds waiting up to a millisecond.
    def loop() -> asyncio.AbstractEventLoop:
        return asyncio.SelectorEventLoop(selectors.SelectSelector())

    with asyncio.Runner(loop_factory=loop) as runner:
        said = runner.run(serve(firmware))
    said["hardware_priority"] = os.sched_getscheduler(0) == os.SCHED_FIFO
    print(json.dumps(said))


async def serve(firmware: str) -> dict[str, Any]:
    """Be the controller until standard input is closed."""
    near, host_side = os.openpty()
    tty.setraw(host_side)
    os.set_blocking(near, False)
    controller: MotionSim | Obliging = Obliging()
    if firmware != "any":
        mask = 3 if firmware == "grbl" else 511
        controller = MotionSim(MotionConfig(dialect=firmware, settings=SETTINGS | {10: mask}))
    ends: list[tuple[float, int]] = []  # when each program line had arrived, and its bytes
    begun = b""  # of a line that a real-time byte or a write cut in two

    def arrived(piece: bytes, arrival_s: float) -> None:
        nonlocal begun
        if piece.endswith(b"!"):
            print(arrival_s, flush=True)
        begun += piece.rstrip(b"!?~")
        if begun.endswith(b"\n"):
            if begun.startswith(b"N"):
                ends.append((arrival_s, len(begun)))
            begun = b""
        controller.receive(piece)

    to_device = Wire(arrived)

    def answer(piece: bytes, _: float) -> None:
        os.write(near, piece)

    to_host = Wire(answer)
    controller.attach(to_host.put)
    loop = asyncio.get_running_loop()
    loop.add_reader(near, lambda: to_device.put(os.read(near, 65_536)))
    over = asyncio.Event()
    loop.add_reader(sys.stdin.fileno(), over.set)
    print(os.ttyname(host_side), flush=True)
    await over.wait()
    counted = ends[WARM_LINES:] or [(0.0, 0)]
    return {
        "overruns": controller.overruns, "lines": len(counted) - 1,
        "bytes": sum(size for _, size in counted[1:]), "took_s": counted[-1][0] - counted[0][0],
    }


if __name__ == "__main__":
    threading.current_thread().name = "streaming"
    main()
