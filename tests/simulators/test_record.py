"""The judge against motion and powder whose truth is known beforehand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from firmware_protocol.pmx import FeederCommandBits
from simulators.bench_record import BenchRecord
from simulators.feeder.config import FeederConfig, HopperConfig
from simulators.feeder.device import PmxFeederDevice
from simulators.motion.actions import BEAM_CONSTANT, BEAM_DYNAMIC, BEAM_OFF
from simulators.motion.trace import ConstantAccelerationPhases, ExecutedBlocks, TraceSample

STEEL = HopperConfig(
    channel=1, material="316L", density_g_mm3=0.00785, catch_efficiency=0.75, dead_time_s=3.0,
    lag_s=1.0, feed_factor_g_rev=2.0, n_min_rpm=0.0, n_max_rpm=30.0, fill_g=1e5,
)
CARBIDE = replace(STEEL, material="WC-12Co", density_g_mm3=0.0143, catch_efficiency=0.55)


class KnownMotion:
    """What the judge asks of a trace, for moves along x whose truth is given.

    moves : (line, start_s, end_s, start_mm, speed, acceleration, rate, beam, power)
    stands : (from_s, power while standing)
    """

    def __init__(self) -> None:
        self.moves, self.stands = [], [(0.0, 0.0)]

    def _column(self, i: int, kind=float) -> np.ndarray:
        return np.array([move[i] for move in self.moves], dtype=kind)

    def phases(self) -> ConstantAccelerationPhases:
        rows = np.arange(len(self.moves))
        return ConstantAccelerationPhases(
            self._column(1), self._column(2), self._column(4), self._column(5), rows,
            np.zeros(len(self.moves)), self._column(8),
        )

    def blocks(self) -> ExecutedBlocks:
        nothing = np.zeros((len(self.moves), 3))
        return ExecutedBlocks(
            self._column(0, int), self._column(1), self._column(2), nothing, nothing,
            self._column(6), self._column(7, int), np.ones(len(self.moves), dtype=bool),
            np.ones(len(self.moves)),
        )

    def sample(self, times_s) -> TraceSample:
        position, speed, power, block = [], [], [], []
        for t in times_s:
            row = next((i for i, m in enumerate(self.moves) if m[1] <= t < m[2]), -1)
            block.append(row)
            if row < 0:
                position.append((0.0, 0.0, 0.0))
                speed.append(0.0)
                power.append([p for since, p in self.stands if since <= t][-1])
                continue
            _, start_s, _, x, v, a, rate, beam, full = self.moves[row]
            now = v + a * (t - start_s)
            position.append((x + (v + now) / 2 * (t - start_s), 0.0, 0.0))
            speed.append(now)
            power.append(full * now / rate if beam == BEAM_DYNAMIC else full * (beam > 0))
        return TraceSample(
            np.array(position).reshape(-1, 3), np.array(speed), np.array(power),
            np.array(block, dtype=np.int64),
        )


class Bench:
    """A trace and two feeders on a clock moved by hand; powder is on from 0 s, stable from 8 s."""

    def __init__(self, *hoppers: HopperConfig) -> None:
        self.t = 0.0
        self.trace = KnownMotion()
        self.feeders = [
            PmxFeederDevice(FeederConfig(f"F{i}", (h,), preflow_s=0.0), lambda: self.t)
            for i, h in enumerate(hoppers)
        ]
        self.record = BenchRecord(self.trace, self.feeders)
        self.x_mm = 0.0

    def feed(self, *flows_g_min: float) -> None:
        for feeder, flow in zip(self.feeders, flows_g_min, strict=True):
            seq = feeder.holding.raw_word("SEQ") + 1
            feeder.write(0, [int(FeederCommandBits.ENABLE_REMOTE), seq, 60_000, 1, 0, 0])
            feeder.write(10, [1])
            feeder.write(23, [round(flow * 100)])
            feeder.write(6, [seq])
            feeder.write(0, [int(FeederCommandBits.ENABLE_REMOTE | FeederCommandBits.GAS_ON
                                 | FeederCommandBits.FEED_ON)])

    def stop(self) -> None:
        for feeder in self.feeders:
            feeder.write(0, [0])

    def move(self, line: int, length_mm: float, speed_mm_s: float, *, beam=BEAM_DYNAMIC,
             power=0.5, acceleration_mm_s2: float = 0.0) -> None:
        """Along x: at constant speed, or from rest up to the speed."""
        start_mm_s = 0.0 if acceleration_mm_s2 else speed_mm_s
        took = speed_mm_s / acceleration_mm_s2 if acceleration_mm_s2 else length_mm / speed_mm_s
        self.trace.moves.append((line, self.t, self.t + took, self.x_mm, start_mm_s,
                                 acceleration_mm_s2, speed_mm_s, beam, power))
        self.t += took
        self.x_mm += length_mm


def test_the_path_is_exact_in_length_place_and_time():
    bench = Bench(STEEL)
    bench.t = 5.0
    bench.move(7, 20.0, 10.0)
    bench.move(8, 5.0, 10.0, beam=BEAM_OFF, power=0.0)
    bench.move(9, 10.0, 4.0)
    path = bench.record.beam_on_path()
    assert path.length_mm.sum() == pytest.approx(30.0, rel=1e-12)
    assert path.duration_s.sum() == pytest.approx(4.5, rel=1e-12)
    assert path.length_mm.max() <= 0.1 + 1e-12
    assert set(path.line) == {7, 9}
    assert path.position_mm[path.line == 7][:, 0] == pytest.approx(
        10.0 * (path.time_s[path.line == 7] - 5.0)
    )
    assert (path.power_fraction == 0.5).all()


def test_a_start_from_rest_keeps_its_length_and_its_beam_follows_the_speed():
    bench = Bench(STEEL)
    bench.move(1, 5.0, 10.0, acceleration_mm_s2=10.0)
    path = bench.record.beam_on_path()
    assert path.length_mm.sum() == pytest.approx(5.0, rel=1e-12)
    assert path.power_fraction == pytest.approx(0.5 * path.time_s)


def test_moves_without_power_are_no_path():
    bench = Bench(STEEL)
    bench.move(1, 5.0, 10.0, power=0.0)
    assert len(bench.record.beam_on_path().time_s) == 0
    assert math.isnan(bench.record.beam_on_path().length_fraction_within_tolerance(np.zeros((0, 1)),
                                                                                   0.02))


def test_an_empty_record():
    record = Bench(STEEL).record
    assert len(record.beam_on_path().time_s) == 0
    assert record.beam_on_without_motion().shape == (0, 2)
    assert record.beam_on_without_stable_powder().shape == (0, 2)


def test_worked_example_of_volume_fractions():
    """2.4492 and 6.084 g/min deposit 7.8 mm³/s, half of each by volume."""
    bench = Bench(replace(STEEL, offset_g_min=-0.0008), replace(CARBIDE, offset_g_min=0.004))
    bench.feed(2.45, 6.08)
    bench.t = 50.0
    bench.move(1, 10.0, 10.0)
    path = bench.record.beam_on_path()
    assert path.materials == ("316L", "WC-12Co")
    assert path.fractions == pytest.approx(np.full((len(path.time_s), 2), 0.5), abs=1e-4)
    assert path.volume_rate_mm3_s == pytest.approx(np.full(len(path.time_s), 7.8), rel=1e-4)
    assert path.flow_g_s[0] * 60 == pytest.approx([2.4492, 6.084])


def test_two_hoppers_of_one_material_count_together():
    bench = Bench(STEEL, STEEL)
    bench.feed(6.0, 6.0)
    bench.t = 50.0
    bench.move(1, 1.0, 10.0)
    path = bench.record.beam_on_path()
    assert path.fractions == pytest.approx(np.ones((len(path.time_s), 1)))
    assert path.flow_g_s[:, 0] == pytest.approx(np.full(len(path.time_s), 0.2))


def test_the_share_is_that_of_the_path_not_of_pieces_or_time():
    """A step from 50 to 60 % is within 0.02 once the lag has eaten 80 % of it."""
    same = replace(STEEL, material="B")
    bench = Bench(STEEL, same)
    bench.feed(6.0, 6.0)
    bench.t = 50.0
    bench.feed(7.2, 4.8)
    bench.move(1, 30.0, 10.0)  # the dead time: still the old mixture
    bench.move(2, 100.0, 10.0)
    path = bench.record.beam_on_path(step_mm=0.02)
    designed = path.designed_fractions(np.array([2, 1]), np.array([[0.6, 0.4], [0.6, 0.4]]))
    late_mm = 10.0 * (3.0 + math.log(0.1 / 0.02))
    assert path.length_fraction_within_tolerance(
        designed, 0.02) == pytest.approx(1 - late_mm / 130.0, abs=2e-4)
    old = path.designed_fractions(np.array([1, 2]), np.array([[0.5, 0.5], [0.6, 0.4]]))
    assert path.length_fraction_within_tolerance(old, 0.02) == pytest.approx(
        1 - (late_mm - 30.0) / 130.0, abs=2e-4
    )


def test_without_powder_nothing_is_within_anything():
    bench = Bench(STEEL)
    bench.move(1, 10.0, 10.0)
    path = bench.record.beam_on_path()
    assert path.length_fraction_within_tolerance(np.ones((len(path.time_s), 1)), 1.0) == 0.0


def test_a_line_the_design_does_not_know():
    bench = Bench(STEEL)
    bench.move(3, 1.0, 10.0)
    path = bench.record.beam_on_path()
    for lines in ([], [1, 2], [4]):
        with pytest.raises(ValueError, match="line 3"):
            path.designed_fractions(np.array(lines, dtype=np.int64), np.ones((len(lines), 1)))


def test_beam_without_motion_is_found_and_timed():
    bench = Bench(STEEL)
    bench.t = 1.0
    bench.move(1, 10.0, 10.0, beam=BEAM_CONSTANT)
    bench.trace.stands.append((2.0, 0.5))
    bench.trace.stands.append((2.3, 0.0))
    bench.t = 10.0
    bench.move(2, 10.0, 10.0, beam=BEAM_CONSTANT)
    bench.t = 20.0
    (found,) = bench.record.beam_on_without_motion()
    assert found == pytest.approx([2.0, 2.3], abs=0.006)
    assert len(bench.record.beam_on_without_motion(longer_than_s=0.5)) == 0


def test_beam_without_stable_powder_is_found_and_timed():
    bench = Bench(STEEL, CARBIDE)
    bench.feed(6.0, 6.0)
    bench.t = 7.0
    bench.move(1, 20.0, 10.0)  # 7 to 9 s, stable from 8 s
    bench.t = 30.0
    bench.move(2, 10.0, 10.0)
    bench.stop()
    bench.move(3, 10.0, 10.0)
    found = bench.record.beam_on_without_stable_powder()
    assert found == pytest.approx(np.array([[7.0, 8.0], [31.0, 32.0]]), abs=0.01)


def test_a_feeder_that_was_never_used_is_not_waited_for():
    bench = Bench(STEEL, CARBIDE)
    bench.feeders = bench.feeders[:1]
    bench.feed(6.0)
    bench.t = 20.0
    bench.move(1, 10.0, 10.0)
    assert len(bench.record.beam_on_without_stable_powder()) == 0


def test_powder_fed():
    bench = Bench(STEEL, CARBIDE)
    bench.feed(6.0, 12.0)
    bench.t = 50.0
    assert bench.record.fed_g() == pytest.approx({"316L": 5.0, "WC-12Co": 10.0})


def test_a_powder_is_caught_otherwise_in_a_mixture():
    """A third and two thirds by mass; steel loses 30 % of its catch per share of another powder."""
    bench = Bench(replace(STEEL, catch_in_mixture=-0.3), CARBIDE)
    bench.feed(6.0, 12.0)
    bench.t = 50.0
    bench.move(1, 1.0, 10.0)
    path = bench.record.beam_on_path()
    wanted = [0.1 * 0.75 * (1 - 0.3 * 2 / 3) / 0.00785, 0.2 * 0.55 / 0.0143]
    assert path.deposit_mm3_s == pytest.approx(np.tile(wanted, (len(path.time_s), 1)))
