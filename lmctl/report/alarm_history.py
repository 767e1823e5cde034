"""The alarms of a run in the order they were raised: which was first, and when each cleared."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

#: Records kept of one run; a journal with more alarms than that has one that chatters.
MAX_ALARMS = 10_000


@dataclass(frozen=True)
class AlarmEntry:
    """One alarm of a run.

    seq : of the journal record; name : of the interlock; where : lines of detail
    is_first_out : no other alarm stood when it was raised, or it explains one that stood
    raised_s, cleared_s : machine time of the run; raised, cleared : wall clock (UTC)
    cleared_s : None where the run ended while it stood; how : its cause was gone, or acknowledged
    """

    run: str
    seq: int
    name: str
    what: str
    hint: str
    where: tuple[str, ...]
    is_first_out: bool
    raised_s: float
    raised: str
    cleared_s: float | None = None
    cleared: str = ""
    how: str = ""

    @property
    def duration_s(self) -> float | None:
        """For how long it stood; None where the run ended before it cleared."""
        return None if self.cleared_s is None else self.cleared_s - self.raised_s


class AlarmGatherer:
    """Gathers alarms from the records of one journal, in order."""

    def __init__(self) -> None:
        self._entries: list[AlarmEntry] = []
        self._standing: dict[str, int] = {}  # name → place in the list

    def take(self, record: dict[str, Any]) -> None:
        """Any record; those of other kinds change nothing."""
        if record["kind"] == "alarm" and len(self._entries) < MAX_ALARMS:
            self._raise(record)
        elif record["kind"] == "alarm_cleared":
            at = self._standing.pop(str(record["name"]), None)
            if at is not None:
                self._entries[at] = replace(
                    self._entries[at], cleared_s=float(record["t"]), cleared=_wall(record),
                    how=str(record["how"]))

    def entries(self, run: str) -> tuple[AlarmEntry, ...]:
        """All of them, as alarms of `run`."""
        return tuple(replace(one, run=run) for one in self._entries)

    def _raise(self, record: dict[str, Any]) -> None:
        explained = [name for name in record.get("explains", ()) if name in self._standing]
        is_first = len(explained) == len(self._standing)
        for name in explained:
            at = self._standing[name]
            self._entries[at] = replace(self._entries[at], is_first_out=False)
        self._standing[str(record["name"])] = len(self._entries)
        self._entries.append(AlarmEntry(
            "", int(record["seq"]), str(record["name"]), str(record["what"]),
            str(record.get("hint", "")),
            tuple(str(line) for line in record.get("local", {}).get("where", ())), is_first,
            float(record["t"]), _wall(record)))


def _wall(record: dict[str, Any]) -> str:
    return str(record.get("local", {}).get("wall", ""))
