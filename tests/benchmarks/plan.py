"""Planning against slicers and against its own promises, as one JSON object.

    python tests/benchmarks/plan.py [GROUP ...]      groups: speed scale starts volume

Needs the extras `bench` and `scale`, and PrusaSlicer and CuraEngine (`plan_rows/peers.py` says
how they are installed and called). Kernels are compiled (or loaded) before anything is timed.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # also without being installed

GROUPS = ("speed", "scale", "starts", "volume")


def main() -> None:
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("group", nargs="*", choices=[*GROUPS, []], help="which rows [all]")
    chosen = options.parse_args().group or GROUPS
    rows: dict[str, Any] = {"kernel_cache": "warm: every program runs once before it is timed"}
    with tempfile.TemporaryDirectory() as folder:
        for group in chosen:
            rows |= _rows(group, Path(folder))
    print(json.dumps(rows, indent=2))


def _rows(group: str, folder: Path) -> dict[str, Any]:
    rows = importlib.import_module(f"tests.benchmarks.plan_rows.{group}")
    from tests.benchmarks.plan_rows import shapes

    if group == "speed":
        return rows.speed_rows(folder)
    if group == "scale":
        return rows.scale_rows(folder)
    if group == "starts":
        return rows.starts_rows(folder, shapes.write_six(folder))
    return _promised(rows.volume_rows(shapes.write_six(folder)))


def _promised(found: dict[str, Any]) -> dict[str, Any]:
    """The rows of volume that something is promised of."""
    built = {name: {"inside": inside, "surplus": found["surplus"][name]}
             for name, inside in found["built_over_design"].items()}
    kept = ("walls_worst_volume_error", "uncovered", "double", "lost_features_named")
    return {"built_over_design": built} | {key: found[key] for key in kept}


if __name__ == "__main__":
    main()
