"""The journal of what is done to a machine by hand, on a disk that takes less than it is given."""

from __future__ import annotations

import errno
import os
from importlib.resources import files

import pytest

from lmctl.config.machine import load_profile
from lmctl.errors import JournalError
from lmctl.run.journal.format import read_records, verify_journal
from lmctl.run.journal.manual_journal import MachineJournal

PROFILE = load_profile(files("lmctl.examples") / "cell.toml")


def test_a_record_that_the_disk_takes_in_pieces_is_written_whole(tmp_path, monkeypatch):
    write = os.write
    monkeypatch.setattr("os.write", lambda fd, data: write(fd, data[:50]))
    journal = MachineJournal(tmp_path, PROFILE)
    journal.append("act", do="home")
    journal.append("ended", do="home")
    found = verify_journal(journal.path)
    assert (found.intact, found.dropped_bytes) == (True, 0)
    assert [record["kind"] for record in read_records(journal.path)] == ["header", "act", "ended"]


def test_a_full_disk_is_said_before_anything_is_done(tmp_path, monkeypatch):
    journal = MachineJournal(tmp_path, PROFILE)
    journal.append("act", do="home")
    write, room = os.write, [70]

    def nearly_full(fd, data):
        if not room[0]:
            raise OSError(errno.ENOSPC, "No space left on device")
        taken = write(fd, data[: room[0]])
        room[0] -= taken
        return taken

    monkeypatch.setattr("os.write", nearly_full)
    with pytest.raises(JournalError, match="cannot write"):
        journal.append("act", do="jog")
    monkeypatch.setattr("os.write", write)
    journal.append("act", do="unlock")
    assert [record.get("do") for record in read_records(journal.path)] == [None, "home", "unlock"]
