"""From `enable_laser(False)` to a dark beam, in the record of motion; a feed hold beside it."""

import asyncio
from importlib.resources import files

import numpy as np
import pytest

from lmctl.config.machine import SafetySettings
from lmctl.machine.safety.driver import SafetyDriver
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig
from simulators.safety.wiring import LASER_OFF_DELAY_S

TEXT = (files("lmctl.examples") / "bench.toml").read_text(encoding="utf-8")
GRBL = {'"grblhal"': '"grbl"', "10 = 511": "10 = 3", "rx_bytes = 1024": "rx_bytes = 128",
        "planner_blocks = 100": "planner_blocks = 15"}
TABLE = "\n[safety]\nwatchdog_relay = true\nlaser_enable = true\n"
STEP_S = 0.00025


def beam_off_after_s(
    dialect: str, speed_mm_s: float, stop: str, wire: str = "tcp", wait_s: float = 1.05,
    answer_s: float = 0.0,
) -> float:
    """From the stop until the beam is off, on a bead that nothing else stops.

    stop : "enable" for the output, "hold" for a feed hold alone
    wait_s : from the start to the stop; the beat is every 0.1 s
    answer_s : how long the device's answers take
    """
    text = TEXT + TABLE + ('endpoint = "pty"\n' if wire == "rtu" else "")
    for old, new in GRBL.items() if dialect == "grbl" else ():
        text = text.replace(old, new)

    async def main():
        loop = asyncio.get_running_loop()
        async with Bench(BenchConfig.parse(text), ephemeral_ports=True) as bench:
            driver = await SafetyDriver.open(SafetySettings(
                endpoint=bench.endpoints["safety"], relay_timeout_s=0.3, laser_enable=True,
            ))
            await driver.reset_watchdog_relay()
            driver.request_laser_enable(True)
            await driver.wait_for_laser_enable(True)
            if answer_s:
                bench.edges["safety"].add_filter(
                    "to_host", lambda data, deliver: loop.call_later(answer_s, deliver, data)
                )
            began_s = loop.time()
            bench.motion.receive(b"~G21G90G94\nM4S0\n")
            length_mm = 2.5 * speed_mm_s
            bench.motion.receive(b"G1X%gS800F%g\n" % (length_mm, 60.0 * speed_mm_s))
            # as far into the beat as asked for
            await asyncio.sleep(np.ceil(began_s * 10.0) / 10.0 + wait_s - loop.time())
            stopped_s = loop.time()
            if stop == "enable":
                driver.request_laser_enable(False)
                await driver.wait_for_laser_enable(False)
            else:
                bench.motion.receive(b"!")
            await asyncio.sleep(1.0)
            times = np.arange(stopped_s - 0.1, stopped_s + 0.9, STEP_S)
            beam_on = times[bench.motion.trace.sample(times).power_fraction > 0.0]
            assert beam_on[0] == times[0]
            await driver.close()
            return float(beam_on[-1] - stopped_s) + STEP_S

    return virtual_time.run_in_virtual_time(main())


dialects = pytest.mark.parametrize("dialect", ["grblhal", "grbl"])
speeds = pytest.mark.parametrize("speed_mm_s", [10.0, 100.0])


@dialects
@speeds
@pytest.mark.parametrize("wire", ["tcp", "rtu"])
def test_the_beam_is_off_as_soon_as_the_source_can_be(dialect, speed_mm_s, wire):
    for wait_s in (1.0, 1.05, 1.0999):
        dark_s = beam_off_after_s(dialect, speed_mm_s, "enable", wire, wait_s)
        assert dark_s == pytest.approx(LASER_OFF_DELAY_S, abs=2 * STEP_S)


@pytest.mark.parametrize("wire", ["tcp", "rtu"])
def test_a_request_under_way_is_waited_for_and_no_more(wire):
    # the beat has asked at 1.0 s, and its answer takes 30 ms
    for into_s in (0.001, 0.015, 0.029):
        dark_s = beam_off_after_s("grblhal", 10.0, "enable", wire, 1.0 + into_s, answer_s=0.03)
        assert dark_s == pytest.approx(0.03 - into_s + LASER_OFF_DELAY_S, abs=2 * STEP_S)
    dark_s = beam_off_after_s("grblhal", 10.0, "enable", wire, 1.04, answer_s=0.03)
    assert dark_s == pytest.approx(LASER_OFF_DELAY_S, abs=2 * STEP_S)


@dialects
@speeds
def test_a_feed_hold_alone_takes_longer(dialect, speed_mm_s):
    assert beam_off_after_s(dialect, speed_mm_s, "hold") > 2 * LASER_OFF_DELAY_S
