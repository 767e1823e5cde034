"""Recognise which of the project's TOML files a file is by the tables in it."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import Any

from lmctl.errors import ConfigError


class FileKind(StrEnum):
    """What a TOML file is, in words."""

    PART = "a part file"
    PROFILE = "a machine profile"
    BENCH = "a description of a simulated cell"
    FAULTS = "a fault file"
    MAP = "a register map"


#: Where a file of each kind goes instead.
_USES = {
    FileKind.PART: "lmctl plan FILE",
    FileKind.PROFILE: "--machine FILE",
    FileKind.BENCH: "--sim --bench FILE",
    FileKind.FAULTS: "lmctl run JOB --sim --faults FILE",
    FileKind.MAP: 'map = "FILE" of a feeder in a machine profile',
}


def file_kind_of(tables: Mapping[str, Any]) -> FileKind | None:
    """The kind of a file, or None where its tables do not show it.

    >>> file_kind_of({"material": [], "body": []})
    <FileKind.PART: 'a part file'>
    """
    if "body" in tables:
        return FileKind.PART
    if "fault" in tables:
        return FileKind.FAULTS
    if {"register", "hopper_register"} & tables.keys():
        return FileKind.MAP
    motion = tables.get("motion")
    if not isinstance(motion, dict):
        return FileKind.PROFILE if {"laser", "hopper"} <= tables.keys() else None
    if {"dialect", "settings", "rx_bytes"} & motion.keys() and "laser" not in tables:
        return FileKind.BENCH
    return FileKind.PROFILE


def refuse_other_kind(tables: Mapping[str, Any], wanted: FileKind, path: Path) -> None:
    """Raise ConfigError for a file that is of another kind than the one wanted."""
    found = file_kind_of(tables)
    if found is not None and found is not wanted:
        raise ConfigError(f"{path} is {found}, and {wanted} is wanted here",
                          hint=f"such a file is given as `{_USES[found]}`")
