"""One run as its journal records it: what it is, what went into each layer, what happened, its end.

Nothing is computed here. Figures are read from the journal, where the run recorded them, under the
name of what they are: planned, reported, inferred, weighed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from lmctl.report.alarm_history import AlarmEntry, AlarmGatherer
from lmctl.report.events import LoggedEvent, event_of
from lmctl.report.interruptions import FirstEntry, Interruption, InterruptionGatherer
from lmctl.run.journal.figures import NO_FIGURES, ExecutionFigures
from lmctl.run.journal.format import JournalVerification, read_and_verify, read_records
from lmctl.run.journal.notes import NOTES_FILE_NAME, verify_notes
from lmctl.run.journal.writer import is_owned


@dataclass(frozen=True)
class LayerAccount:
    """What one run reports of one layer.

    reported, inferred : the second is contained in the first: no report showed its power or place
    unreported : what the run before this one executed of the layer without a report of it
    weighed_g : {hopper: weight lost in motion}, of hoppers that weigh
    place_error_mm : greatest distance of a reported place from the path
    feed_percent, power_percent : (least, greatest) override reported; None where none was
    entered_again, repeated_mm : how often the layer was entered in its middle, and bead planned to
        be deposited twice there
    began_s : machine time of the run; began, ended : wall clock (UTC), "" where not known
    reached_line, reached_share : place reached in the layer, by the last report
    complete : no bead of it is left; seq : of the journal record that states it, or None
    """

    layer: int
    reported: ExecutionFigures = NO_FIGURES
    inferred: ExecutionFigures = NO_FIGURES
    unreported: ExecutionFigures = NO_FIGURES
    weighed_g: dict[str, float] = field(default_factory=dict)
    place_error_mm: float = 0.0
    feed_percent: tuple[int, int] | None = None
    power_percent: tuple[int, int] | None = None
    entered_again: int = 0
    repeated_mm: float = 0.0
    began_s: float | None = None
    ended_s: float | None = None
    began: str = ""
    ended: str = ""
    reached_line: int = 0
    reached_share: float = 0.0
    complete: bool = False
    seq: int | None = None


@dataclass(frozen=True)
class PlannedLayer:
    """What the job plans for a whole layer. number : from 1; lines : first and last"""

    number: int
    z_mm: float
    lines: tuple[int, int]
    paths: int
    figures: ExecutionFigures


@dataclass(frozen=True)
class RunRecord:
    """One run.

    header, machine : the journal's own records; seal : its seal, {} where there is none
    planned : of each layer of which lines were about to be sent, by index from 0
    accounts : what became of them, in order
    purged_g : {hopper: powder fed into no layer}
    last_t_s : machine time of the last record; last_sent_line : last line of the paths sent,
        -1 for none
    alarms, interruptions : in order; first_entry : how the run entered the part
    refilled_g : {hopper: powder filled in, as the operator stated it}
    is_running : a living process writes the journal
    notes_verification : of the notes beside the journal, None where there are none
    """

    run: str
    journal: Path
    header: dict[str, Any]
    machine: dict[str, Any]
    planned: dict[int, PlannedLayer]
    accounts: tuple[LayerAccount, ...]
    purged_g: dict[str, float]
    events: tuple[LoggedEvent, ...]
    seal: dict[str, Any]
    last_t_s: float
    last_sent_line: int
    alarms: tuple[AlarmEntry, ...]
    interruptions: tuple[Interruption, ...]
    first_entry: FirstEntry
    refilled_g: dict[str, float]
    is_running: bool
    verification: JournalVerification
    notes_verification: JournalVerification | None

    @property
    def state(self) -> str:
        """How it ended; without a seal "running", or "broken off" where its process died."""
        return str(self.seal.get("state", "running" if self.is_running else "broken off"))

    @property
    def first_layer(self) -> int | None:
        """Index of the first layer it worked on itself, None before it began."""
        return min((one.layer for one in self.accounts if one.began), default=None)

    @property
    def continues(self) -> str:
        """The run whose part it continued, or ""."""
        return str(self.header.get("continues", ""))


def read_run(
    journal: Path, observe: Callable[[dict[str, Any]], None] | None = None
) -> RunRecord:
    """Gather one journal in one pass; samples are not kept.

    observe : is handed every record on the way, in order
    Raises JournalError where the file is missing or is no journal; KeyError, TypeError, ValueError
    or AttributeError where a record is not what lmctl writes.
    """
    gathered = _Gathered()

    def take(record: dict[str, Any]) -> None:
        gathered.take(record)
        if observe is not None:
            observe(record)

    verification = read_and_verify(journal, take)
    beside = journal.parent / NOTES_FILE_NAME
    for record in read_records(beside) if beside.exists() else ():
        if record["kind"] == "unreported":
            gathered.take_unreported(record)
    local = gathered.header.get("local", {})
    run = str(local.get("run") or journal.parent.name)
    return RunRecord(
        run, journal, gathered.header, gathered.machine,
        gathered.planned, gathered.accounts(), gathered.purged_g, tuple(gathered.events),
        gathered.end, gathered.last_t_s, gathered.sent_line, gathered.alarms.entries(run),
        gathered.interruptions.entries(run), gathered.interruptions.first_entry,
        gathered.refilled_g, is_owned(journal), verification, verify_notes(journal),
    )


class _Gathered:
    """What has been read so far."""

    def __init__(self) -> None:
        self.header: dict[str, Any] = {}
        self.machine: dict[str, Any] = {}
        self.planned: dict[int, PlannedLayer] = {}
        self.purged_g: dict[str, float] = {}
        self.events: list[LoggedEvent] = []
        self.end: dict[str, Any] = {}
        self.last_t_s = 0.0
        self.sent_line = -1
        self.alarms = AlarmGatherer()
        self.interruptions = InterruptionGatherer()
        self.refilled_g: dict[str, float] = {}
        self._opened: dict[int, LayerAccount] = {}
        self._open: dict[int, dict[str, Any]] = {}  # as the last samples carried them
        self._closed: list[LayerAccount] = []
        self._unreported: list[LayerAccount] = []

    def take(self, record: dict[str, Any]) -> None:
        self.last_t_s = float(record["t"])
        if (event := event_of(record)) is not None:
            self.events.append(event)
        self.alarms.take(record)
        self.interruptions.take(record)
        match record["kind"]:
            case "header":
                self.header = record
            case "machine":
                self.machine = record
            case "path":
                self.sent_line = max(self.sent_line, int(record["lines"][1]))
            case "samples":
                self._open = {int(one["layer"]): one for one in record["layers"]}
            case "layer_opened":
                self._take_plan(record)
            case "layer":
                self._open.pop(int(record["layer"]), None)
                self._closed.append(replace(
                    self._account(record), complete=bool(record["complete"]),
                    ended_s=self.last_t_s, ended=_wall(record), seq=int(record["seq"])))
                del self._opened[int(record["layer"])]
            case "unreported":
                self.take_unreported(record)
            case "purge":
                for name, grams in record["fed_g"].items():
                    self.purged_g[name] = self.purged_g.get(name, 0.0) + float(grams)
            case "refill":
                name, grams = str(record["hopper"]), float(record["mass_g"])
                self.refilled_g[name] = self.refilled_g.get(name, 0.0) + grams
            case "seal":
                self.end = record

    def take_unreported(self, record: dict[str, Any]) -> None:
        """Motion after the last report of a run, journaled by the run that found the machine."""
        self._unreported.append(LayerAccount(
            int(record["layer"]), unreported=ExecutionFigures.from_json(record["figures"]),
            reached_line=int(record["end"]["line"]), reached_share=float(record["end"]["share"]),
            complete=bool(record["complete"])))

    def accounts(self) -> tuple[LayerAccount, ...]:
        """Of every layer, also of those that were never closed: their host died."""
        open_now = [
            self._account(self._open[layer]) if layer in self._open else account
            for layer, account in self._opened.items()
        ]
        found = [*self._unreported, *self._closed, *open_now]
        return tuple(sorted(found, key=lambda one: one.layer))

    def _take_plan(self, record: dict[str, Any]) -> None:
        layer, (first, last) = int(record["layer"]), record["lines"]
        self.planned[layer] = PlannedLayer(
            layer + 1, float(record["z_mm"]), (int(first), int(last)), int(record["paths"]),
            ExecutionFigures.from_json(record["planned"]))
        self._opened[layer] = LayerAccount(
            layer, began_s=self.last_t_s, began=_wall(record), reached_line=int(first))

    def _account(self, values: dict[str, Any]) -> LayerAccount:
        layer = int(values["layer"])
        opened = self._opened[layer]
        return LayerAccount(
            layer, ExecutionFigures.from_json(values["reported"]),
            ExecutionFigures.from_json(values["inferred"]) if "inferred" in values else NO_FIGURES,
            NO_FIGURES,
            {str(name): float(grams) for name, grams in values.get("weighed_g", {}).items()},
            float(values["place_error_mm"]), _span(values["feed_percent"]),
            _span(values["power_percent"]), int(values.get("entered_again", 0)),
            float(values.get("repeated_mm", 0.0)), opened.began_s, None, opened.began, "",
            int(values["reached"]["line"]), float(values["reached"]["share"]),
        )


def _span(values: Any) -> tuple[int, int] | None:
    return None if values is None else (int(values[0]), int(values[1]))


def _wall(record: dict[str, Any]) -> str:
    return str(record.get("local", {}).get("wall", ""))
