"""`kill -9` of the host at random moments, then `lmctl recover`: what the machine really did.

The simulated cell is a process of its own, in real time, and so is the host. For each kill: the
journal verifies and claims no path that was not executed; recovery goes on from where the machine
stands, and completes the part with nothing missing and no more than the overlap deposited twice.

    python -m tests.faults.kills [KILLS [FIRST]]

Seeds are FIRST, FIRST + 1, ...; a seed says at which moment its host is killed.
"""

from __future__ import annotations

import json
import random
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path

import numpy as np

from lmctl.config.machine import load_profile
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind
from lmctl.run.journal.format import read_records, verify_journal
from tests.faults.processes import start

#: Delays far shorter than a cell's, so that a run takes seconds.
SHORT = {
    "watchdog_s = 4":
        "watchdog_s = 1\ngas_preflow_s = 0.1\nstabilise_s = 0.2\ngas_postflow_s = 0.2",
    "dead_time_s = 3.0": "dead_time_s = 0.2", "dead_time_s = 2.6": "dead_time_s = 0.2",
    "lag_s = 1.0": "lag_s = 0.05", "lag_s = 0.8": "lag_s = 0.05",
    "preflow_s = 3.0 ": "preflow_s = 0.1 ",
    'name = "F2"\nendpoint = "modbus-tcp://127.0.0.1:5022"\ndevice_id = 1\n\n[[feeder.hopper]]':
        'name = "F2"\nendpoint = "modbus-tcp://127.0.0.1:5022"\npreflow_s = 0.1\n\n'
        "[[feeder.hopper]]",
}
SPEED_MM_S = 20.0
#: A square takes longer than the send horizon, so that it never passes a place twice within it.
SIDE_MM = 8.0
#: Bead that may be deposited twice where a path is entered again.
MOST_REPEATED_MM = 0.5
#: Cells at a time, each of which mostly waits.
AT_ONCE = 20
_LONGEST_S = 60.0
#: Of a controller without homing that reports 0, 0, 0, where it was moving when its host died.
_POWER_CYCLED = "it says 0, 0, 0, as every controller does that was switched off and on"


@dataclass
class Outcome:
    """One kill. at_s : after the journal was begun; shortfalls : empty where all was well."""

    seed: int
    at_s: float
    state: str = ""
    recovered: str = ""
    repeated_mm: float = 0.0
    shortfalls: list[str] = field(default_factory=list)

    @property
    def repeat(self) -> str:
        """The command that kills a host at the same moment again."""
        return f"python -m tests.faults.kills 1 {self.seed}"

    def row(self) -> str:
        return (f"{self.seed:4d}  {self.at_s:6.2f} s  {self.state:12s} {self.recovered:10s} "
                f"{self.repeated_mm:6.2f} mm  {'; '.join(self.shortfalls) or 'ok'}")


def run_kills(job: Path, seeds: range, folder: Path) -> list[Outcome]:
    """Kill one host a seed, several at once: they mostly wait."""
    with ThreadPoolExecutor(AT_ONCE) as pool:
        return list(pool.map(lambda seed: one_kill(job, seed, folder / f"{seed:04d}"), seeds))


def one_kill(job: Path, seed: int, folder: Path) -> Outcome:
    folder.mkdir(parents=True)
    outcome = Outcome(seed, random.Random(seed).uniform(0.0, 10.0))
    bench_file, record = folder / "bench.toml", folder / "record.json"
    bench_text = shortened("bench.toml")
    for port in ("2323", "5021", "5022"):
        bench_text = bench_text.replace(f"127.0.0.1:{port}", "127.0.0.1:0")
    bench_file.write_text(bench_text)
    bench = start("simulators", [bench_file, "--record", record], folder, "bench")
    try:
        cell = folder / "cell.toml"
        cell.write_text(wired(json.loads(_first_line(folder / "bench.out"))))
        outcome.state = _run_and_kill(job, cell, folder, outcome.at_s)
        _judge_journal(folder, outcome)
        if outcome.state != "done":
            _recover(cell, folder, outcome)
    finally:
        bench.terminate()
        bench.join(_LONGEST_S)
    _judge_record(job, json.loads(record.read_text()), folder, outcome)
    return outcome


def _run_and_kill(job: Path, cell: Path, folder: Path, at_s: float) -> str:
    """The last state the journal knows, after the host has been killed."""
    host = start("lmctl.cli", ["run", job, "--machine", cell, "--runs", folder / "runs"],
                 folder, "host")
    began, journal = time.monotonic(), folder / "runs" / "run-0001" / "journal.jsonl"
    while not journal.exists() and time.monotonic() < began + _LONGEST_S:
        time.sleep(0.01)
    host.join(at_s)
    host.kill()
    host.join()
    states = [
        r["to"] for r in read_records(journal) if r["kind"] == "state"] if journal.exists() else []
    return states[-1] if states else "not begun"


def _judge_journal(folder: Path, outcome: Outcome) -> None:
    journal = folder / "runs" / "run-0001" / "journal.jsonl"
    if journal.exists() and not verify_journal(journal).intact:
        outcome.shortfalls.append("the journal does not verify")


