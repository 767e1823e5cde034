"""Notes beside a journal: chained, bound to it, and no hindrance to its seal."""

from __future__ import annotations

from contextlib import suppress

import pytest

from lmctl.errors import JournalError
from lmctl.run.journal.format import verify_journal
from lmctl.run.journal.notes import NOTES_FILE_NAME, Disposition, add_note, read_notes, verify_notes
from lmctl.run.journal.run_folders import RunFolder
from lmctl.run.journal.writer import JournalWriter


@pytest.fixture
def made(tmp_path):
    """A run with a sealed journal of four records."""
    folder = RunFolder(tmp_path / "runs/run-0001")
    folder.path.mkdir(parents=True)
    with JournalWriter(folder.journal, {"job": "ab"},
                       local={"wall": "2026-01-01T00:00:00Z"}) as journal:
        journal.append(1.0, "fault", what="a spill", hint="")
        journal.append(2.0, "operator", act="hold")
        journal.seal(3.0, state="done")
    return folder


def test_notes_keep_reason_disposition_who_and_when(made):
    assert (read_notes(made), verify_notes(made.journal)) == ([], None)
    add_note(made, "powder was spilt", about=1, disposition=Disposition.ACCEPTED, operator="Ada")
    add_note(made, "the whole run was watched")
    first, second = read_notes(made)
    assert (first.run, first.text, first.about) == ("run-0001", "powder was spilt", 1)
    assert (first.disposition, first.operator, first.journal_records) == ("accepted", "Ada", 4)
    assert first.uid is not None
    assert first.wall.endswith("Z")
    assert (second.about, second.disposition) == (None, None)
    assert verify_notes(made.journal).intact
    assert verify_journal(made.journal).sealed  # as it was


def test_a_note_on_what_is_not_there_is_refused(made):
    with pytest.raises(JournalError, match="has no record 4"):
        add_note(made, "what?", about=4)
    assert not (made.path / NOTES_FILE_NAME).exists()


def test_a_journal_exchanged_or_altered_after_a_note_is_found(made):
    add_note(made, "all well", about=1)
    sound = made.journal.read_bytes()
    lines = sound.splitlines(keepends=True)
    made.journal.write_bytes(b"".join(lines[:3]))  # whole, but not what was noted on
    found = verify_notes(made.journal)
    assert "not the one that this note was made on" in found.reason
    made.journal.write_bytes(sound.replace(b"a spill", b"no spil"))
    assert "is not what was written" in verify_notes(made.journal).reason


def test_every_altered_byte_of_the_notes_is_found(made):
    add_note(made, "all well", about=1, disposition=Disposition.REWORKED)
    add_note(made, "again", about=2)
    path = made.path / NOTES_FILE_NAME
    sound = path.read_bytes()
    last = sound.rindex(b'{"prev"')  # what only its own text could prove, a chain cannot
    for at in range(0, last, 7):
        path.write_bytes(sound[:at] + bytes([sound[at] ^ 1]) + sound[at + 1:])
        with suppress(JournalError):  # it calls itself a journal of another form
            assert not verify_notes(made.journal).intact, at
