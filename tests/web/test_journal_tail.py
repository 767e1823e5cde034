"""Following a journal: in pieces, half written, without an end, far too long, damaged."""

from __future__ import annotations

import os
import tracemalloc

import pytest

from lmctl.run.journal.format import read_records
from lmctl.web.journal_tail import BACKLOG_BYTES, JournalTail, first_record

LINE = b'{"prev":"x","seq":%d,"t":1.5,"kind":"sent","line":7}\n'


def test_a_record_comes_once_and_only_when_it_is_whole(tmp_path, ended_run):
    path, text = tmp_path / "journal.jsonl", ended_run.journal.read_bytes()
    tail = JournalTail(path)
    assert tail.read_new().records == []
    found, steps = [], 997
    with path.open("wb", buffering=0) as file:
        for at in range(0, len(text), steps):
            file.write(text[at:at + steps])
            assert tail.has_grown()
            found += tail.read_new().records
            assert not tail.has_grown()
    assert found == list(read_records(ended_run.journal))
    assert tail.unreadable == 0


def test_a_journal_of_ten_gigabytes_is_read_from_near_its_end(tmp_path):
    path = tmp_path / "journal.jsonl"
    with path.open("wb") as file:
        file.write(LINE % 0)
        file.truncate(10 * 2**30)
        file.seek(0, os.SEEK_END)
        file.write(b"\n" + LINE % 1 + LINE % 2)
    tail = JournalTail(path)
    tracemalloc.start()
    read, records, more = 0, [], True
    while more:
        batch = tail.read_new()
        records, more, read = records + batch.records, batch.more, read + 1
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert [record["seq"] for record in records] == [1, 2]
    assert read <= 1 + BACKLOG_BYTES // 1_000_000 + 1
    assert peak < 20e6
    assert first_record(path)["seq"] == 0


def test_a_reader_that_has_fallen_far_behind_says_that_it_skipped(tmp_path):
    path = tmp_path / "journal.jsonl"
    path.write_bytes(LINE % 0)
    tail = JournalTail(path, backlog_bytes=1000)
    assert not tail.read_new().skipped
    with path.open("ab") as file:
        file.writelines(LINE % number for number in range(1, 200_000))
    batch = tail.read_new()
    assert batch.skipped
    assert batch.records[-1]["seq"] == 199_999
    assert len(batch.records) < 30


@pytest.mark.parametrize("damage", [
    b"\xff\xfe\x00\n", b"[1, 2]\n", b"{}\n", b"\n", b'{"t":NaN,"kind":"sent"}\n',
    b"[" * 100_000 + b"\n", b"x" * 3_000_000 + b"\n",
])
def test_a_damaged_line_is_left_out_and_what_follows_is_read(tmp_path, damage):
    path = tmp_path / "journal.jsonl"
    path.write_bytes(LINE % 0 + damage + LINE % 1)
    tail, records, more = JournalTail(path, backlog_bytes=10**7), [], True
    while more:
        batch = tail.read_new()
        records, more = records + batch.records, batch.more
    assert [record["seq"] for record in records] == [0, 1]


def test_a_file_cut_short_is_read_anew(tmp_path):
    path = tmp_path / "journal.jsonl"
    path.write_bytes(LINE % 0 + LINE % 1)
    tail = JournalTail(path)
    tail.read_new()
    path.write_bytes(LINE % 9)
    batch = tail.read_new()
    assert batch.skipped
    assert [record["seq"] for record in batch.records] == [9]
    assert tail.read_new().records == []


@pytest.mark.parametrize("text", [b"", b"no journal\n", b"[]\n", b"x" * 2_000_000])
def test_a_file_that_is_no_journal_has_no_header(tmp_path, text):
    path = tmp_path / "journal.jsonl"
    path.write_bytes(text)
    assert first_record(path) == {}
    assert first_record(tmp_path / "missing") == {}
