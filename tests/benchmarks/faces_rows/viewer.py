"""`viewer_mb`: size of the page that `lmctl show` makes of the demo's job; `viewer_s`: how long."""

from __future__ import annotations

import tempfile
from pathlib import Path

from tests.benchmarks.plan_rows.measured import LMCTL, run


def rows() -> dict[str, float]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run([*LMCTL, "init", "gear", "."], folder)
        run([*LMCTL, "plan", "gear.toml", "--machine", "cell.toml", "-o", "gear.lmj"], folder)
        made = run([*LMCTL, "show", "gear.lmj", "-o", "gear.html"], folder)
        return {"viewer_mb": round((folder / "gear.html").stat().st_size / 1e6, 2),
                "viewer_s": round(made.wall_s, 1)}
