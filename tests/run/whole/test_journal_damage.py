"""The sealed journal of a real run: no byte of it can be changed unseen."""

from __future__ import annotations

import json
import re

import pytest

from lmctl.cli.__main__ import main
from lmctl.run.journal.format import verify_journal


@pytest.fixture
def journal(run, square_job):
    """The journal of a whole run with a hold in it."""
    one = run(square_job, acts=[
        (1.0, lambda r: r.executor.hold()), (8.0, lambda r: r.executor.resume()),
    ])
    assert one.result.state == "done"
    return one.journal


def places(data: bytes) -> list[int]:
    """Byte positions: every class of byte in every kind of record and under every key, and every
    byte of the first record, the last two, and each line's end.
    """
    found: dict[tuple, int] = {}
    lines = data.splitlines(keepends=True)
    at, whole = 0, []
    for number, line in enumerate(lines):
        kind = json.loads(line)["kind"]
        if number == 0 or number >= len(lines) - 2:
            whole += range(at, at + len(line))
        key = ""
        for token in re.finditer(rb'"[^"]*":|"[^"]*"|[0-9.+-]+|[a-z]+|[{}\[\],\n]', line):
            if token[0].endswith(b":"):
                key = token[0].decode()
            for place in {token.start(), token.end() - 1}:
                found.setdefault((kind, key, token[0][:1], place == token.start()), at + place)
        found[("end", number % 7)] = at + len(line) - 1
        at += len(line)
    return sorted({*found.values(), *whole[:: max(1, len(whole) // 100)]})


def test_any_byte_changed_in_a_sealed_journal_is_found(journal, capsys):
    data = bytearray(journal.read_bytes())
    assert verify_journal(journal).sealed
    looked = places(bytes(data))
    assert len(looked) > 300
    for at in looked:
        before = data[at]
        with journal.open("rb+") as file:
            for value in (before ^ 1, before ^ 0x20)[at % 2 :: 2]:
                file.seek(at)
                file.write(bytes((value,)))
                file.flush()
                assert not verify_journal(journal).sealed, (at, value)
            file.seek(at)
            file.write(bytes((before,)))
    assert verify_journal(journal).sealed


@pytest.mark.parametrize("where", [0.0, 0.3, 0.999])
def test_the_command_says_so_and_which_line(journal, capsys, where):
    name, runs = journal.parent.name, journal.parent.parent
    assert main(["log", name, "--runs", str(runs), "--verify"]) == 0
    capsys.readouterr()
    data = bytearray(journal.read_bytes())
    at = int(where * len(data))
    data[at] ^= 1
    journal.write_bytes(data)
    assert main(["log", name, "--runs", str(runs), "--verify"]) != 0
    said = capsys.readouterr()
    assert "line" in said.err
    assert "Traceback" not in said.err


def test_lines_left_out_swapped_or_doubled_are_found(journal):
    lines = journal.read_bytes().splitlines(keepends=True)
    for at in range(0, len(lines) - 1, 9):
        for changed in (lines[:at] + lines[at + 1 :], lines[: at + 1] + lines[at:],
                        [*lines[:at], lines[at + 1], lines[at], *lines[at + 2 :]]):
            journal.write_bytes(b"".join(changed))
            assert not verify_journal(journal).sealed
