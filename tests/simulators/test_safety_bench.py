"""The safety device in the cell: configuration, wire, and what its contacts do to other devices."""

import asyncio
from importlib.resources import files

import numpy as np
import pytest
from pymodbus.client import AsyncModbusTcpClient

from firmware_protocol.safety_io import RELAY_RESET_KEY, SafetyInputBits
from firmware_protocol.status import parse_status
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig, BenchConfigError
from simulators.safety.config import SafetyConfig

EXAMPLES = files("lmctl.examples")
PLAIN = (EXAMPLES / "bench.toml").read_text(encoding="utf-8")
SAFE = (EXAMPLES / "bench-safe.toml").read_text(encoding="utf-8")


def config(dialect: str = "grblhal", table: str = "watchdog_relay = true") -> BenchConfig:
    text = PLAIN
    if dialect == "grbl":
        text = text.replace('"grblhal"', '"grbl"').replace("10 = 511", "10 = 3")
        text = text.replace("rx_bytes = 1024", "rx_bytes = 128")
        text = text.replace("planner_blocks = 100", "planner_blocks = 15")
    return BenchConfig.parse(f"{text}\n[safety]\n{table}\n")


def test_a_bench_without_the_table_has_no_device():
    assert BenchConfig.parse(PLAIN).safety is None


def test_the_shipped_bench_with_it():
    assert BenchConfig.parse(SAFE).safety == SafetyConfig(
        watchdog_relay=True, laser_circuit=True, laser_enable=True
    )
    assert BenchConfig.parse(SAFE).addresses["safety"].port == 5023


@pytest.mark.parametrize(
    ("table", "reported"),
    [
        ("watchdog_relay = 1", "safety.watchdog_relay: must be true or false"),
        ("device_id = 248", "safety.device_id: must be a whole number from 1 to 247"),
        ("oxygen_ppm = -1", "safety.oxygen_ppm: must be at least 0"),
        ("relay = true", "safety.relay: there is no such key"),
        ("laser_enable = true", "safety.laser_enable: needs watchdog_relay = true"),
        ("laser_enable = 1", "safety.laser_enable: must be true or false"),
        ('endpoint = "tcp://127.0.0.1:1"', 'safety.endpoint: must be "modbus-tcp://HOST:PORT"'),
        ('endpoint = "modbus-tcp://127.0.0.1:5021"', "two devices answer at port 5021"),
    ],
)
def test_mistakes(table, reported):
    with pytest.raises(BenchConfigError) as caught:
        config(table=table)
    (mistake,) = caught.value.mistakes
    assert mistake.startswith(reported)


def test_a_table_that_is_none_and_a_feeder_of_its_name():
    with pytest.raises(BenchConfigError, match="safety: must be a table"):
        BenchConfig.parse("safety = 1\n" + PLAIN)
    with pytest.raises(BenchConfigError, match=r"feeder\[1\].name: 'safety' is taken"):
        BenchConfig.parse(SAFE.replace('name = "F1"', 'name = "safety"'))


def test_it_answers_where_it_says_and_on_a_pty():
    async def main():
        async with Bench(config(), ephemeral_ports=True) as bench:
            endpoint = bench.endpoints["safety"]
            assert endpoint.startswith("modbus-tcp://127.0.0.1:")
            port = int(endpoint.rpartition(":")[2])
            client = AsyncModbusTcpClient("127.0.0.1", port=port, retries=0)
            assert await client.connect()
            answer = await client.read_input_registers(0, count=1, device_id=1)
            client.close()
            assert answer.registers == [0x5349]
        async with Bench(config(table='endpoint = "pty"'), ephemeral_ports=True) as bench:
            assert bench.endpoints["safety"].startswith("modbus-rtu:///dev/pts/")

    virtual_time.run_in_virtual_time(main())


