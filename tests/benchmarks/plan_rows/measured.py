"""Programs run as a whole: how long they take by the clock and in CPU time, how much memory."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, sleep

LMCTL = (sys.executable, "-m", "lmctl.cli")
_SAMPLE_S = 0.1


@dataclass(frozen=True)
class Run:
    """wall_s, cpu_s (user and system, children included), peak_mb (proportional set size, summed
    over the program's processes; sampled)."""

    wall_s: float
    cpu_s: float
    peak_mb: float


def run(command: Sequence[str | Path], folder: Path, env: dict[str, str] | None = None) -> Run:
    """Run a program to its end. Raises RuntimeError, with what it said, where it fails."""
    before = _children_cpu_s()
    begin_s = perf_counter()
    process = subprocess.Popen(
        [str(word) for word in command], cwd=folder, env=os.environ | (env or {}),
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    peak = _Peak(process.pid)
    _, said = process.communicate()
    wall_s = perf_counter() - begin_s
    peak.stop()
    if process.returncode:
        raise RuntimeError(f"{command[0]} ended with {process.returncode}: {said[-2000:]}")
    return Run(wall_s, _children_cpu_s() - before, peak.most_mb)


def in_turn(repeats: int, **programs: Callable[[], Run]) -> dict[str, list[Run]]:
    """Each program so many times, one after the other, so that all see the same machine."""
    found: dict[str, list[Run]] = {name: [] for name in programs}
    for _ in range(repeats):
        for name, program in programs.items():
            found[name].append(program())
    return found


def median_ratio(ours: list[Run], theirs: list[Run], what: str) -> float:
    """Median of ours over median of theirs; what : "wall_s" or "cpu_s"."""
    return round(statistics.median(getattr(run, what) for run in ours)
                 / statistics.median(getattr(run, what) for run in theirs), 3)


def _children_cpu_s() -> float:
    times = os.times()
    return times.children_user + times.children_system


class _Peak:
    """Samples the memory of a process and those it started."""

    def __init__(self, pid: int) -> None:
        self.most_mb = 0.0
        self._pid = pid
        self._stopped = False
        self._thread = threading.Thread(target=self._sample, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._stopped = True
        self._thread.join()

    def _sample(self) -> None:
        while not self._stopped:
            kilobytes = sum(_pss_kb(pid) for pid in _tree(self._pid))
            self.most_mb = max(self.most_mb, kilobytes / 1024)
            sleep(_SAMPLE_S)


def _tree(pid: int) -> list[int]:
    found = [pid]
    for parent in found:
        try:
            for task in Path(f"/proc/{parent}/task").iterdir():
                found += [int(child) for child in (task / "children").read_text().split()]
        except OSError:
            continue
    return found


def _pss_kb(pid: int) -> int:
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in text.splitlines() if line.startswith("Pss:")), 0)
