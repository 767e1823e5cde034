"""What was done to a machine by hand: homed, jogged, unlocked. One file a machine, never sealed.

An act is journaled before it begins, and again when it has ended. A simulated cell has a file of
its own beside that of the machine it stands for, and each one set up is another machine.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from lmctl.config.machine import MachineProfile
from lmctl.run.journal.format import read_records
from lmctl.run.journal.shared_journal import SharedJournal


class MachineJournal(SharedJournal):
    """The journal of one machine, in the folder of runs."""

    def __init__(self, runs_dir: Path, profile: MachineProfile) -> None:
        self._simulated_cell = profile.simulated_cell
        name = f"{profile.name} simulated" if self._simulated_cell else profile.name
        super().__init__(runs_dir / f"machine-{_plain(name)}.jsonl", {"machine": name})

    def append(self, kind: str, **fields: Any) -> None:
        """As that of every shared journal; a simulated cell is named."""
        cell = {"simulated_cell": self._simulated_cell} if self._simulated_cell else {}
        super().append(kind, **cell, **fields)

    def records_of_this_machine(self) -> list[dict[str, Any]]:
        """All records but the header and those of other simulated cells. Raises JournalError."""
        if not self.path.exists():
            return []
        return [record for record in read_records(self.path) if record["kind"] != "header"
                and record.get("simulated_cell", "") == self._simulated_cell]


def _plain(name: str) -> str:
    """A profile's name as part of a file's."""
    return re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-").lower()[:60] or "unnamed"
