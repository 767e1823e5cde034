"""What is built where the profile is the truth, and where only dilution is hidden.

The shipped cell and its bench with a table [process], voxels of 0.25 mm. Every part is planned and
run by the commands, and compared by `lmctl report --as-built`; rows that end in _checked are the
same by a few lines of arithmetic here, on the voxel map alone. They know the compositions of gear,
ring, box and blend in closed form and share nothing with lmctl.

Rows, profile = truth: within_0.02_truth_* of the path; within_0.03_volume_truth_*; of a block of
50 layers and of the gear built_over_design_*, core_void_*; height_after_50_layers, built over
planned; powder_balance_worst, the greatest share of a material that is unaccounted for.
process_speedup: machine time of the gear over wall time of its run with the process, and the same
over the processor's time, process_speedup_cpu. Dilution of 20 % hidden and not compensated, on
a plate of 316L: within_0.03_volume_diluted_*.

    python -m tests.benchmarks.fidelity_rows.as_built [PART ...]
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.fidelity_rows.hidden_cell import SHIPPED, lmctl
from tests.benchmarks.fidelity_rows.self_measured import BOX, MATERIALS, RING

FloatArray = NDArray[np.float64]

PROCESS = """
[process]
max_power_W = 3000
bead_width_mm = 2.0
power_W = 1500
speed_mm_s = 10
dilution = {dilution}
substrate_material = "316L"
"""
#: Fifty layers of 0.8 mm.
BLOCK = f"""
name = "block"
{MATERIALS}
[[body]]
kind = "box"
low_mm = [0, 0, 0]
high_mm = [16, 12, 40]
[composition]
feature = {{ kind = "coordinate", along = "z" }}
profile = {{ kind = "linear", near = {{ "316L" = 0.7, "WC-12Co" = 0.3 }}, \
far = {{ "316L" = 0.3, "WC-12Co" = 0.7 }}, over_mm = [0, 40] }}
"""
#: Middle of the platform of the shipped cell, where parts stand.
CENTRE_MM = np.array([150.0, 150.0, 0.0])
TOLERANCES = {"path": 0.02, "volume": 0.03}
DILUTION = 0.2


@dataclass(frozen=True)
class Case:
    """A part: text of its file, or the name of an example; share of carbide at places (n, 3) from
    the middle of its foot."""

    text: str
    carbide: Callable[[FloatArray], FloatArray]


def _radius(place: FloatArray) -> FloatArray:
    return np.hypot(place[:, 0], place[:, 1])


def _blend(place: FloatArray) -> FloatArray:
    """0.3 of the distance to a point and 0.7 of that to a line, each from 0.1 to 0.8 in 20 mm."""
    corner = place + np.array([15.0, 10.0, 0.0])
    to_point = np.linalg.norm(corner - [8, 10, 2], axis=1)
    to_line = np.hypot(corner[:, 0] - 24, corner[:, 2] - 2)
    return sum(weight * np.interp(far, [0, 20], [0.1, 0.8])
               for weight, far in ((0.3, to_point), (0.7, to_line)))


CASES = {
    "gear": Case("gear", lambda p: np.interp(_radius(p), [8, 12, 20], [0.1, 0.3, 0.8])),
    "ring": Case(RING, lambda p: np.interp(_radius(p), [0, 20], [0.2, 0.8])),
    "box": Case(BOX, lambda p: np.interp(p[:, 0] + 20, [0, 40], [0.2, 0.8])),
    "blend": Case("fig4-blend", _blend),
    "block": Case(BLOCK, lambda p: np.interp(p[:, 2], [0, 40], [0.3, 0.7])),
}


def rows(names: tuple[str, ...] = tuple(CASES)) -> dict[str, float]:
    """The rows by key."""
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            found |= _truth(name, Path(folder) / name)
            if name != "block":
                found |= _diluted(name, Path(folder) / name)
    balances = [found.pop(key) for key in [k for k in found if k.startswith("balance_")]]
    return {**found, "powder_balance_worst": max(balances)}


def _truth(name: str, folder: Path) -> dict[str, float]:
    part = planned_case(name, folder, SHIPPED / "cell.toml")
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    run = run_case(folder, part, 0.0, SHIPPED / "cell.toml")
    wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
    summary = summary_of(folder, run)
    checked = checked_against_map(name, run)
    found = {
        f"within_0.02_truth_{name}": summary["by_path"]["within"]["0.02"],
        f"within_0.02_truth_{name}_checked": checked["path"],
        f"within_0.03_volume_truth_{name}": summary["by_volume"]["within"]["0.03"],
        f"within_0.03_volume_truth_{name}_checked": checked["volume"],
        f"balance_{name}": max(abs(one["closure"]) for one in summary["balance"]),
    }
    if name in ("gear", "block"):
        found[f"built_over_design_{name}"] = summary["built_over_design"]
        found[f"core_void_{name}"] = summary["core_void"]
    if name == "block":
        found["height_after_50_layers"] = summary["height_mm"] / summary["planned_height_mm"]
        found["height_after_50_layers_checked"] = checked["height_mm"] / 40.0
        found["built_over_design_block_checked"] = checked["built_mm3"] / (16 * 12 * 40)
    if name == "gear":
        machine_s = float(json.loads((folder / "result.json").read_text())["machine_s"])
        found["process_speedup"] = machine_s / wall_s
        found["process_speedup_cpu"] = machine_s / cpu_s
    return {key: round(float(value), 4) for key, value in found.items()}


def _diluted(name: str, folder: Path) -> dict[str, float]:
    run = run_case(folder, folder / "part.lmj", DILUTION, SHIPPED / "cell.toml")
    summary, checked = summary_of(folder, run), checked_against_map(name, run)
    key = f"within_0.03_volume_diluted_{name}"
    return {key: round(summary["by_volume"]["within"]["0.03"], 4),
            f"{key}_checked": round(checked["volume"], 4)}


def planned_case(name: str, folder: Path, cell: Path, more: str = "") -> Path:
    """The job of a case in a new folder, for a cell. more : tables behind those of its part file"""
    folder.mkdir()
    text = CASES[name].text
    if "\n" not in text:
        if name == "gear":
            lmctl_text("init", "gear", folder, "--force")
            text = (folder / "gear.toml").read_text()
        else:
            text = (SHIPPED / f"{text}.toml").read_text()
    (folder / "part.toml").write_text(text + more)
    lmctl("plan", folder / "part.toml", "-m", cell, "-o", folder / "part.lmj", "--json")
    return folder / "part.lmj"


def lmctl_text(*arguments: object) -> None:
    """Run a command that prints text. Raises RuntimeError where it fails."""
    from contextlib import redirect_stderr, redirect_stdout
    from io import StringIO

    from lmctl.cli.__main__ import main

    with redirect_stdout(StringIO()), redirect_stderr(StringIO()) as told:
        code = main([str(argument) for argument in arguments])
    if code:
        raise RuntimeError(f"lmctl {' '.join(map(str, arguments))}: {code}\n{told.getvalue()}")


def write_process_bench(folder: Path, dilution: float, more: str = "") -> Path:
    """The shipped bench with a process. more : keys of its table"""
    bench = folder / "bench.toml"
    bench.write_text(
        (SHIPPED / "bench.toml").read_text() + PROCESS.format(dilution=dilution) + more)
    return bench


def run_case(folder: Path, job: Path, dilution: float, cell: Path) -> Path:
    """The folder of a run of a job on the shipped bench with a process."""
    return run_on_bench(folder, job, write_process_bench(folder, dilution), cell)


def run_on_bench(folder: Path, job: Path, bench: Path, cell: Path) -> Path:
    """The folder of a run of a job; its result is kept beside it."""
    result = lmctl("run", job, "--sim", "--bench", bench, "--machine", cell,
                   "--runs", folder / "runs", "--json")
    (folder / "result.json").write_text(json.dumps(result))
    return Path(str(result["journal"])).parent


def summary_of(folder: Path, run: Path) -> dict:
    """The figures of `lmctl report --as-built`."""
    return dict(lmctl("report", run, "--as-built", "--json", "--data", folder))


def checked_against_map(name: str, run: Path) -> dict[str, float]:
    """The same from the voxel map, without lmctl."""
    with np.load(run / "voxel-map.npz") as map_:
        place, length = map_["place_mm"].astype(float), map_["beam_on_mm"].astype(float)
        delivered, volumes = map_["delivered"], map_["deposited_mm3"].astype(float)
        corner, voxel, plate = map_["origin_mm"], map_["voxel_mm"], float(map_["substrate_z_mm"])
        height = map_["height_mm"]
    carbide = CASES[name].carbide
    on_path = place - CENTRE_MM - [0, 0, 0.4]  # the middle of the layer
    wrong = np.abs(np.nan_to_num(delivered[:, 1], nan=9.0) - carbide(on_path))
    first = round((plate - corner[2]) / voxel[2])
    built = volumes[:, :, :, first:]
    total = built.sum(axis=0)
    rows_ = np.argwhere(total > 0.05 * voxel.prod())
    centres = corner + [0, 0, first * voxel[2]] + (rows_ + 0.5) * voxel - CENTRE_MM
    weight = total[tuple(rows_.T)]
    worst = np.abs(built[1][tuple(rows_.T)] / weight - carbide(centres))  # the rest is steel
    core = height > 0.5 * height.max()
    return {
        "path": float(length[wrong <= TOLERANCES["path"] + 1e-6].sum() / length.sum()),
        "volume": float(weight[worst <= TOLERANCES["volume"] + 1e-6].sum() / weight.sum()),
        "built_mm3": float(total.sum()),
        "height_mm": float(height[_shrunk(core, round(2.0 / voxel[0]))].mean()),
    }


def _shrunk(mask: NDArray[np.bool_], cells: int) -> NDArray[np.bool_]:
    """What is so many cells from the edge of a mask, or more."""
    for _ in range(cells):
        padded = np.pad(mask, 1)
        mask = (padded[1:-1, 1:-1] & padded[2:, 1:-1] & padded[:-2, 1:-1] & padded[1:-1, 2:]
                & padded[1:-1, :-2])
    return mask


if __name__ == "__main__":
    print(json.dumps(rows(tuple(sys.argv[1:]) or tuple(CASES)), indent=1))
