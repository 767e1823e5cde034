"""Printed logs: numbers as people write them, tables and wrapped text within 80 columns."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from lmctl.report.log_layout import LINE_WIDTH, format_duration, format_number, table_lines, wrapped


@settings(max_examples=50, deadline=None)
@given(st.floats(-1e6, 1e6), st.integers(0, 6))
def test_numbers_have_no_trailing_zeros_and_no_noise(value, decimals):
    text = format_number(value, decimals)
    assert abs(float(text) - value) <= 0.5 * 10**-decimals + 1e-9
    assert not ("." in text and text[-1] in ".0")
    assert text != "-0"
    assert len(text.partition(".")[2]) <= decimals


def test_rounding_never_gives_sixty_seconds():
    assert format_duration(59.96) == "0:01:00.0"
    assert format_duration(3599.99) == "1:00:00.0"
    assert format_duration(83.44) == "0:01:23.4"


@settings(max_examples=50, deadline=None)
@given(st.lists(st.text("abcdefg-", min_size=1, max_size=30), min_size=1, max_size=40))
def test_wrapped_text_keeps_its_words_and_its_width(words):
    head = "  0:00:12.3  12:00:01  #104   "
    lines = wrapped(head, " ".join(words)).splitlines()
    assert max(map(len, lines)) <= LINE_WIDTH
    assert " ".join(lines).split()[3:] == words


def test_columns_line_up_and_remarks_wrap():
    lines = table_lines(("layer", "<run", "path\nm", " remarks"), [
        ("1", "run-0001", "0.5", " " + "held " * 20), ("12", "x", "12.25", " "),
    ])
    assert lines[:2] == ["                  path", "layer  run           m  remarks"]
    assert lines[2].startswith("    1  run-0001    0.5  held held")
    assert lines[-1] == "   12  x         12.25"
    assert all(len(line) <= LINE_WIDTH for line in "\n".join(lines).splitlines())
