"""What was done to a machine by hand: homed, jogged, unlocked. One file a machine, never sealed.

An act is journaled before it begins, and again when it has ended.
"""

from __future__ import annotations

import re
from pathlib import Path

from lmctl.run.journal.shared_journal import SharedJournal


class MachineJournal(SharedJournal):
    """The journal of one machine, in the folder of runs. name : the profile's."""

    def __init__(self, runs_dir: Path, name: str) -> None:
        super().__init__(runs_dir / f"machine-{_plain(name)}.jsonl", {"machine": name})


def _plain(name: str) -> str:
    """A profile's name as part of a file's."""
    return re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-").lower()[:60] or "unnamed"
