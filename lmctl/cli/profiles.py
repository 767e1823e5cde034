"""Which machine profile a command works with: the one named, or the bench cell that ships."""

from __future__ import annotations

from importlib.resources import as_file, files
from pathlib import Path

from lmctl.config.machine import MachineProfile, load_profile


def profile_or_bench_cell(path: Path | None) -> MachineProfile:
    """The profile in `path`, or the example cell. Raises ConfigError."""
    if path is not None:
        return load_profile(path)
    with as_file(files("lmctl.examples") / "cell.toml") as shipped:
        return load_profile(shipped)
