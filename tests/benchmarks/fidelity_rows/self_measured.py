"""Parts on a cell that measured itself: share of the beam-on path within ±0.02 of the part.

Hidden: dead times +0.5 s and −0.5 s, lags ×1.3, slopes +5 %, catch −10 % in one powder, 1 % noise
in both hoppers. `lmctl machine feeder-test` and `catch-test` measure the cell over the wires; the
parts are planned and run with the calibration that they wrote. The simulators' own record of what
left the nozzle is compared with the part's own composition at the nozzle's place.

Rows: within_0.02_gear, _ring, _box, medians of five seeds; _typed_in: seed 0 with the profile as it
was typed in, nothing measured.

    python -m tests.benchmarks.fidelity_rows.self_measured [SEEDS] [PART ...]
"""

from __future__ import annotations

import json
import statistics
import sys
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

from lmctl.cli.__main__ import main
from lmctl.cli.bench import load_bench, replace_endpoints
from lmctl.cli.profiles import load_profile_or_default
from lmctl.config.machine import MachineProfile
from lmctl.job.reader import JobReader
from lmctl.part.load import load_part
from lmctl.plan.planner import plan_job
from lmctl.run.executor import RunExecutor
from simulators import virtual_time
from simulators.bench import Bench
from tests.benchmarks.fidelity_rows.hidden_cell import (
    lmctl,
    self_measured,
    write_bench,
    write_cell,
)

SEEDS = 5
TOLERANCE = 0.02

MATERIALS = '[[material]]\nname = "316L"\n[[material]]\nname = "WC-12Co"\n'
#: Graded along the radius; tracks are circles of one mixture each.
RING = f"""
name = "ring"
{MATERIALS}
[[body]]
kind = "cylinder"
base_mm = [0, 0, 0]
top_mm = [0, 0, 1.6]
radius_mm = 20
[composition]
feature = {{ kind = "axis", point_mm = [0, 0, 0], direction = [0, 0, 1] }}
profile = {{ kind = "linear", near = {{ "316L" = 0.8, "WC-12Co" = 0.2 }}, \
far = {{ "316L" = 0.2, "WC-12Co" = 0.8 }}, over_mm = [0, 20] }}
"""
#: Graded along its tracks: 0.6 in 40 mm.
BOX = f"""
name = "box"
{MATERIALS}
[[body]]
kind = "box"
low_mm = [0, 0, 0]
high_mm = [40, 8, 1.6]
[composition]
feature = {{ kind = "coordinate", along = "x" }}
profile = {{ kind = "linear", near = {{ "316L" = 0.8, "WC-12Co" = 0.2 }}, \
far = {{ "316L" = 0.2, "WC-12Co" = 0.8 }}, over_mm = [0, 40] }}
"""
PARTS = ("gear", "ring", "box")


def rows(seeds: int = SEEDS, parts: tuple[str, ...] = PARTS) -> dict[str, float | int]:
    """The rows by key."""
    shares: dict[str, list[float]] = {part: [] for part in parts}
    typed_in: dict[str, float] = {}
    for seed in range(seeds):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            cell, bench = write_cell(folder), write_bench(folder, hidden(seed))
            if seed == 0:
                profile = load_profile_or_default(cell, calibrated=False)
                typed_in = {part: share_within(part, profile, bench, folder) for part in parts}
            self_measured(cell, bench, folder)
            lmctl("machine", "catch-test", "--sim", "--machine", cell, "--bench", bench,
                  "--runs", folder / "runs", "--no-mixture", "--operator", "bench", "--json")
            profile = load_profile_or_default(cell)
            for part in parts:
                shares[part].append(share_within(part, profile, bench, folder))
                print(seed, part, shares[part][-1], file=sys.stderr)
    return {
        **{f"within_0.02_{part}": round(statistics.median(shares[part]), 4) for part in parts},
        **{f"within_0.02_{part}_typed_in": round(typed_in[part], 4) for part in parts},
    }


def hidden(seed: int) -> list[dict[str, float]]:
    """The truth of both hoppers."""
    noise = {"noise_rsd": 0.01, "noise_time_s": 1.0, "slope_factor": 1.05}
    return [
        {"dead_time_s": 3.5, "lag_s": 1.3, "catch_efficiency": 0.675, "seed": 2 * seed, **noise},
        {"dead_time_s": 2.1, "lag_s": 1.04, "seed": 2 * seed + 1, **noise},
    ]


def part_file(part: str, folder: Path) -> Path:
    """The part's file, with the data it names beside it."""
    if part == "gear":
        init_gear(folder)
        return folder / "gear" / "gear.toml"
    path = folder / f"{part}.toml"
    path.write_text({"ring": RING, "box": BOX}[part])
    return path


def init_gear(folder: Path) -> None:
    """The gear as `lmctl init gear` makes it."""
    target = folder / "gear"
    if not target.exists():
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            main(["init", "gear", str(target)])


def share_within(part: str, profile: MachineProfile, bench: Path, folder: Path) -> float:
    """As `share_of`, of one of the parts by name."""
    return share_of(part_file(part, folder), profile, bench, folder)


def share_of(file: Path, profile: MachineProfile, bench: Path, folder: Path) -> float:
    """Plan and run a part; share of the beam-on path within the tolerance of its composition."""
    loaded = load_part(file)
    job = folder / f"{file.stem}.lmj"
    plan_job(loaded, profile, job)
    config = load_bench(bench)

    async def whole() -> Bench:
        async with Bench(config, ephemeral_ports=True) as cell:
            wired = replace_endpoints(profile, cell.endpoints)
            await RunExecutor(job, wired, folder / "part-runs").run()
        return cell

    path = virtual_time.run_in_virtual_time(whole()).record.beam_on_path()
    with JobReader(job) as reader:
        offset_mm, layers = reader.manifest.part_offset_mm, reader.manifest.layers
    half_mm = (layers[1].z_mm - layers[0].z_mm) / 2.0 if len(layers) > 1 else 0.0
    places = path.position_mm - [*offset_mm[:2], offset_mm[2] + half_mm]
    designed = loaded.composition(places)
    order = [path.materials.index(material.name) for material in loaded.materials]
    wanted = path.fractions * 0.0
    wanted[:, order] = designed
    return path.length_fraction_within_tolerance(wanted, TOLERANCE)


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS
    print(json.dumps(rows(count, tuple(sys.argv[2:]) or PARTS)))
