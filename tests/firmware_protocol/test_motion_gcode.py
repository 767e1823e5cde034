"""Blocks into words, and the numbers both firmwares refuse them with."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.gcode import GcodeError, strip_comments_and_spaces, tokenise_block


def outcome(block: bytes) -> list[tuple[str, float]] | int:
    """The words, or the number the block is refused with."""
    try:
        return tokenise_block(block)
    except GcodeError as refused:
        return refused.code


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (b"", []),
        (b"(a comment)", []),
        (b"; another", []),
        (b"N120 G1 X10 F600", [("N", 120), ("G", 1), ("X", 10), ("F", 600)]),
        (b"g1x-1.5y+.25z3.", [("G", 1), ("X", -1.5), ("Y", 0.25), ("Z", 3)]),
        (b"G1 X1 55 Y2", [("G", 1), ("X", 155), ("Y", 2)]),
        (b"X 1 2.5", [("X", 12.5)]),
        (b"G1 X5 (abc", [("G", 1), ("X", 5)]),
        (b"G1 (x) X5 (y) Y6 ; Z7", [("G", 1), ("X", 5), ("Y", 6)]),
        (b"/G1 X1", [("G", 1), ("X", 1)]),
        (b"G38.2 X1", [("G", 38.2), ("X", 1)]),
        (b"X1E5", [("X", 1), ("E", 5)]),
        (b"M67 E0 Q500", [("M", 67), ("E", 0), ("Q", 500)]),
    ],
)
def test_words(line, words):
    assert tokenise_block(line) == words


@pytest.mark.parametrize(
    ("line", "code"),
    [
        (b"FOO", 2), (b"G1 X", 2), (b"M3 S", 2), (b"X1 Y", 2), (b"X--1", 2), (b"X.", 2),
        (b"XNAN", 2), (b"XINF", 2), (b"12", 1), (b"1 2", 1), (b"X1.5.2", 1), (b"G1 X1_0", 1),
        (b"X1 #2", 1), (b"X\xb2", 2), (b"X1\xb2", 1), (b"-5", 1), (b"G1 -5 X2", 1),
    ],
)
def test_refused_blocks(line, code):
    with pytest.raises(GcodeError) as refused:
        tokenise_block(line)
    assert refused.value.code == code


def test_bad_lines_of_the_transcripts_are_refused_as_the_firmware_refuses_them(scenarios):
    """Where Grbl answered 1 or 2, so do we; where it answered otherwise, the text is sound."""
    checked = 0
    for scenario in scenarios:
        if scenario.dialect != "grbl" or scenario.name != "bad-lines":
            continue
        answers = [line for line in scenario.received if line == "ok" or line[:6] == "error:"]
        for sent, answer in zip(scenario.sent, answers, strict=False):
            if sent.startswith(b"$"):
                continue
            checked += 1
            read = outcome(sent.rstrip(b"\n"))
            if isinstance(read, int):
                assert answer == f"error:{read}"
            else:
                assert answer not in ("error:1", "error:2")
    assert checked == 15


@given(st.lists(st.tuples(st.sampled_from("GNXYZFSMEIJ"), st.integers(-99999, 99999)), max_size=9))
def test_words_written_come_back_however_they_are_spaced(words):
    expected = [(letter, number / 1000) for letter, number in words]
    texts = [f"{letter}{number / 1000:.3f}" for letter, number in words]
    tight = "".join(texts)
    for text in (" ".join(texts), tight, " ".join(tight), tight.lower()):
        assert tokenise_block(text.encode()) == expected


@given(st.binary(max_size=60))
def test_any_bytes_give_finite_words_or_a_code(line):
    words = outcome(line)
    if isinstance(words, int):
        assert words in (1, 2)
    else:
        assert all("A" <= letter <= "Z" and abs(value) < 1e60 for letter, value in words)


@given(st.text(alphabet="0123456789.+- GXNE_(;)", max_size=20))
def test_the_fast_reading_agrees_with_the_strict_one(text):
    """Spaces never matter: a block with and without them reads the same."""
    line = text.encode()
    assert outcome(line) == outcome(strip_comments_and_spaces(line))