class Cell:
    """A bench under way, played by hand: no host."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.said = bytearray()
        bench.motion.attach_client(self.said.extend)

    def status(self):
        self.said.clear()
        self.bench.motion.receive(b"?")
        (text,) = (line for line in self.said.decode().split("\r\n") if line.startswith("<"))
        return parse_status(text)

    def start(self, seconds: float, speed_mm_s: float) -> None:
        """One bead in lines of 10 ms; heartbeats come until `stop_beating`."""
        motion = self.bench.motion
        motion.receive(b"G21G90G94\nM4S0\n")

        async def feed():
            step_mm = speed_mm_s * 0.1
            for number in range(1, int(seconds * 10)):
                line = f"G1X{number * step_mm:.3f}S800F{speed_mm_s * 60:.0f}\n"
                motion.receive(line.encode())
                await asyncio.sleep(0.1 if number > 4 else 0)

        self._feeding = asyncio.ensure_future(feed())

    def beat(self, timeout_ms: int = 300) -> None:
        safety = self.bench.safety

        async def beating():
            safety.write(0, [1, timeout_ms, RELAY_RESET_KEY])
            number = 1
            while True:
                await asyncio.sleep(0.05)
                number += 1
                safety.write(0, [number])

        self._beating = asyncio.ensure_future(beating())

    def stop_beating(self) -> None:
        self._beating.cancel()

    def beam_off_after_s(self, time_s: float) -> float:
        """How long after time_s the beam was last seen; 0 where it was dark at once."""
        times = np.arange(time_s, time_s + 1.0, 0.0005)
        beam_on = times[self.bench.motion.trace.sample(times).power_fraction > 0.0]
        return float(beam_on[-1] - time_s) if len(beam_on) else 0.0


def played(dialect: str, act, table: str = "watchdog_relay = true"):
    async def main():
        async with Bench(config(dialect, table), ephemeral_ports=True) as bench:
            return await act(Cell(bench))

    return virtual_time.run_in_virtual_time(main())


dialects = pytest.mark.parametrize("dialect", ["grblhal", "grbl"])

#: From a hold or an open door to darkness at 10 mm/s: what stands in the controller's step
#: segment buffer is still executed (90 ms in grblHAL, 50 ms in Grbl), then it brakes (20 ms).
BEAM_OFF_S = {"grblhal": 0.115, "grbl": 0.075}


@dialects
def test_without_heartbeats_the_relay_stops_the_controller_and_darkens_the_beam(dialect):
    async def act(cell):
        assert cell.status().state == "Door"  # the relay is open at power-up
        cell.beat()
        await asyncio.sleep(0.01)
        cell.bench.motion.receive(b"~")
        assert cell.status().state == "Idle"
        cell.start(3.0, 10.0)
        await asyncio.sleep(1.0)
        assert cell.status().state == "Run"
        cell.stop_beating()
        await asyncio.sleep(1.5)
        (opened_s,) = cell.bench.safety.relay_opened_s
        assert 1.25 < opened_s < 1.32
        assert 0.0 < cell.beam_off_after_s(opened_s) <= BEAM_OFF_S[dialect]
        assert cell.status().state == "Door"
        assert "D" in cell.status().active_pins

    played(dialect, act)


@dialects
def test_the_door_opens_the_controllers_door_input_and_closing_it_lets_it_go_on(dialect):
    async def act(cell):
        cell.start(3.0, 10.0)
        await asyncio.sleep(1.0)
        cell.bench.safety.set_door_open()
        opened_s = asyncio.get_running_loop().time()
        await asyncio.sleep(1.0)
        assert 0.0 < cell.beam_off_after_s(opened_s) <= BEAM_OFF_S[dialect]
        assert (cell.status().state, cell.status().substate) == ("Door", 1)
        cell.bench.safety.set_door_open(False)
        assert cell.status().substate == 0
        cell.bench.motion.receive(b"~")
        await asyncio.sleep(0.1)
        assert cell.status().state == "Run"

    played(dialect, act, "")


@dialects
def test_the_estop_chain_cuts_controller_and_feeders_at_once(dialect):
    async def act(cell):
        cell.start(3.0, 10.0)
        await asyncio.sleep(1.0)
        cell.bench.safety.set_estop_open()
        opened_s = asyncio.get_running_loop().time()
        assert cell.status().state == "Alarm"
        await asyncio.sleep(1.0)
        assert cell.beam_off_after_s(opened_s) == 0.0
        assert all(feeder.estop_open for feeder in cell.bench.feeders.values())
        cell.bench.safety.set_estop_open(False)
        assert not any(feeder.estop_open for feeder in cell.bench.feeders.values())
        cell.bench.motion.receive(b"\x18")
        cell.bench.motion.receive(b"$X\n")
        assert cell.status().state == "Idle"

    played(dialect, act, "")


def test_while_the_relay_is_open_a_closed_door_changes_nothing():
    async def act(cell):
        cell.bench.safety.set_door_open()
        cell.bench.safety.set_door_open(False)
        assert "D" in cell.status().active_pins
        cell.beat()
        await asyncio.sleep(0.01)
        assert not cell.status().active_pins
        cell.bench.safety.set_input(SafetyInputBits.KEY_ON, False)  # wired to no other device
        assert not cell.status().active_pins

    played("grblhal", act)


def test_power_off_and_on_opens_the_relay_at_once():
    async def act(cell):
        cell.beat()
        await asyncio.sleep(0.2)
        cell.bench.safety.restart()
        assert "D" in cell.status().active_pins

    played("grblhal", act)


CIRCUIT = "watchdog_relay = true\nlaser_circuit = true"


@dialects
@pytest.mark.parametrize("contact", ["door", "estop", "relay"])
def test_in_the_lasers_own_circuit_every_contact_takes_the_beam_away_at_the_source(
    dialect, contact
):
    async def act(cell):
        safety = cell.bench.safety
        cell.beat(timeout_ms=70)
        await asyncio.sleep(0.01)
        cell.bench.motion.receive(b"~")
        cell.start(3.0, 10.0)
        await asyncio.sleep(1.0)
        if contact == "relay":
            cell.stop_beating()
            await asyncio.sleep(0.1)
            (opened_s,) = safety.relay_opened_s
        else:
            (safety.set_door_open if contact == "door" else safety.set_estop_open)()
            opened_s = asyncio.get_running_loop().time()
        await asyncio.sleep(1.0)
        assert cell.beam_off_after_s(opened_s) <= 0.02
        assert cell.beam_off_after_s(opened_s - 0.05) >= 0.049

    played(dialect, act, CIRCUIT)


ENABLE = "watchdog_relay = true\nlaser_enable = true"


@dialects
def test_there_is_a_beam_only_while_the_laser_enable_output_is_on(dialect):
    async def act(cell):
        safety, beam_on = cell.bench.safety, []
        cell.beat()
        await asyncio.sleep(0.01)
        cell.bench.motion.receive(b"~")
        cell.start(3.0, 10.0)
        for level in (0, 1, 0, 1):
            safety.write(3, [level])
            await asyncio.sleep(0.4)
            now_s = asyncio.get_running_loop().time()
            times = np.arange(now_s - 0.3, now_s, 0.001)
            beam_on.append(cell.bench.motion.trace.sample(times).power_fraction > 0.0)
        assert [bool(one.any()) for one in beam_on] == [False, True, False, True]
        assert all(one.all() for one in beam_on[1::2])
        assert cell.status().state == "Run"  # it notices nothing

    played(dialect, act, ENABLE)


def test_either_of_enable_output_and_laser_circuit_keeps_the_beam_away():
    async def act(cell):
        safety = cell.bench.safety
        cell.beat()
        await asyncio.sleep(0.01)
        safety.write(3, [1])
        cell.bench.motion.receive(b"~")
        cell.start(3.0, 10.0)
        await asyncio.sleep(0.5)
        opened_s = asyncio.get_running_loop().time()
        safety.set_door_open()
        await asyncio.sleep(0.01)
        safety.write(3, [0])  # no new time to darkness
        await asyncio.sleep(0.1)
        safety.write(3, [1])
        await asyncio.sleep(0.1)
        assert cell.beam_off_after_s(opened_s) <= 0.02
        safety.write(3, [0])
        safety.set_door_open(False)
        cell.bench.motion.receive(b"~")
        await asyncio.sleep(1.0)
        assert cell.status().state == "Run"
        assert cell.beam_off_after_s(opened_s + 0.02) == 0.0

    played("grblhal", act, f"{ENABLE}\nlaser_circuit = true")


def test_a_circuit_that_closes_lets_the_controllers_beam_through_again():
    async def act(cell):
        cell.start(3.0, 10.0)
        await asyncio.sleep(0.5)
        motion = cell.bench.motion
        motion.set_laser_circuit_open(True, 0.02)
        motion.set_laser_circuit_open(True, 0.02)  # another contact of it
        await asyncio.sleep(0.3)
        motion.set_laser_circuit_open(False, 0.02)
        await asyncio.sleep(0.2)
        motion.set_laser_circuit_open(True, 0.02)
        await asyncio.sleep(0.01)
        motion.set_laser_circuit_open(False, 0.02)  # before the source had noticed
        await asyncio.sleep(0.3)
        times = np.arange(0.4, 1.25, 0.001)
        beam_on = motion.trace.sample(times).power_fraction > 0.0
        beam_off = (times >= 0.52) & (times < 0.8)
        settled = (np.abs(times - 0.52) > 0.0015) & (np.abs(times - 0.8) > 0.0015)
        np.testing.assert_array_equal(beam_on[settled], ~beam_off[settled])
        # nothing but the beam has changed
        moving = motion.trace.sample(times).speed_mm_s
        assert moving.min() == pytest.approx(10.0, rel=1e-6)

    played("grblhal", act, "")


def test_the_record_of_phases_and_standing_shows_the_same_as_its_samples():
    async def act(cell):
        motion = cell.bench.motion
        motion.receive(b"G21G90G94\nM3S500\nG1X2F600\nG4P0.2\nG1X4F600\n")
        for wait_s, is_cut in ((0.05, True), (0.1, False), (0.1, True), (0.05, False),
                               (0.2, True), (0.1, False)):
            await asyncio.sleep(wait_s)
            motion.set_laser_circuit_open(is_cut, 0.0)
        await asyncio.sleep(0.5)
        trace = motion.trace
        phases = trace.phases()
        assert (phases.start_s[1:] >= phases.end_s[:-1] - 1e-12).all()
        middle = (phases.start_s + phases.end_s) / 2
        sample = trace.sample(middle)
        np.testing.assert_array_equal(phases.power > 0, sample.power_fraction > 0)
        np.testing.assert_allclose(
            phases.speed_mm_s + phases.acceleration_mm_s2 * (middle - phases.start_s),
            sample.speed_mm_s,
        )
        since, power = trace.standstill_power()
        assert (np.diff(since) >= 0).all()
        still = np.arange(0.0, 1.0, 0.0007)
        reported = trace.sample(still)
        at = np.searchsorted(since, still, side="right") - 1
        np.testing.assert_array_equal(
            reported.power_fraction[reported.block < 0], power[at][reported.block < 0]
        )
        assert {0.0, 0.5} == set(reported.power_fraction[reported.block < 0])
        assert {0.0, 0.5} == set(reported.power_fraction[reported.block >= 0])
        assert len(trace.blocks().line) == 2
        assert trace.blocks().is_complete.all()

    played("grblhal", act, "")
