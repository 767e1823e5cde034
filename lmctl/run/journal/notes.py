"""Notes on a run: why it deviated from the plan, and what was decided about it.

They are kept beside the journal, in a file of the same form, since a sealed journal takes nothing
more. Each note carries how many records the journal had and the hash of the last one: a journal
that was altered or exchanged afterwards does not match it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from lmctl.errors import JournalError
from lmctl.run.journal.format import JournalVerification, line_hashes, read_records, verify_journal
from lmctl.run.journal.run_folders import RunFolder
from lmctl.run.journal.shared_journal import SharedJournal

NOTES_FILE_NAME = "notes.jsonl"


class Disposition(StrEnum):
    """What was decided about a deviation."""

    ACCEPTED = "accepted"
    REWORKED = "reworked"
    SCRAPPED = "scrapped"


@dataclass(frozen=True)
class Note:
    """about : number (seq) of the journal record it is about, None for the run as a whole

    disposition : None where none is stated; operator : "" where not named
    journal_records : how many the journal had when the note was made
    """

    run: str
    text: str
    about: int | None
    disposition: Disposition | None
    operator: str
    uid: int | None
    wall: str
    journal_records: int


def notes_path(made: RunFolder) -> SharedJournal:
    """The file of a run's notes; it need not exist yet."""
    return SharedJournal(made.path / NOTES_FILE_NAME, {"notes_of": made.run})


def add_note(
    made: RunFolder, text: str, *, about: int | None = None, disposition: Disposition | None = None,
    operator: str = "",
) -> None:
    """Add a note to a run; on the disk when this returns.

    Raises JournalError where the journal is missing or altered, has no such record, or the note
    cannot be written.
    """
    *_, (records, last_hash) = line_hashes(made.journal)
    if about is not None and not 0 <= about < records:
        raise JournalError(f"{made.run} has no record {about}",
                           where=f"its records are 0 to {records - 1}",
                           hint=f"`{made.command('log')}` shows the numbers of its deviations")
    notes_path(made).append(
        "note", text=text, about=about, disposition=disposition, operator=operator,
        journal={"records": records, "sha256": last_hash},
    )


def read_notes(made: RunFolder) -> list[Note]:
    """Every note on a run, in order. Raises JournalError where the file is not what was written."""
    path = made.path / NOTES_FILE_NAME
    if not path.exists():
        return []
    return [_note(made.run, record) for record in read_records(path) if record["kind"] == "note"]


def verify_notes(journal: Path) -> JournalVerification | None:
    """The chain of the notes on a journal, and that it still is the one they were made on.

    None where there are no notes. Raises JournalError where a file cannot be read.
    """
    path = journal.parent / NOTES_FILE_NAME
    if not path.exists():
        return None
    found = verify_journal(path)
    if not found.intact:
        return found
    noted_at = {record["journal"]["records"] for record in read_records(path)
                if record.get("journal")}
    try:
        hashes = {number: hash_ for number, hash_ in line_hashes(journal) if number in noted_at}
    except JournalError as error:
        return JournalVerification(False, 1, error.what, 0, 0)
    for record in read_records(path):
        about = record.get("journal")
        if about and hashes.get(about["records"]) != about["sha256"]:
            reason = "the journal is not the one that this note was made on"
            return JournalVerification(False, int(record["seq"]) + 1, reason, int(record["seq"]), 0)
    return found


def _note(run: str, record: dict[str, Any]) -> Note:
    local = record.get("local", {})
    disposition = record["disposition"]
    return Note(
        run, str(record["text"]), record["about"],
        None if disposition is None else Disposition(disposition), str(record["operator"]),
        local.get("uid"), str(local.get("wall", "")), int(record["journal"]["records"]),
    )
