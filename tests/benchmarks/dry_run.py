"""Speed and memory of whole dry runs: planner, feeders, powder lead and journal included.

Two jobs. A spiral of 100,000 segments of 0.1 mm at 10 mm/s, run with the motion link over TCP
(grblHAL, RX 1024) and over a pty (Grbl, RX 128): lines per wall second, peak memory, and that no
line was lost or doubled. And the demo's gear, planned from its scan: machine time over wall time.
Each run is a process of its own.

Prints one JSON object. --lines N makes the spiral shorter.

    python tests/benchmarks/dry_run.py
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np

from lmctl.cli.bench import replace_endpoints
from lmctl.config.machine import MachineProfile, load_profile
from lmctl.job.manifest_json import part_digest
from lmctl.job.reader import JobReader
from lmctl.job.schema import JobHopper, JobManifest, LineKind
from lmctl.job.writer import JobWriter
from lmctl.run.executor import run_job
from simulators import virtual_time
from simulators.bench import Bench, with_motion_on_pty
from simulators.bench_config import BenchConfig

LAYER_LINES = 5000
SEGMENT_MM, SPEED_MM_S, POWER_W = 0.1, 10.0, 900.0
FLOW_G_S = 0.1
PART = 'name = "spiral"\n'


def main() -> None:
    options = argparse.ArgumentParser()
    options.add_argument("--lines", type=int, default=100_000)
    options.add_argument("--child", nargs=3, metavar=("JOB", "WIRE", "RUNS"))
    chosen = options.parse_args()
    if chosen.child:
        job, wire, runs = chosen.child
        print(json.dumps(one_run(Path(job), wire, Path(runs))))
        return
    # Not at the top: a run's own process imports no planning, and its peak memory is measured.
    from lmctl.examples.templates import write_gear_template
    from lmctl.part.load import load_part
    from lmctl.plan.planner import plan_job

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        spiral, gear = folder / "spiral.lmj", folder / "gear.lmj"
        write_spiral(spiral, chosen.lines, profile())
        plan_job(load_part(write_gear_template(folder)), profile(), gear)
        tcp, pty, whole = (
            in_a_process(job, wire, folder / wire / job.stem)
            for job, wire in ((spiral, "tcp"), (spiral, "pty"), (gear, "tcp"))
        )
    print(json.dumps({
        "tcp_lines_per_s": round(tcp["lines"] / tcp["wall_s"]),
        "pty_lines_per_s": round(pty["lines"] / pty["wall_s"]),
        "speedup": round(whole["machine_s"] / whole["wall_s"], 1),
        "peak_mb": round(max(tcp["peak_mb"], pty["peak_mb"]), 1),
        "lines": tcp["lines"],
        "lost_or_doubled": tcp["wrong"] + pty["wrong"] + whole["wrong"],
        "overruns": tcp["overruns"] + pty["overruns"] + whole["overruns"],
        "predicted_over_simulated": round(tcp["planned_s"] / tcp["simulated_s"], 5),
        "gear_machine_s": round(whole["machine_s"], 1),
        "gear_predicted_over_simulated": round(whole["planned_s"] / whole["simulated_s"], 5),
    }))


def profile() -> MachineProfile:
    return load_profile(Path(str(files("lmctl.examples") / "cell.toml")))


def in_a_process(job: Path, wire: str, runs: Path) -> dict[str, float]:
    done = subprocess.run(
        [sys.executable, __file__, "--child", str(job), wire, str(runs)],
        check=True, stdout=subprocess.PIPE, text=True,
    )
    found: dict[str, float] = json.loads(done.stdout)
    return found


def one_run(job: Path, wire: str, runs: Path) -> dict[str, float]:
    config = BenchConfig.parse((files("lmctl.examples") / "bench.toml").read_text())
    if wire == "pty":
        motion = replace(config.motion, dialect="grbl", rx_bytes=128, planner_blocks=15,
                         settings={**config.motion.settings, 10: 3})
        config = with_motion_on_pty(replace(config, motion=motion))

    async def whole() -> tuple[Bench, object]:
        async with Bench(config, ephemeral_ports=True) as bench:
            return bench, await run_job(job, replace_endpoints(profile(), bench.endpoints), runs)

    bench, result = virtual_time.run_in_virtual_time(whole())
    peak_mb = peak_so_far_mb()  # before the judging
    with JobReader(job) as reader:
        planned_s = reader.manifest.layers[-1].end_s
        motions = [
            layer.first_line + int(row)
            for layer in reader.iterate_layers()
            for row in np.flatnonzero(~np.isin(layer.lines["kind"],
                                               (LineKind.SETUP, LineKind.DWELL)))
        ]
    blocks = bench.motion.trace.blocks()
    # What ran before the program (the way to the purge position) carries no number: it shows as 0.
    first = int(np.flatnonzero(blocks.line > 0)[0]) - (motions[0] == 0)
    executed = blocks.line[first:].tolist()
    return {
        "lines": result.lines, "wall_s": result.wall_s, "machine_s": result.machine_s,
        "wrong": len(set(motions) ^ set(executed)) + len(executed) - len(set(executed)),
        "overruns": bench.motion.rx_overrun_bytes, "planned_s": planned_s,
        "simulated_s": float(blocks.end_s[-1] - blocks.start_s[first]),
        "peak_mb": peak_mb,
    }


def peak_so_far_mb() -> float:
    """This program's own high water mark; ru_maxrss would begin with that of its parent."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024


