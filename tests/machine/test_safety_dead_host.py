"""A host that dies while the beam is on: how soon the watchdog relay makes it dark."""

import asyncio
from importlib.resources import files

import numpy as np
import pytest

from lmctl.config.machine import SafetySettings
from lmctl.machine.safety.driver import SafetyDriver
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig

TEXT = (files("lmctl.examples") / "bench.toml").read_text(encoding="utf-8")
GRBL = {'"grblhal"': '"grbl"', "10 = 511": "10 = 3", "rx_bytes = 1024": "rx_bytes = 128",
        "planner_blocks = 100": "planner_blocks = 15"}


def beam_off_after_s(dialect: str, laser_circuit: bool, died_s: float) -> float:
    """From the host's death until the beam is off, on a bead of 10 mm/s that nothing else stops."""
    text = TEXT
    for old, new in GRBL.items() if dialect == "grbl" else ():
        text = text.replace(old, new)
    circuit = str(laser_circuit).lower()
    text += f"\n[safety]\nwatchdog_relay = true\nlaser_circuit = {circuit}\n"

    async def main():
        async with Bench(BenchConfig.parse(text), ephemeral_ports=True) as bench:
            driver = await SafetyDriver.open(SafetySettings(
                endpoint=bench.endpoints["safety"], period_s=0.02, relay_timeout_s=0.07,
            ))
            await driver.reset_watchdog_relay()
            bench.motion.receive(b"~G21G90G94\nM4S0\n")
            bench.motion.receive(b"G1X30S800F600\n")
            await asyncio.sleep(died_s)
            await driver.close()
            dead_s = asyncio.get_running_loop().time()
            await asyncio.sleep(1.0)
            times = np.arange(dead_s, dead_s + 1.0, 0.0005)
            beam_on = times[bench.motion.trace.sample(times).power_fraction > 0.0]
            return float(beam_on[-1] - dead_s)

    return virtual_time.run_in_virtual_time(main())


DEATHS_S = [0.5, 0.5071, 0.513, 0.5199]


@pytest.mark.parametrize("dialect", ["grblhal", "grbl"])
def test_within_100_ms_where_the_relay_stands_in_the_lasers_circuit(dialect):
    for died_s in DEATHS_S:
        assert 0.05 <= beam_off_after_s(dialect, True, died_s) <= 0.1


@pytest.mark.parametrize(("dialect", "most_s"), [("grblhal", 0.18), ("grbl", 0.14)])
def test_at_the_door_input_alone_the_controller_first_ends_what_it_has_prepared(dialect, most_s):
    for died_s in DEATHS_S:
        assert 0.1 < beam_off_after_s(dialect, False, died_s) <= most_s
