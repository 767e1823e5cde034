"""From motion and powder whose truth is known to the voxel map and its file."""

import zipfile
from dataclasses import replace

import numpy as np
import pytest

from firmware_protocol.pmx import FeederCommandBits
from simulators.bench_config import BenchConfig, BenchConfigError
from simulators.bench_record import BenchRecord
from simulators.feeder.config import FeederConfig, HopperConfig
from simulators.feeder.device import PmxFeederDevice
from simulators.motion.actions import BEAM_DYNAMIC
from simulators.motion.trace import ConstantAccelerationPhases, ExecutedBlocks, TraceSample
from simulators.process.build import BuildError, build_from_record
from simulators.process.config import ProcessConfig
from simulators.process.pool import bead_width_mm, dilution
from simulators.process.substrate_heights import SubstrateHeights

STEEL = HopperConfig(
    channel=1, material="316L", density_g_mm3=0.008, catch_efficiency=0.75, dead_time_s=3.0,
    lag_s=1.0, feed_factor_g_rev=2.0, n_min_rpm=0.0, n_max_rpm=30.0, fill_g=1e5,
)
CARBIDE = replace(STEEL, material="WC-12Co", density_g_mm3=0.0143, catch_efficiency=0.55)
PROCESS = ProcessConfig(max_power_W=3000, bead_width_mm=2.0, power_W=1500, speed_mm_s=10,
                        dilution=0.2, substrate="S355")
FEED = FeederCommandBits.ENABLE_REMOTE | FeederCommandBits.GAS_ON | FeederCommandBits.FEED_ON


class StraightMoves:
    """A trace of moves along x at 10 mm/s and half power: (start_s, length_mm, y_mm, z_mm)."""

    def __init__(self, *moves) -> None:
        self.moves = np.array(moves, dtype=float).reshape(-1, 4)

    def phases(self) -> ConstantAccelerationPhases:
        start, length, *_ = self.moves.T
        still = np.zeros(len(start))
        return ConstantAccelerationPhases(start, start + length / 10, still + 10, still,
                                          np.arange(len(start)), still, still + 0.5)

    def blocks(self) -> ExecutedBlocks:
        start, length, y, z = self.moves.T
        n = len(start)
        begin = np.stack([np.full(n, 20.0), y, z], axis=1)
        return ExecutedBlocks(
            np.arange(1, n + 1), start, start + length / 10, begin,
            begin + np.outer(length, [1, 0, 0]), np.full(n, 10.0), np.full(n, BEAM_DYNAMIC),
            np.ones(n, dtype=bool), np.ones(n))

    def sample(self, times_s) -> TraceSample:
        start, length, y, z = self.moves.T
        row = np.searchsorted(start, times_s, side="right") - 1
        moving = (row >= 0) & (times_s < (start + length / 10)[row])
        place = np.stack([20.0 + 10 * (times_s - start[row]), y[row], z[row]], axis=1)
        return TraceSample(place, np.where(moving, 10.0, 0.0), np.where(moving, 0.5, 0.0),
                           np.where(moving, row, -1))


def record(*moves, hoppers=(STEEL, CARBIDE), flows=(6.0, 12.0), until_s=60.0) -> BenchRecord:
    """Powder from 0 s on, these moves, and the clock at until_s."""
    clock = {"s": 0.0}
    devices = []
    for number, (hopper, flow) in enumerate(zip(hoppers, flows, strict=True)):
        device = PmxFeederDevice(FeederConfig(f"F{number}", (hopper,), preflow_s=0.0),
                                 lambda: clock["s"])
        device.write(0, [int(FeederCommandBits.ENABLE_REMOTE), 1, 60_000, 1, 0, 0])
        device.write(10, [1])
        device.write(23, [round(100 * flow)])
        device.write(6, [1])
        device.write(0, [int(FEED)])
        devices.append(device)
    clock["s"] = until_s
    return BenchRecord(StraightMoves(*moves), devices)


