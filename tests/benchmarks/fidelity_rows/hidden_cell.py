"""A cell whose truth is not what its profile believes, and its self-measurement over the wires."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from importlib.resources import files
from io import StringIO
from pathlib import Path

from lmctl.cli.__main__ import main

SHIPPED = files("lmctl.examples")

#: What the bench hides in `lmctl machine feeder-test` rows: 3 % noise correlated over 1 s.
NOISE = {"noise_rsd": 0.03, "noise_time_s": 1.0}


def write_cell(folder: Path) -> Path:
    """The shipped profile, reading a calibration beside it."""
    path = folder / "cell.toml"
    path.write_text((SHIPPED / "cell.toml").read_text() + "\n[calibration]\n")
    return path


def write_bench(
    folder: Path, hoppers: Sequence[dict[str, float]], name: str = "bench.toml"
) -> Path:
    """The shipped bench with each hopper's hidden truth: keys of its table, in hopper order."""
    blocks = (SHIPPED / "bench.toml").read_text().split("[[feeder.hopper]]")
    text = blocks[0]
    for block, hidden in zip(blocks[1:], hoppers, strict=True):
        table, rest = _split_table(block)
        kept = [line for line in table if line.partition("=")[0].strip() not in hidden]
        text += "[[feeder.hopper]]" + "\n".join(kept)
        text += "\n" + "\n".join(f"{key} = {value}" for key, value in hidden.items()) + "\n" + rest
    path = folder / name
    path.write_text(text)
    return path


def _split_table(block: str) -> tuple[list[str], str]:
    """The lines of a hopper's own table, and what follows it."""
    lines = block.split("\n")
    end = next((at for at, line in enumerate(lines) if line.startswith("[")), len(lines))
    return lines[:end], "\n".join(lines[end:])


def lmctl(*arguments: object) -> dict[str, object]:
    """Run a command and read the JSON object it prints. Raises RuntimeError where it fails."""
    out, told = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(told):
        code = main([str(argument) for argument in arguments])
    if code:
        raise RuntimeError(f"lmctl {' '.join(map(str, arguments))}: {code}\n{told.getvalue()}")
    found: dict[str, object] = json.loads(out.getvalue().splitlines()[-1])
    return found


def self_measured(cell: Path, bench: Path, folder: Path, *more: object) -> list[dict[str, object]]:
    """`lmctl machine feeder-test` on a bench; what it found of each hopper."""
    found = lmctl("machine", "feeder-test", "--sim", "--machine", cell, "--bench", bench,
                  "--runs", folder / "runs", "--plots", folder, "--operator", "bench",
                  "--json", *more)
    hoppers = found["hoppers"]
    assert isinstance(hoppers, list)
    return hoppers