def write_spiral(path: Path, n_lines: int, cell: MachineProfile) -> None:
    """A spiral of SEGMENT_MM chords in layers of LAYER_LINES lines, one path each."""
    from lmctl.plan.program_text.layer_text import (
        CLOSING_LINES,
        OPENING_LINES,
        LayerLines,
        packed_layer,
    )
    from lmctl.plan.sequence.moves import Moves, join_moves, moves_of_kind, rounded_to_program_steps
    from lmctl.plan.sequence.powder_flow import PowderFlow
    from lmctl.plan.sequence.velocity_profile import line_durations

    def modes(count: int, at_mm: np.ndarray, mixture: np.ndarray) -> Moves:
        return moves_of_kind(np.repeat(at_mm[None], count, axis=0), feed_mm_s=0.0,
                             kind=LineKind.SETUP,
                             fractions=mixture)

    mixture = np.array([1.0, 0.0])
    at_mm, at_s, count = np.array(cell.motion.purge_mm, dtype=float), 0.0, 0
    index = 0
    with JobWriter(path) as writer:
        while count < n_lines:
            turn = np.arange(min(LAYER_LINES, n_lines - count)) * SEGMENT_MM / 40.0
            radius = 40.0 + turn / 10
            target = np.column_stack([
                150 + radius * np.cos(turn), 150 + radius * np.sin(turn),
                np.full(len(turn), 1.0 + 0.5 * index),
            ])
            moves = rounded_to_program_steps(
                moves_of_kind(target, feed_mm_s=SPEED_MM_S, kind=LineKind.BEAD, fractions=mixture,
                              power_W=POWER_W, path=0, bead_width_mm=2.0), at_mm)
            # The way to the layer is long: as a first bead line it would outlast the horizon.
            way = np.linspace(at_mm, moves.target_mm[0], 120)[1:-1]
            travel = moves_of_kind(way, feed_mm_s=60.0, kind=LineKind.TRAVEL, fractions=mixture)
            moves = join_moves([rounded_to_program_steps(travel, at_mm), moves])
            lasting_s = line_durations(moves, at_mm, cell.motion)
            opens, closes = index == 0, count + len(moves) >= n_lines
            if opens:
                moves = join_moves([modes(len(OPENING_LINES), at_mm, mixture), moves])
                lasting_s = np.concatenate([np.zeros(len(OPENING_LINES)), lasting_s])
            if closes:
                moves = join_moves([moves, modes(len(CLOSING_LINES), moves.target_mm[-1], mixture)])
                lasting_s = np.concatenate([lasting_s, np.zeros(len(CLOSING_LINES))])
            end_s = at_s + np.cumsum(lasting_s)
            writer.add_packed_layer(packed_layer(LayerLines(
                index=index, z_mm=1.0 + 0.5 * index, first_line=count, first_path=index,
                moves=moves, end_s=end_s, designed=None, laser_settings=cell.laser, opens=opens,
                closes=closes,
                flow=PowderFlow(np.array([at_s, end_s[-1]]), np.array([[FLOW_G_S, 0.0]] * 2)),
            )))
            at_mm, at_s, count = moves.target_mm[-1], float(end_s[-1]), count + len(moves)
            index += 1
        writer.finish(JobManifest(
            part_name="spiral", part_sha256=part_digest(PART), sources={}, machine=cell.name,
            profile_digest=cell.planning_digest(), software="benchmark", powder_mode="lead",
            s_max=cell.laser.s_max, max_power_W=cell.laser.max_power_W,
            send_horizon_s=cell.motion.send_horizon_s,
            materials=tuple(hopper.material for hopper in cell.hopper),
            hoppers=tuple(JobHopper(h.name, h.material, h.dead_time_s, h.lag_s, h.max_flow_g_min)
                          for h in cell.hopper),
            bounds_mm=((10.0, 10.0, 1.0), (210.0, 210.0, 20.0)),
            totals={"powder_g": {}, "peak_flow_g_min": {}, "peak_power_W": POWER_W,
                    "longest_line_s": 0.2, "warnings": []},
            verdict=(),
        ), PART)


if __name__ == "__main__":
    main()
