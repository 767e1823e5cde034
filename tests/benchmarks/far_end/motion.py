"""A motion controller behind a wire of 115,200 baud: a process of its own, in real time.

    python tests/benchmarks/far_end/motion.py grbl|grblhal|any [SECONDS [CORE]]

Prints the path of its pty, then, for each hold, when it arrived (seconds of the monotonic clock);
once its standard input is closed, one JSON object about itself. `any` takes what no Grbl would,
line numbers and checksums, and takes SECONDS to execute each line.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import selectors
import sys
import tty
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))  # also without being installed

from firmware_protocol.device import GrblDevice
from firmware_protocol.dialect import GRBL
from simulators.motion.config import MotionConfig
from simulators.motion.simulator import MotionSimulator

BAUD = 115_200
BYTES_S = BAUD / 10
WARM_LINES = 100  # not counted: the way to the start, and the first fill of the planner
# So lively a machine that the wire can be the narrowest place.
SETTINGS = {30: 1000, 32: 1, 110: 60_000, 111: 60_000, 112: 60_000, 120: 50_000, 121: 50_000,
            122: 50_000, 130: 300, 131: 300, 132: 200}


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
        first = not self._under_way
        if first:
            self._free_s = max(self._free_s, self._loop.time())
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
    """A controller that takes every line, whatever it says, once its planner has room."""

    def __init__(self, line_s: float) -> None:
        self._device = GrblDevice(GRBL)
        self._write: Callable[[bytes], None] = lambda data: None
        self._loop = asyncio.get_running_loop()
        self._line_s = line_s
        self._idle_s = 0.0  # when all lines taken so far will have been executed
        self._waiting = False

    def attach(self, write: Callable[[bytes], None]) -> None:
        self._write = write

    def receive(self, data: bytes) -> None:
        self._device.receive_data(data)
        self._go_on()

    def _go_on(self) -> None:
        while not self._waiting:
            room_s = self._idle_s - GRBL.planner_blocks * self._line_s - self._loop.time()
            if room_s > 0:
                self._waiting = True
                self._loop.call_later(room_s, self._room)
            elif self._device.pop_line() is None:
                return
            else:
                self._idle_s = max(self._idle_s, self._loop.time()) + self._line_s
                self._write(b"ok\r\n")

    def _room(self) -> None:
        self._waiting = False
        self._go_on()

    @property
    def overruns(self) -> int:
        return self._device.overruns


def be_hardware(core: int) -> bool:
    """Take a core and go first on it; whether this was allowed.

    What the controller computes is not the host's to pay for.
    """
    os.sched_setaffinity(0, [core])
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    return os.sched_getscheduler(0) == os.SCHED_FIFO


async def serve(firmware: str, line_s: float) -> dict[str, Any]:
    """Be the controller until standard input is closed."""
    near, host_side = os.openpty()
    tty.setraw(host_side)
    os.set_blocking(near, False)
    controller: MotionSimulator | Obliging
    if firmware == "any":
        controller = Obliging(line_s)
    else:
        mask = 3 if firmware == "grbl" else 511
        controller = MotionSimulator(MotionConfig(dialect=firmware, settings=SETTINGS | {10: mask}))
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
    controller.attach_client(to_host.put)
    loop = asyncio.get_running_loop()
    loop.add_reader(near, lambda: to_device.put(os.read(near, 65_536)))
    over = asyncio.Event()
    loop.add_reader(sys.stdin.fileno(), over.set)
    print(os.ttyname(host_side), flush=True)
    await over.wait()
    counted = ends[WARM_LINES:] or [(0.0, 0)]
    return {
        "overruns": controller.rx_overrun_bytes, "lines": len(counted) - 1,
        "bytes": sum(size for _, size in counted[1:]), "took_s": counted[-1][0] - counted[0][0],
    }


def main(firmware: str, line_s: str = "0", core: str | None = None) -> None:
    as_hardware = core is not None and be_hardware(int(core))

    def loop() -> asyncio.AbstractEventLoop:  # the default selector waits in whole milliseconds
        return asyncio.SelectorEventLoop(selectors.SelectSelector())

    with asyncio.Runner(loop_factory=loop) as runner:
        said = runner.run(serve(firmware, float(line_s)))
    print(json.dumps(said | {"as_hardware": as_hardware}))


if __name__ == "__main__":
    main(*sys.argv[1:])