def _recover(cell: Path, folder: Path, outcome: Outcome) -> None:
    if not (folder / "runs" / "run-0001" / "journal.jsonl").exists():
        outcome.recovered = "not begun"
        return
    time.sleep(0.1)
    question = ""
    code, said = _recovery(cell, folder)
    if code == 4 and _POWER_CYCLED in " ".join(said.split()):
        # Killed between the record that the run moves the machine and its first motion: a machine
        # that still is where it was switched on looks like one that was switched off. Here it was
        # not, and its operator says so.
        question = " after a question"
        code, said = _recovery(cell, folder, "--position-restored")
    outcome.recovered = f"done{question}" if code == 0 else f"exit {code}"
    if code != 0:
        outcome.shortfalls.append(said.strip().splitlines()[-1])


def _recovery(cell: Path, folder: Path, *options: str) -> tuple[int | None, str]:
    """The exit code of `lmctl recover`, and what it said."""
    host = start("lmctl.cli", ["recover", "run-0001", "--machine", cell, "--runs", folder / "runs",
                               "--yes", "--json", *options], folder, "recover")
    host.join(_LONGEST_S)
    return host.exitcode, (folder / "recover.err").read_text()


def _first_line(path: Path) -> str:
    """Of what a program says, once it is whole."""
    began = time.monotonic()
    while time.monotonic() < began + _LONGEST_S:
        line, end, _ = (path.read_text() if path.exists() else "").partition("\n")
        if end:
            return line
        time.sleep(0.01)
    raise AssertionError(f"nothing was said: {path.with_suffix('.err').read_text()}")


def _judge_record(job: Path, record: dict, folder: Path, outcome: Outcome) -> None:
    drawn = {line["line"]: line["beam_on_mm"] for line in record["drawn"]}
    outcome.repeated_mm = record["verdict"]["repeated_mm"]
    with JobReader(job) as reader:
        lines = np.concatenate([layer.lines for layer in reader.iterate_layers()])
    ends = np.column_stack([lines["x_mm"], lines["y_mm"], lines["z_mm"]])
    length = np.linalg.norm(np.diff(ends, axis=0, prepend=ends[:1]), axis=1)
    beads = np.flatnonzero(lines["kind"] == LineKind.BEAD)
    short = outcome.shortfalls
    if outcome.recovered.startswith("done") or outcome.state == "done":
        missing = [n for n in beads.tolist() if drawn.get(n, 0.0) < length[n] - 0.05]
        if missing:
            short.append(f"lines {missing[:5]} are missing")
    if outcome.repeated_mm > MOST_REPEATED_MM:
        short.append("more was deposited twice than the overlap")
    if record["verdict"]["beam_on_without_motion"]:
        short.append("the beam was on without motion")
    if record["verdict"]["rx_overrun_bytes"]:
        short.append("bytes were lost")
    for journal in sorted(folder.glob("runs/*/journal.jsonl")):
        short += _false_claims(journal, lines, length, drawn)


def _false_claims(journal: Path, lines: np.ndarray, length: np.ndarray, drawn: dict) -> list[str]:
    claimed = {r["path"] for r in read_records(journal) if r["kind"] == "executed"}
    return [
        f"{journal.parent.name} claims path {path}, which was not executed"
        for path in sorted(claimed)
        for n in np.flatnonzero((lines["path"] == path) & (lines["kind"] == LineKind.BEAD)).tolist()
        if drawn.get(n, 0.0) < length[n] - 0.05
    ]


def shortened(name: str) -> str:
    text = (files("lmctl.examples") / name).read_text()
    for old, new in SHORT.items():
        text = text.replace(old, new)
    return text


def wired(endpoints: dict[str, str]) -> str:
    text = shortened("cell.toml").replace('"tcp://127.0.0.1:2323"', f'"{endpoints["motion"]}"')
    for name, port in (("F1", "5021"), ("F2", "5022")):
        text = text.replace(f'"modbus-tcp://127.0.0.1:{port}"', f'"{endpoints[name]}"')
    return text


def write_small_job(folder: Path) -> Path:
    """Two layers of two squares, nine seconds of program."""
    from tests.run.conftest import squares, write_job

    cell, job = folder / "cell.toml", folder / "job.lmj"
    cell.write_text(shortened("cell.toml"))
    layers = squares(layers=2, per_layer=2, side_mm=SIDE_MM, speed_mm_s=SPEED_MM_S)
    write_job(job, load_profile(cell), layers)
    return job


def main() -> int:
    kills, first = (*map(int, sys.argv[1:]), *(100, 0)[len(sys.argv) - 1:])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        outcomes = run_kills(write_small_job(folder), range(first, first + kills), folder / "kills")
    print("seed  killed at  in state     recovered   repeated")
    for outcome in outcomes:
        print(outcome.row())
    wrong = [outcome for outcome in outcomes if outcome.shortfalls]
    for outcome in wrong:
        print(f"to repeat: {outcome.repeat}")
    print(f"{kills} kills, {len(wrong)} fell short; most repeated "
          f"{max(outcome.repeated_mm for outcome in outcomes):.2f} mm")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
