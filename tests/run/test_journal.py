"""The run journal: what is written is read back, and no damage to it goes unseen."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tracemalloc

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lmctl.errors import JournalError, MissingFileError
from lmctl.run.journal.format import (
    UnsupportedFormatError,
    read_and_verify,
    read_records,
    run_fingerprint,
    verify_journal,
)
from lmctl.run.journal.recorder import RunRecorder
from lmctl.run.journal.writer import JournalWriter, is_owned

LOCAL = {"wall": "2026-01-01T00:00:00Z", "run": "run-0001", "pid": 4711}


def write(path, n=4, *, local=LOCAL, seal=True, flow=2.449):
    with JournalWriter(path, {"job": "ab" * 32, "operator": "Ada"}, local=local) as journal:
        for i in range(n):
            journal.append(i * 0.1, "sample", x_mm=1.5 * i, flow_g_min=[flow, 6.084])
        if seal:
            journal.seal(n * 0.1, state="done")
    return path


def unharmed(path):
    """Whether nothing shows that a journal was damaged."""
    try:
        result = verify_journal(path)
    except UnsupportedFormatError:  # it was the digit of the format that was hit
        return False
    return result.sealed and result.intact


def test_acts_wait_for_the_disk_only_where_something_follows_from_them(tmp_path, monkeypatch):
    """Sixteen clients may ask for what is refused, fifty times a second each."""
    synced = []
    with JournalWriter(tmp_path / "journal.jsonl", {}, local=LOCAL) as journal:
        recorder = RunRecorder(journal, lambda: 0.0, ["A"])
        monkeypatch.setattr(os, "fdatasync", synced.append)
        for _ in range(50):
            recorder.record_operator("resume", "", "cannot resume now", uid=1000)
        assert synced == []
        recorder.record_operator("hold", "Ada", "", uid=1000)
        assert len(synced) == 1
    said = [record["accepted"] for record in read_records(tmp_path / "journal.jsonl")
            if record["kind"] == "operator"]
    assert said == [False] * 50 + [True]


def test_what_is_written_is_read_back_in_order(tmp_path):
    records = list(read_records(write(tmp_path / "j", 3)))
    assert [r["seq"] for r in records] == [0, 1, 2, 3, 4]
    assert [r["kind"] for r in records] == ["header", "sample", "sample", "sample", "seal"]
    assert records[2]["t"] == 0.1
    assert records[2]["flow_g_min"] == [2.449, 6.084]
    assert records[0]["local"] == LOCAL
    assert records[-1]["state"] == "done"


def test_times_are_whole_microseconds(tmp_path):
    with JournalWriter(tmp_path / "j", {}, local={}) as journal:
        journal.append(0.1 + 0.2, "sample")
    assert list(read_records(tmp_path / "j"))[1]["t"] == 0.3


def test_a_sealed_journal_verifies(tmp_path):
    result = verify_journal(write(tmp_path / "j"))
    assert result.sealed
    assert result.intact
    assert (result.records, result.reason) == (6, "")


def test_a_journal_without_seal_is_whole_but_not_sealed(tmp_path):
    result = verify_journal(write(tmp_path / "j", seal=False))
    assert result.intact
    assert not result.sealed
    assert result.reason == "it has no seal"


def test_every_changed_byte_of_a_sealed_journal_is_found(tmp_path):
    path = write(tmp_path / "j", 1)
    sound = path.read_bytes()
    for position in range(len(sound)):
        for flip in (0x01, sound[position] ^ 0x0A):
            if flip == 0:
                continue
            altered = bytearray(sound)
            altered[position] ^= flip
            path.write_bytes(altered)
            assert not unharmed(path), (position, flip)


def test_every_removed_and_added_byte_of_a_sealed_journal_is_found(tmp_path):
    path = write(tmp_path / "j", 0)
    sound = path.read_bytes()
    for position in range(len(sound) + 1):
        for altered in (sound[:position], sound[:position] + sound[position + 1:],
                        sound[:position] + b"0" + sound[position:],
                        sound[:position] + b"\n" + sound[position:]):
            if altered == sound:
                continue
            path.write_bytes(altered)
            assert not unharmed(path), (position, altered)


@settings(max_examples=150, deadline=None,
          suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damage_to_a_large_journal_is_found(tmp_path, data):
    path = tmp_path / "large"
    if not path.exists():
        write(path, 400)
        path.rename(tmp_path / "sound")
        path.touch()
    sound = (tmp_path / "sound").read_bytes()
    at = data.draw(st.integers(0, len(sound) - 1))
    length = data.draw(st.integers(0, 300))
    instead = data.draw(st.binary(max_size=300))
    altered = sound[:at] + instead + sound[at + length:]
    path.write_bytes(altered)
    assert unharmed(path) == (altered == sound)


@settings(max_examples=100, deadline=None,
          suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_one_pass_reads_and_finds_what_two_passes_do(tmp_path, data):
    path = tmp_path / "journal.jsonl"
    path.unlink(missing_ok=True)
    write(path, seal=data.draw(st.booleans()))
    content = bytearray(path.read_bytes())
    at = data.draw(st.integers(0, len(content) - 1))
    match data.draw(st.sampled_from(["change", "remove", "cut", "leave"])):
        case "change":
            content[at] = data.draw(st.integers(0, 255))
        case "remove":
            del content[at]
        case "cut":
            del content[at:]
    path.write_bytes(content)

    def outcome(act):
        try:
            return act()
        except JournalError as error:
            return type(error), error.what, error.where

    def two_passes():
        return list(read_records(path)), verify_journal(path)

    def one_pass():
        records = []
        found = read_and_verify(path, records.append)
        return records, found

    assert outcome(one_pass) == outcome(two_passes)


def test_records_exchanged_or_left_out_are_found(tmp_path):
    path = write(tmp_path / "j", 5)
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([*lines[:2], lines[3], lines[2], *lines[4:]]))
    assert verify_journal(path).broken_line == 3
    path.write_bytes(b"".join([*lines[:2], *lines[3:]]))
    assert verify_journal(path).broken_line == 3


def test_the_line_after_an_altered_one_is_reported(tmp_path):
    path = write(tmp_path / "j", 5)
    path.write_bytes(path.read_bytes().replace(b'"x_mm":3.0', b'"x_mm":3.1'))
    result = verify_journal(path)
    assert result.broken_line == 5  # x_mm 3.0 stands in line 4
    assert result.reason == "it does not carry the hash of the line before it"


@pytest.mark.parametrize("cut", [1, 2, 30, 100])
def test_a_half_written_last_line_is_dropped_and_reported(tmp_path, cut):
    path = write(tmp_path / "j", 4, seal=False)
    sound = path.read_bytes()
    last = len(sound.splitlines(keepends=True)[-1])
    path.write_bytes(sound[:-cut])
    assert [r["kind"] for r in read_records(path)] == ["header", "sample", "sample", "sample"]
    result = verify_journal(path)
    assert result.intact
    assert not result.sealed
    assert result.dropped_bytes == last - cut


def test_equal_runs_have_equal_fingerprints_whatever_is_local(tmp_path):
    one = write(tmp_path / "1")
    two = write(tmp_path / "2", local={"wall": "2031", "run": "run-0009", "ports": [1, 2]})
    other = write(tmp_path / "3", flow=2.45)
    assert one.read_bytes() != two.read_bytes()
    assert run_fingerprint(one) == run_fingerprint(two)
    assert run_fingerprint(one) != run_fingerprint(other)


def test_a_second_writer_is_refused(tmp_path):
    path = tmp_path / "j"
    with JournalWriter(path, {}, local={}):
        assert is_owned(path)
        with pytest.raises(JournalError) as refused:
            JournalWriter(path, {}, local={})
        assert "still running" in refused.value.where[0]
    assert not is_owned(path)
    with pytest.raises(JournalError) as refused:
        JournalWriter(path, {}, local={})
    assert "earlier run" in refused.value.where[0]


def test_the_lock_dies_with_its_process(tmp_path):
    path = tmp_path / "j"
    code = (
        "import os, sys; from pathlib import Path\n"
        "from lmctl.run.journal.writer import JournalWriter\n"
        "j = JournalWriter(Path(sys.argv[1]), {'a': 1}, local={})\n"
        "j.append(1.0, 'path', path=1); j.sync(); j.append(2.0, 'sample')\n"
        "print('ready', flush=True); os.kill(os.getpid(), 9)"
    )
    child = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True)
    assert child.returncode == -9
    assert not is_owned(path)
    # What was synced is there; what only waited in memory is not.
    assert [r["kind"] for r in read_records(path)] == ["header", "path"]
    assert verify_journal(path).intact


def test_a_sealed_journal_takes_no_more(tmp_path):
    with JournalWriter(tmp_path / "j", {}, local={}) as journal:
        journal.seal(1.0, state="done")
        with pytest.raises(ValueError, match="sealed"):
            journal.append(2.0, "sample")


def test_not_a_number_never_reaches_a_journal(tmp_path):
    with (
        JournalWriter(tmp_path / "j", {}, local={}) as journal,
        pytest.raises(ValueError, match="not JSON compliant"),
    ):
        journal.append(0.0, "sample", flow=float("nan"))


@pytest.mark.parametrize(
    "content",
    [b"\n", b"{}\n", b"[1]\n", b"\xff\xfe\n", b'{"format":"other"}\n', b"[" * 100_000 + b"\n",
     b'{"format":"lmctl-journal-3","t":NaN}\n', b"9" * 10_000 + b"\n", b"solid cube\n"],
)
def test_what_is_no_journal_is_refused(tmp_path, content):
    path = tmp_path / "j"
    path.write_bytes(content)
    with pytest.raises(JournalError, match="is not a run journal"):
        list(read_records(path))
    result = verify_journal(path)
    assert result.broken_line == 1


@pytest.mark.parametrize("look", [verify_journal, lambda path: list(read_records(path))])
def test_a_journal_of_another_format_is_not_called_damaged_or_something_else(tmp_path, look):
    path = tmp_path / "j"
    path.write_text('{"seq":0,"format":"lmctl-journal-4","software":"lmctl 3.1"}\n{"later":1}\n')
    with pytest.raises(JournalError, match="is a journal of format 4") as refused:
        look(path)
    assert refused.value.where == ("lmctl 3.1 wrote it; this lmctl reads format 3",)
    assert "the lmctl that wrote it" in refused.value.hint


def test_a_journal_of_the_format_before_is_refused_with_the_new_names_of_its_fields(tmp_path):
    path = tmp_path / "j"
    path.write_text('{"seq":0,"format":"lmctl-journal-2"}\n')
    with pytest.raises(JournalError, match="is a journal of format 2") as refused:
        verify_journal(path)
    for names in ("lit_line is now beam_on_line", "stands_mm is now standstill_mm",
                  "stands is now active"):
        assert names in refused.value.where[0]


def test_a_line_without_end_is_refused_before_it_fills_memory(tmp_path):
    path = tmp_path / "j"
    with path.open("wb") as file:
        file.truncate(500_000_000)  # a hole: takes no disk
    with pytest.raises(JournalError, match="is not a run journal"):
        list(read_records(path))
    with pytest.raises(JournalError, match="is not a run journal"):
        verify_journal(path)


def test_missing_and_unwritable_are_reported(tmp_path):
    with pytest.raises(MissingFileError, match="there is no file"):
        verify_journal(tmp_path / "none")
    with pytest.raises(JournalError, match="cannot read"):
        list(read_records(tmp_path))
    with pytest.raises(JournalError, match="cannot write"):
        JournalWriter(tmp_path / "no" / "folder", {}, local={})


def test_an_empty_file_is_an_unsealed_journal_of_nothing(tmp_path):
    (tmp_path / "j").touch()
    assert list(read_records(tmp_path / "j")) == []
    assert not verify_journal(tmp_path / "j").sealed


def test_reading_takes_constant_memory(tmp_path):
    path = write(tmp_path / "j", 6_000)
    assert os.path.getsize(path) > 900_000
    tracemalloc.start()
    assert verify_journal(path).sealed
    assert sum(1 for _ in read_records(path)) == 6_002
    run_fingerprint(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100_000


def test_lines_are_plain_json(tmp_path):
    for line in write(tmp_path / "j").read_text("ascii").splitlines():
        assert json.loads(line)["kind"]
