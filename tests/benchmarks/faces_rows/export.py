"""LinuxCNC's own interpreter on our export of the demo's job, where `rs274` is installed.

`rs274_errors`: 0 where it reads the file to its end; `rs274_moves_missing`: moves of the plan that
it does not make; `rs274_end_error_mm`: how far from the plan's end its last move ends.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from lmctl.job.reader import JobReader
from tests.benchmarks.plan_rows.measured import LMCTL, run

_MOVE = re.compile(r"STRAIGHT_FEED\(([-0-9.]+), ([-0-9.]+), ([-0-9.]+)")


def rows() -> dict[str, float]:
    if shutil.which("rs274") is None:
        return {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run([*LMCTL, "init", "gear", "."], folder)
        run([*LMCTL, "plan", "gear.toml", "--machine", "cell.toml", "-o", "gear.lmj"], folder)
        run([*LMCTL, "export", "gear.lmj", "--to", "linuxcnc", "-o", "gear.ngc"], folder)
        read = subprocess.run(["rs274", "-g", "gear.ngc"], cwd=folder, capture_output=True,
                              text=True, check=False)
        moves = _MOVE.findall(read.stdout + read.stderr)
        with JobReader(folder / "gear.lmj") as job:
            lines = np.concatenate([layer.lines for layer in job.iterate_layers()])
        moving = lines[lines["speed_mm_s"] > 0]
        end = np.array([moving[axis][-1] for axis in ("x_mm", "y_mm", "z_mm")])
        ended = "PROGRAM_END" in read.stdout + read.stderr
        return {
            "rs274_errors": int(read.returncode != 0 or not ended),
            "rs274_moves_missing": len(moving) - len(moves),
            "rs274_end_error_mm": round(float(np.abs(np.array(moves[-1], float) - end).max()), 4),
        }
