"""A fault file: which faults happen to the simulated cell, and when.

    [[fault]]
    kind = "disc_stalls"        # a name of `kinds.FAULT_KINDS`, its parameters beside it
    device = "F1"
    channel = 1
    at_s = 30.0                 # or at_line = 120
                                # or at_level_g = { feeder = "F1", channel = 1, grams = 50 }
    for_s = 5.0                 # lasting kinds only; without it no limit
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firmware_protocol.table_reader import TableReader
from simulators.bench_config import BenchConfig
from simulators.faults.kinds import FAULT_KINDS, Fault, FaultTarget, find_mistakes

MAX_FAULTS = 1000
MAX_BYTES = 1_000_000
_MAX_S = 1e7
_MAX_LINE = 9_999_999

_WHEN = ("at_s", "at_line", "at_level_g")
_OWN_KEYS = ("kind", "device", "channel", "for_s", *_WHEN)


class FaultPlanError(ValueError):
    """The text is no fault file for this bench; one line per mistake."""

    def __init__(self, mistakes: list[str]) -> None:
        super().__init__("\n".join(mistakes))
        self.mistakes = tuple(mistakes)


@dataclass(frozen=True)
class AtTime:
    """Seconds after the plan was scheduled."""

    at_s: float


@dataclass(frozen=True)
class AtLine:
    """When the axes begin the first move whose N word is at least `line`."""

    line: int


@dataclass(frozen=True)
class AtLevel:
    """When at most this mass of powder is left in a hopper."""

    feeder: str
    channel: int
    grams: float


@dataclass(frozen=True)
class PlannedFault:
    """A fault and its trigger. for_s : how long it stays, None without limit"""

    fault: Fault
    trigger: AtTime | AtLine | AtLevel
    for_s: float | None = None


@dataclass(frozen=True)
class FaultPlan:
    """The faults to inject, with their triggers."""

    faults: tuple[PlannedFault, ...] = ()

    @classmethod
    def parse(cls, text: str, bench: BenchConfig) -> FaultPlan:
        """Raises FaultPlanError with every mistake, each with the path of its key."""
        try:
            data = tomllib.loads(text)
        except (tomllib.TOMLDecodeError, RecursionError) as error:
            raise FaultPlanError([f"not valid TOML: {error}"]) from None
        mistakes: list[str] = []
        top = TableReader(data, "", mistakes)
        readers = top.tables("fault")
        tables = data["fault"] if readers else []
        top.report_unknown_keys()
        if len(readers) > MAX_FAULTS:
            raise FaultPlanError([f"fault: at most {MAX_FAULTS} faults, here are {len(readers)}"])
        if not mistakes and not readers:
            mistakes.append("there is no [[fault]] in it")
        cell = _Cell(
            {f.name: {h.channel for h in f.hoppers} for f in bench.feeders},
            bench.safety is not None,
        )
        planned = [
            _planned(reader, table, cell)
            for reader, table in zip(readers, tables, strict=True)
        ]
        if mistakes:
            raise FaultPlanError(mistakes)
        return cls(tuple(one for one in planned if one is not None))

    @classmethod
    def load(cls, path: Path, bench: BenchConfig) -> FaultPlan:
        """Raises OSError where the file cannot be read; FaultPlanError."""
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise FaultPlanError([f"larger than {MAX_BYTES} bytes"])
        try:
            return cls.parse(data.decode("utf-8"), bench)
        except UnicodeDecodeError as error:
            raise FaultPlanError([f"not text: byte {error.start} is not UTF-8"]) from None


@dataclass(frozen=True)
class _Cell:
    """Devices of a bench. channels : hopper channels by feeder"""

    channels: Mapping[str, set[int]]
    safety: bool

    def devices(self, fault_target: FaultTarget) -> list[str]:
        """Names that may be given for a device."""
        safety = ["safety"] if self.safety else []
        if fault_target is FaultTarget.LINK:
            return ["motion", *safety, *self.channels]
        return [*(safety if fault_target is FaultTarget.MODBUS else []), *self.channels]


def _planned(reader: TableReader, table: Mapping[str, Any], cell: _Cell) -> PlannedFault | None:
    known = len(reader.mistakes)
    kind = reader.text("kind")
    device = reader.text("device") if "device" in table else ""
    channel = reader.integer("channel", least=1, most=4) if "channel" in table else 0
    when = _when(reader, table, cell)
    for_s = reader.number("for_s", above=0, most=_MAX_S) if "for_s" in table else None
    values = {key: value for key, value in table.items() if key not in _OWN_KEYS}
    if kind != "?" and device != "?":
        for mistake in find_mistakes(kind, device, channel, values):
            key, _, reason = mistake.partition(": ")
            reader.report_mistake(key, reason)
    if kind in FAULT_KINDS:
        if for_s is not None and not FAULT_KINDS[kind].is_lasting:
            reader.report_mistake("for_s", f"{kind} is over as soon as it has happened")
        if FAULT_KINDS[kind].target is FaultTarget.SAFETY and not cell.safety:
            reader.report_mistake("kind", f"the bench has no safety device for {kind}")
        if device not in ("", "?"):
            _check_device(reader, FAULT_KINDS[kind].target, device, channel or 1, cell)
    if len(reader.mistakes) > known or when is None:
        return None
    return PlannedFault(Fault.create(kind, device, channel, **values), when, for_s)


def _when(
    reader: TableReader, table: Mapping[str, Any], cell: _Cell
) -> AtTime | AtLine | AtLevel | None:
    given = [key for key in _WHEN if key in table]
    if len(given) != 1:
        reader.report_mistake("", f"needs one of {', '.join(_WHEN)}")
        return None
    if given == ["at_s"]:
        return AtTime(reader.number("at_s", least=0, most=_MAX_S))
    if given == ["at_line"]:
        return AtLine(reader.integer("at_line", least=0, most=_MAX_LINE))
    level = reader.table("at_level_g")
    feeder = level.text("feeder")
    channel = level.integer("channel", 1, least=1, most=4)
    grams = level.number("grams", least=0, most=1e6)
    level.report_unknown_keys()
    if feeder != "?":
        _check_hopper(level, "feeder", feeder, channel, cell)
    return AtLevel(feeder, channel, grams)


def _check_device(
    reader: TableReader, fault_target: FaultTarget, device: str, channel: int, cell: _Cell
) -> None:
    if fault_target is FaultTarget.HOPPER:
        _check_hopper(reader, "device", device, channel, cell)
    elif fault_target in (FaultTarget.LINK, FaultTarget.MODBUS, FaultTarget.FEEDER):
        _check_name(reader, "device", device, cell.devices(fault_target))


def _check_hopper(
    reader: TableReader, key: str, feeder: str, channel: int, cell: _Cell
) -> None:
    there = _check_name(reader, key, feeder, list(cell.channels))
    if there and channel not in cell.channels[feeder]:
        reader.report_mistake("channel", f"feeder {feeder!r} has no hopper {channel}")


def _check_name(reader: TableReader, key: str, name: str, there: list[str]) -> bool:
    if name not in there:
        reader.report_mistake(
            key, f"there is no {name!r} for it in the bench; it has {', '.join(there)}")
    return name in there
