"""A table on PDF pages: heads repeated, columns as wide as their numbers, text wrapped.

Drawn straight onto the page, since a part of a thousand layers has ten thousands of cells.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby

from reportlab.lib.colors import HexColor
from reportlab.lib.utils import simpleSplit
from reportlab.pdfbase.pdfmetrics import stringWidth
from reportlab.platypus import Flowable

from lmctl.report.job_report.document import TableBlock

SANS, SANS_BOLD = "lmctl-sans", "lmctl-sans-bold"

_SIZE, _SMALLEST = 6.8, 4.5
_PAD = 2.4
#: Least width of a column of text, in widths of a digit.
_LEAST_TEXT = 5.0
#: Longer words (digests, addresses) may be broken.
_LONGEST_WORD = 16
_INK, _RULE, _FAINT = HexColor("#111111"), HexColor("#777777"), HexColor("#bbbbbb")


class RuledTable(Flowable):
    """One table, or what is left of it after a page break."""

    def __init__(self, table: TableBlock) -> None:
        super().__init__()
        self._table = table
        self._size = _SIZE
        self._widths: list[float] = []
        self._cells: list[list[list[str] | None]] = []

    def wrap(self, width: float, height: float) -> tuple[float, float]:
        if not self._widths:
            self._lay_out(width)
        self._heights = [self._row_height(row) for row in self._cells]
        return width, self._head_height() + sum(self._heights)

    def split(self, width: float, height: float) -> list[Flowable]:
        """As many rows as fit, and the rest with the heads again."""
        self.wrap(width, height)
        left, rows = height - self._head_height(), 0
        while rows < len(self._heights) and self._heights[rows] <= left:
            left -= self._heights[rows]
            rows += 1
        if rows == 0 or rows == len(self._heights):
            return []
        return [self._part(slice(0, rows), has_sum=False),
                self._part(slice(rows, None), has_sum=self._table.has_sum)]

    def draw(self) -> None:
        y = sum(self._heights) + self._head_height()
        y = self._draw_heads(y)
        last = len(self._cells) - 1
        for number, (row, height) in enumerate(zip(self._cells, self._heights, strict=True)):
            is_sum = self._table.has_sum and number == last
            self._draw_row(y, row, SANS_BOLD if is_sum else SANS)
            if is_sum:
                self._rule(y, 0.7, _INK)
            y -= height
            self._rule(y, 0.3, _FAINT)

    # --- layout --------------------------------------------------------------------------------

    def _lay_out(self, width: float) -> None:
        columns = self._table.columns
        while True:
            natural = [self._natural_width(at) for at in range(len(columns))]
            if sum(natural) <= width or self._size <= _SMALLEST:
                break
            self._size -= 0.2
        spare = max(0.0, width - sum(natural))
        weights = [column.width if column.is_text else 0.0 for column in columns]
        if any(weights):
            # Text columns share what numbers leave, each by its weight.
            room = spare + sum(
                one for one, weight in zip(natural, weights, strict=True) if weight)
            share = [room * weight / sum(weights) for weight in weights]
            self._widths = [
                max(one, part) if weight else one
                for one, part, weight in zip(natural, share, weights, strict=True)]
            excess = sum(self._widths) - width
            if excess > 0:
                slack = [wide - one for wide, one in zip(self._widths, natural, strict=True)]
                self._widths = [
                    wide - excess * one / sum(slack) if sum(slack) else wide
                    for wide, one in zip(self._widths, slack, strict=True)]
        else:
            self._widths = [one + spare / len(columns) for one in natural]
        self._cells = [
            [None if cell is None else self._lines(at, cell) for at, cell in enumerate(row)]
            for row in self._table.rows]

    def _natural_width(self, at: int) -> float:
        column = self._table.columns[at]
        heads = [stringWidth(line, SANS_BOLD, self._size) for line in column.heading.split("\n")]
        if column.is_text:
            least = _LEAST_TEXT * stringWidth("0", SANS, self._size)
            # No word is broken but those that no column has room for.
            words = {word for row in self._table.rows for word in (row[at] or "").split()
                     if _LEAST_TEXT < len(word) <= _LONGEST_WORD}
            wide = (stringWidth(word, SANS, self._size) for word in words)
            return float(max(*heads, least, *wide)) + 2 * _PAD
        # Cells of one length are about equally wide: only the longest ones are measured.
        longest = max((len(row[at] or "") for row in self._table.rows), default=0)
        texts = {row[at] or "" for row in self._table.rows if len(row[at] or "") >= longest - 1}
        widths = [*heads, *(stringWidth(text, SANS_BOLD, self._size) for text in texts)]
        return float(max(widths)) + 2 * _PAD

    def _lines(self, at: int, cell: str) -> list[str]:
        if not self._table.columns[at].is_text or not cell:
            return [cell]
        room = self._widths[at] - 2 * _PAD
        lines: list[str] = []
        for line in simpleSplit(cell, SANS, self._size, room):
            lines += _broken(line, room, self._size)
        return lines

    def _row_height(self, row: list[list[str] | None]) -> float:
        lines = max(1 if cell is None else len(cell) for cell in row)
        height = lines * self._size * 1.22 + 2.2
        return max(height, 14.0) if None in row else height

    def _head_height(self) -> float:
        lines = max(column.heading.count("\n") + 1 for column in self._table.columns)
        groups = any(column.group for column in self._table.columns)
        return (lines + groups) * self._size * 1.22 + 4.0 + 3.0 * groups

    def _part(self, rows: slice, *, has_sum: bool) -> RuledTable:
        part = RuledTable(replace(self._table, rows=self._table.rows[rows], has_sum=has_sum))
        part._size, part._widths, part._cells = self._size, self._widths, self._cells[rows]
        return part

    # --- drawing -------------------------------------------------------------------------------

    def _draw_heads(self, y: float) -> float:
        canvas, line = self.canv, self._size * 1.22
        canvas.setFont(SANS_BOLD, self._size)
        canvas.setFillColor(_INK)
        if any(column.group for column in self._table.columns):
            x, at = 0.0, 0
            for group, of_it in groupby(self._table.columns, key=lambda column: column.group):
                count = len(list(of_it))
                width = sum(self._widths[at:at + count])
                if group:
                    canvas.drawCentredString(x + width / 2, y - line, group)
                    canvas.setLineWidth(0.4)
                    canvas.setStrokeColor(_RULE)
                    canvas.line(x + _PAD, y - line - 2.2, x + width - _PAD, y - line - 2.2)
                x, at = x + width, at + count
            y -= line + 3.0
        most = max(column.heading.count("\n") + 1 for column in self._table.columns)
        x = 0.0
        for column, width in zip(self._table.columns, self._widths, strict=True):
            lines = column.heading.split("\n")
            for number, text in enumerate(lines, start=most - len(lines)):
                self._put(text, x, y - (number + 1) * line, width, is_text=column.is_text)
            x += width
        y -= most * line + 4.0
        self._rule(y, 0.7, _INK)
        return y

    def _draw_row(self, y: float, row: list[list[str] | None], font: str) -> None:
        canvas, line = self.canv, self._size * 1.22
        canvas.setFont(font, self._size)
        canvas.setFillColor(_INK)
        x = 0.0
        for column, width, cell in zip(self._table.columns, self._widths, row, strict=True):
            if cell is None:
                canvas.setLineWidth(0.5)
                canvas.setStrokeColor(_INK)
                canvas.line(x + _PAD, y - 10.5, x + width - _PAD, y - 10.5)
            else:
                for number, text in enumerate(cell):
                    self._put(text, x, y - number * line - self._size - 0.6, width,
                              is_text=column.is_text)
            x += width

    def _put(self, text: str, x: float, y: float, width: float, *, is_text: bool) -> None:
        if is_text:
            self.canv.drawString(x + _PAD, y, text)
        else:
            self.canv.drawRightString(x + width - _PAD, y, text)

    def _rule(self, y: float, width: float, colour: HexColor) -> None:
        self.canv.setLineWidth(width)
        self.canv.setStrokeColor(colour)
        self.canv.line(0, y, sum(self._widths), y)


def _broken(line: str, room: float, size: float) -> list[str]:
    """A line in pieces where one word of it is wider than the column."""
    pieces = []
    while stringWidth(line, SANS, size) > room and len(line) > 1:
        fits = next(n for n in range(len(line) - 1, 0, -1)
                    if n == 1 or stringWidth(line[:n], SANS, size) <= room)
        pieces.append(line[:fits])
        line = line[fits:]
    return [*pieces, line]