def test_what_is_built_is_flow_times_catch_over_density():
    built = build_from_record(record((20.0, 30.0, 50.0, 0.8), (25.0, 30.0, 51.3, 0.8)), PROCESS)
    assert built.powders == ("316L", "WC-12Co", "S355")
    per_s = np.array([0.1 * 0.75 / 0.008, 0.2 * 0.55 / 0.0143])
    volume = built.deposited_mm3.sum(axis=(1, 2, 3), dtype=np.float64)
    assert volume[:2] == pytest.approx(per_s * 6.0, rel=1e-6)
    assert built.beam_on_mm.sum() == pytest.approx(60.0)
    assert built.delivered[:, :2] == pytest.approx(
        np.tile(per_s / per_s.sum(), (len(built.time_s), 1)))
    assert built.height_mm.sum() * 0.25**2 == pytest.approx(volume[:2].sum(), rel=1e-6)
    assert set(built.line) == {1, 2}


def test_powder_balances():
    built = build_from_record(record((20.0, 30.0, 50.0, 0.8)), PROCESS)
    assert built.fed_g[:2] == pytest.approx([6.0, 12.0])
    assert built.beam_on_g[:2] == pytest.approx([0.3, 0.6])
    assert built.beam_off_g[:2] == pytest.approx([0.1 * 57 - 0.3, 0.2 * 57 - 0.6])
    mass = built.deposited_mm3[:2].sum(axis=(1, 2, 3)) * built.density_g_mm3[:2]
    assert mass / built.beam_on_g[:2] == pytest.approx([0.75, 0.55], rel=1e-6)


def test_a_hopper_that_runs_empty_leaves_the_other_powder_and_says_nothing_false():
    """4 g last 40 s: what comes after θ and the lag of that is carbide alone."""
    emptying = replace(STEEL, fill_g=4.0, lag_s=0.2)
    built = build_from_record(record((30.0, 200.0, 50.0, 0.8), hoppers=(emptying, CARBIDE)),
                              PROCESS)
    after = built.time_s > 40.0 + 3.0 + 3.0
    assert built.delivered[after, 0].max() < 1e-4
    assert built.fed_g[0] == pytest.approx(4.0)


def test_without_powder_there_is_nothing_and_it_is_noted():
    assert build_from_record(record((1.0, 10.0, 50.0, 0.8)), PROCESS) is None
    built = build_from_record(record((1.0, 10.0, 50.0, 0.8), (20.0, 10.0, 50.0, 0.8)), PROCESS)
    assert any("no powder came along 10.0 mm" in note for note in built.notes)


def test_a_deposit_that_reaches_the_nozzle_is_noted():
    moves = [(20.0 + 1.25 * i, 10.0, 50.0, 0.0) for i in range(30)]
    built = build_from_record(record(*moves, flows=(10.0, 10.0)),
                              replace(PROCESS, nozzle_gap_mm=5.0))
    assert any("the nozzle ran into the deposit" in note for note in built.notes)
    # and the grid has grown with it
    assert built.height_mm.max() > 5.0
    per_s = (10 / 60) * np.array([0.75 / 0.008, 0.55 / 0.0143])
    assert built.deposited_mm3[:2].sum(axis=(1, 2, 3), dtype=np.float64) == pytest.approx(
        per_s * 1.0 * 30, rel=1e-6)


def test_a_grid_too_large_is_refused_with_what_to_change():
    with pytest.raises(BuildError, match="raise voxel_mm"):
        build_from_record(record((20.0, 30.0, 50.0, 0.8), (30.0, 30.0, 9000.0, 0.8)),
                          replace(PROCESS, voxel_mm=0.02, voxel_height_mm=0.02))


def test_the_file_holds_the_map(tmp_path):
    built = build_from_record(record((20.0, 30.0, 50.0, 0.8)), PROCESS)
    built.write(tmp_path / "map.npz")
    with np.load(tmp_path / "map.npz", allow_pickle=False) as file:
        assert str(file["format"]) == "voxel-map-1"
        assert tuple(file["powders"]) == built.powders
        assert np.array_equal(file["deposited_mm3"], built.deposited_mm3)
        assert file["place_mm"] == pytest.approx(built.place_mm)
        assert file["deposited_mm3"].shape == (3, *file["height_mm"].shape,
                                               file["deposited_mm3"].shape[3])
    assert [path.name for path in tmp_path.iterdir()] == ["map.npz"]
    with zipfile.ZipFile(tmp_path / "map.npz") as archive:  # no time of day in it
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_width_and_dilution_follow_power_and_speed():
    varied = replace(PROCESS, width_power_exponent=0.5, width_speed_exponent=0.5,
                     dilution_per_J_mm=0.001)
    power, speed = np.array([1500.0, 3000.0, 1500.0, 3000.0]), np.array([10.0, 10.0, 40.0, 0.1])
    assert bead_width_mm(varied, power, speed) == pytest.approx([2.0, 2.828, 1.0, 8.0], abs=1e-3)
    assert dilution(varied, power, speed) == pytest.approx([0.2, 0.35, 0.0875, 0.8])


