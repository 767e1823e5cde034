"""How a printed log is laid out: numbers, times, wrapped text and tables within 80 columns."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

#: Columns of a printed log.
LINE_WIDTH = 80

#: Stands where a figure is not known.
NO_VALUE = "–"


def format_number(value: float, decimals: int) -> str:
    """A number with at most so many decimals and no trailing zeros: 2.4, not 2.4000000000000004.

    >>> number(2.4000000000000004, 6), number(3.0, 2), number(-0.0004, 2)
    ('2.4', '3', '0')
    """
    text = f"{value:.{decimals}f}"
    if "." in text:
        text = text.rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def format_duration(seconds: float) -> str:
    """A duration: 0:01:23.4."""
    tenths = round(seconds * 10)
    minutes, rest = divmod(tenths, 600)
    hours, minutes = divmod(minutes, 60)
    return f"{hours:d}:{minutes:02d}:{rest / 10:04.1f}"


def date_of(wall: str) -> str:
    """The date of a wall clock stamp (ISO 8601, UTC), "" where there is none."""
    return wall[:10]


def time_of(wall: str) -> str:
    """The time of day of a wall clock stamp, to the second, "" where there is none."""
    return wall[11:19]


def wrapped(head: str, text: str, width: int = LINE_WIDTH) -> str:
    """A head and a text, later lines indented to the start of the text; no word is broken."""
    return textwrap.fill(
        text, width, initial_indent=head, subsequent_indent=" " * len(head),
        break_long_words=False, break_on_hyphens=False,
    ) or head.rstrip()


def table_lines(headings: Sequence[str], rows: Sequence[Sequence[str]],
                indent: str = "") -> list[str]:
    """Lines of a table. Columns are right-aligned; those whose heading begins with "<", left.

    A heading may have several lines, set apart by "\\n". The last column holds remarks where its
    heading begins with a space: its cells are wrapped.
    """
    is_left = [heading.startswith("<") for heading in headings]
    heads = [heading.removeprefix("<").split("\n") for heading in headings]
    height = max(map(len, heads))
    heads = [[""] * (height - len(lines)) + lines for lines in heads]
    has_remarks = headings[-1].startswith(" ")
    n = len(headings) - has_remarks
    widths = [
        max([*map(len, heads[column]), *(len(row[column]) for row in rows)]) for column in range(n)
    ]

    def line(cells: Sequence[str]) -> str:
        text = indent + "  ".join(
            cell.ljust(width) if left else cell.rjust(width)
            for cell, width, left in zip(cells, widths, is_left, strict=False))
        if has_remarks and cells[-1].strip():
            return wrapped(text + "  ", cells[-1].strip())
        return text.rstrip()

    return [line([lines[at] for lines in heads]) for at in range(height)] + [
        line(row) for row in rows]
