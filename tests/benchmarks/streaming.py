"""The motion wire at its limit: lines a second, and how long a hold takes to reach the wire.

The far end is a process of its own in real time: the simulated controller behind a pty that
carries 115,200 baud (11,520 bytes a second) each way, and whose receive buffer of 128 (Grbl) or
1,024 bytes (grblHAL) loses and counts what does not fit. As hardware would, it has a core of its
own where there are two, and goes before everything else where the system allows that; the host and
what loads it share the other cores. Beside lmctl, in the same run: printcore of Printrun. It sends
line numbers and checksums that no Grbl takes, so its far end answers every line that finds room in
a planner of Grbl's size.

A hold is timed from the call in the host to the byte's arrival at the far end, while lines stream:

- `hold_...`: while beads are laid, 0.5 mm at 10 mm/s. The planner is full, and answers come as
  lines are executed; this is when holds are called for.
- `hold_full_wire_...`: while lines are executed faster than the wire can bring them.

Busy means two spinning processes for each core of the host. A million lines by TCP, in virtual
time, show that no byte is lost.

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
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count, islice
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # also without being installed

from lmctl.machine.motion.driver import MotionCallbacks, MotionDriver
from simulators import virtual_time
from simulators.motion.config import MotionConfig
from simulators.motion.server import serve_tcp
from simulators.motion.simulator import MotionSimulator
from tests.benchmarks.far_end.motion import BAUD, BYTES_S, SETTINGS

FAR_END = Path(__file__).parent / "far_end" / "motion.py"
CORES = sorted(os.sched_getaffinity(0))
FAR_CORES = CORES[-1:] if len(CORES) > 1 else []
RX = {"grbl": 128, "grblhal": 1024}
RATE_LINES = 4000
SPINNERS_PER_CORE = 2
PLANNER_LINES = 16
PRINTCORE_LINES_S = 400  # more than it sends


@dataclass(frozen=True)
class Program:
    """Lines of some 25 bytes up and down one axis, without end."""

    step_mm: float
    speed_mm_s: float

    @property
    def line_s(self) -> float:
        return self.step_mm / self.speed_mm_s

    @property
    def head(self) -> bytes:
        return b"G21 G90 G94 F%d" % (60 * self.speed_mm_s)

    def lines(self) -> Iterator[bytes]:
        for number in count():
            step = number % 300
            x_mm = 10 + self.step_mm * min(step, 300 - step)
            yield b"N%d G1 X%.3f Y5.000" % (number % 10_000_000, x_mm)


FULL_WIRE = Program(step_mm=0.05, speed_mm_s=100.0)  # the wire is the narrowest place
BEADS = Program(step_mm=0.5, speed_mm_s=10.0)


def main() -> None:
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--lines", type=int, default=1_000_000)
    options.add_argument("--holds", type=int, default=200)
    chosen = options.parse_args()
    leave_a_core_to_the_far_end()
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
        with spinning(SPINNERS_PER_CORE * len(os.sched_getaffinity(0)) if load == "busy" else 0):
            for program, name in ((BEADS, "hold"), (FULL_WIRE, "hold_full_wire")):
                took: list[float] = []
                for firmware, rx_bytes in RX.items():
                    with FarEnd(firmware) as far:
                        took += asyncio.run(stream_and_hold(far, program, chosen.holds // 2))
                    of_one = took[-(chosen.holds // 2) :]
                    found[f"{name}_p99_ms_{load}_{rx_bytes}"] = p99_ms(of_one)
                    overruns += far.said["overruns"]
                found[f"{name}_p99_ms_{load}"] = p99_ms(took)
                found[f"{name}_median_ms_{load}"] = round(1e3 * float(np.median(took)), 2)
                if printcore_holds_s := printcore_hold(program, chosen.holds):
                    found[f"printcore_{name}_p99_ms_{load}"] = p99_ms(printcore_holds_s)
                    found[f"printcore_{name}_median_ms_{load}"] = round(
                        1e3 * float(np.median(printcore_holds_s)), 2)
                    found[f"{name}_p99_vs_printcore_{load}"] = round(
                        p99_ms(took) / p99_ms(printcore_holds_s), 4)
    found["far_end_as_hardware"] = far.said["as_hardware"]
    begun_s = time.perf_counter()
    found["overruns"] = overruns + virtual_time.run_in_virtual_time(lines_by_tcp(chosen.lines))
    found["tcp_lines"] = chosen.lines
    found["tcp_lines_s"] = round(chosen.lines / (time.perf_counter() - begun_s))
    print(json.dumps(found, indent=2))


def leave_a_core_to_the_far_end() -> None:
    """Keep this process, and the load it starts, off the core that the far end takes."""
    if FAR_CORES:
        os.sched_setaffinity(0, os.sched_getaffinity(0) - set(FAR_CORES))


def p99_ms(took_s: list[float]) -> float:
    return round(1e3 * float(np.percentile(took_s, 99, method="higher")), 2)


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
    driver.listener = MotionCallbacks(
        on_progress=lambda: done.set() if driver.lines_acknowledged == lines + 1 else None
    )
    driver.submit([FULL_WIRE.head, *islice(FULL_WIRE.lines(), lines)])
    await asyncio.wait_for(done.wait(), 60.0)
    await driver.close()


async def stream_and_hold(far: FarEnd, program: Program, holds: int) -> list[float]:
    """Hold and resume a stream at random moments; seconds from each call to the wire."""
    driver = await open_driver(f"serial://{far.path}")
    source = program.lines()

    def refill() -> None:
        if driver.lines_queued < 100:
            driver.submit(islice(source, 200))

    driver.submit([program.head])
    driver.listener = MotionCallbacks(on_progress=refill)
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
    sim = MotionSimulator(MotionConfig(dialect="grblhal", settings=SETTINGS | {10: 511}))
    server = await serve_tcp(sim)
    driver = await open_driver(f"tcp://127.0.0.1:{server.port}")
    source, done = islice(FULL_WIRE.lines(), lines), asyncio.Event()

    def refill() -> None:
        if driver.lines_queued < 500:
            driver.submit(islice(source, 1000))
        if driver.lines_acknowledged == lines + 1:
            done.set()

    driver.listener = MotionCallbacks(on_progress=refill)
    driver.submit([FULL_WIRE.head])
    await done.wait()
    await driver.close()
    server.close()
    sim.close()
    await asyncio.sleep(0)
    return sim.rx_overrun_bytes


# printcore as the host ---------------------------------------------------------------------------


def printcore_hold(program: Program, holds: int) -> list[float]:
    """The same with printcore, which sends a hold as a line before others; empty without it."""
    try:
        from printrun import gcoder
        from printrun.printcore import printcore
    except ImportError as missing:
        print(f"{missing}: pip install --no-deps printrun, for its rows", file=sys.stderr)
        return []
    logging.disable()  # it says on the log what it cannot analyse
    with FarEnd("any", program.line_s) as far:
        core = printcore(far.path, BAUD)
        wait_until(lambda: core.online)
        lines = int(0.4 * holds / max(program.line_s, 1 / PRINTCORE_LINES_S)) + 1000
        text = [line.partition(b" ")[2].decode() for line in islice(program.lines(), lines)]
        core.startprint(gcoder.LightGCode(text))
        took, chance = [], random.Random(1)
        time.sleep(3 * PLANNER_LINES * program.line_s)  # until the planner is full
        for _ in range(holds):
            time.sleep(chance.uniform(0.1, 0.2))
            called_s = time.monotonic()
            core.send_now("!")
            took.append(far.hold_arrival_s() - called_s)
        still = core.printing
        core.cancelprint()
        wait_until(lambda: core.print_thread is None and core.send_thread is not None
                   and core.send_thread.is_alive())
        core.disconnect()
    assert still, "printcore ran out of lines"
    return took


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

    def __init__(self, firmware: str, line_s: float = 0.0) -> None:
        self._process = subprocess.Popen(
            [sys.executable, FAR_END, firmware, str(line_s), *map(str, FAR_CORES)],
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


if __name__ == "__main__":
    main()