BENCH = """
[motion]
[process]
max_power_W = 3000
bead_width_mm = 2
power_W = 1500
speed_mm_s = 10
[[feeder]]
name = "F1"
[[feeder.hopper]]
material = "316L"
density_g_mm3 = 0.008
catch_efficiency = 0.7
feed_factor_g_rev = 2
n_max_rpm = 25
fill_g = 1000
"""


def test_the_process_of_a_bench_file():
    assert BenchConfig.parse(BENCH).process == ProcessConfig(3000, 2.0, 1500, 10)
    assert BenchConfig.parse(BENCH.replace("[process]", "[x]", 1).split("[x]")[0] + BENCH[
        BENCH.index("[[feeder]]"):]).process is None


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("bead_width_mm = 2", "", "process.bead_width_mm: is missing"),
        ("bead_width_mm = 2", "bead_width_mm = 0.5", "voxel_mm: must be at most 0.125"),
        ("bead_width_mm = 2", "bead_width_mm = 2\ndilution = 1", "must be at most 0.8"),
        ("power_W = 1500", "power_W = 4000", "process.power_W: must be at most max_power_W"),
        ("power_W = 1500", "power_W = 1500\nwidth = 2", "process.width: there is no such key"),
        ("power_W = 1500", 'power_W = 1500\nsubstrate = "316L"', "'316L' is a powder too"),
    ],
)
def test_mistakes_in_the_process(old, new, told):
    with pytest.raises(BenchConfigError) as caught:
        BenchConfig.parse(BENCH.replace(old, new, 1))
    assert any(told in mistake for mistake in caught.value.mistakes)


def test_a_bead_follows_a_plate_that_is_not_flat():
    """A step of 3 mm across the path: the plate is as high as stated, and the bead lies on it."""
    stepped = replace(PROCESS, substrate_heights=SubstrateHeights(
        0.0, 0.0, 1.0, tuple((0.0,) * 40 + (3.0,) * 60 for _ in range(60))))
    straight = record((20.0, 50.0, 50.0, 0.8))
    flat, built = (build_from_record(straight, process) for process in (PROCESS, stepped))
    assert built.height_mm.sum() == pytest.approx(flat.height_mm.sum(), rel=1e-6)
    along = built.place_mm[:, 0]
    assert built.surface_mm[along < 37] == pytest.approx(0.0, abs=0.01)
    assert built.surface_mm[along > 43] == pytest.approx(3.0, abs=0.01)
    plate = built.deposited_mm3[-1].sum(axis=2)
    assert plate[[0, -1], 0] == pytest.approx(
        0.25**2 * (np.array([0.0, 3.0]) - built.origin_mm[2]), rel=1e-6)


def test_mistakes_in_the_heights_of_a_plate():
    heights = ("[process.substrate_heights]\nx_mm = 0\ny_mm = 0\npitch_mm = 1\nrows_mm = {}\n"
               "[[feeder]]")
    good = BenchConfig.parse(BENCH.replace("[[feeder]]", heights.format("[[0, 1], [2, 3]]"), 1))
    found = good.process.substrate_heights.height_mm(np.array([[0.5, 0.5], [9, 0]]))
    assert found == pytest.approx([1.5, 1.0])
    for rows, told in [("[[0, 1], [2]]", "two or more rows of as many numbers"),
                       ("[[0, -1], [2, 3]]", "rows_mm: must be at least 0")]:
        with pytest.raises(BenchConfigError) as caught:
            BenchConfig.parse(BENCH.replace("[[feeder]]", heights.format(rows), 1))
        assert any(told in mistake for mistake in caught.value.mistakes)
