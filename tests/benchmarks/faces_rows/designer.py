"""`designer_redraw_ms`: from the request of a moved slider to the whole answer, over HTTP.

The median of 40 moves each of a number of the gear's and of the blade's composition, the slower of
the two; the answer holds the section, the colours of the surface and all numbers. What the browser
then draws is not in it.
"""

from __future__ import annotations

import re
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import httpx

from tests.benchmarks.plan_rows.measured import LMCTL

MOVES = 40


def rows() -> dict[str, float]:
    medians = {}
    with tempfile.TemporaryDirectory() as folder:
        for example in ("gear", "blade"):
            subprocess.run([*LMCTL, "init", example], cwd=folder, check=True, capture_output=True)
            medians[example] = _median_ms(Path(folder) / example / f"{example}.toml")
    return {"designer_redraw_ms": max(medians.values()),
            **{f"designer_redraw_ms_{name}": one for name, one in medians.items()}}


def _median_ms(part: Path) -> float:
    with subprocess.Popen([*LMCTL, "design", str(part), "--port", "0"], stdout=subprocess.PIPE,
                          stderr=subprocess.DEVNULL, text=True) as server:
        try:
            assert server.stdout is not None
            found = re.search(r"(http://\S+)/#token=(\S+)", server.stdout.readline())
            assert found is not None
            headers = {"Authorization": f"Bearer {found[2]}"}
            with httpx.Client(base_url=found[1], headers=headers, timeout=60.0) as client:
                return _moved(client)
        finally:
            server.terminate()


def _moved(client: httpx.Client) -> float:
    state = client.get("/api/design").json()["state"]
    client.get("/api/surface")
    number = next(one for one in reversed(state["numbers"]) if "composition" in one["path"])
    middle = [(a + b) / 2 for a, b in zip(state["low_mm"], state["high_mm"], strict=True)]
    taken_s = []
    for move in range(MOVES):
        value = number["low"] + (number["high"] - number["low"]) * (0.3 + 0.4 * move / MOVES)
        begin_s = time.perf_counter()
        answer = client.post("/api/adjust", json={
            "axis": 2, "at_mm": middle[2], "path": number["path"], "value": value,
            "continuing": move > 0})
        answer.json()
        taken_s.append(time.perf_counter() - begin_s)
        assert answer.status_code == 200, answer.text
        time.sleep(0.02)  # a hand on a slider, and the page's limit of requests
    return round(1000.0 * statistics.median(taken_s), 1)
