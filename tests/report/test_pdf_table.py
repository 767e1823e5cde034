"""Tables on PDF pages: nothing is lost at a page break, nothing is wider than the page."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reportlab.pdfbase.pdfmetrics import stringWidth

from lmctl.report.job_report.document import (
    ReportDocument,
    ReportSection,
    TableBlock,
    TableColumn,
)
from lmctl.report.job_report.pdf_table import SANS_BOLD, RuledTable
from lmctl.report.job_report.report_pdf import report_as_pdf

WIDTH, HEIGHT = 510.0, 700.0

words = st.text(st.sampled_from("ab 0.→θ"), max_size=60)
numbers = st.floats(-1e6, 1e6).map(lambda value: f"{value:.2f}")


@pytest.fixture(scope="module", autouse=True)
def fonts():
    report_as_pdf(ReportDocument("a", "b", "c", (ReportSection("d", ()),)))


@st.composite
def tables(draw):
    is_text = draw(st.lists(st.booleans(), min_size=1, max_size=13))
    row = st.tuples(*(st.one_of(st.none(), words) if text else numbers for text in is_text))
    rows = draw(st.lists(row, min_size=1, max_size=60))
    return TableBlock(
        tuple(TableColumn("head\nline", is_text=text, group="g" if text else "")
              for text in is_text),
        tuple(rows), has_sum=draw(st.booleans()))


@settings(max_examples=20, deadline=None)
@given(table=tables(), first_height=st.floats(60.0, HEIGHT))
def test_pages_hold_every_row_once_and_in_order(table, first_height):
    rest, height, rows = [RuledTable(table)], first_height, []
    while rest:
        one = rest.pop(0)
        wide, high = one.wrap(WIDTH, height)
        assert wide <= WIDTH
        if high > height:
            parts = one.split(WIDTH, height)
            assert parts or height < HEIGHT, "no row fits on a whole page"
            rest = (parts or [one]) + rest
            if not parts:
                height = HEIGHT
            continue
        rows += one._table.rows
        assert sum(one._widths) <= WIDTH + 0.1 or one._size <= 4.6
        height = HEIGHT
    assert tuple(rows) == table.rows


def test_numbers_of_a_wide_table_stay_within_their_columns():
    rows = tuple(tuple(f"{10.0 ** (n % 6):.2f}" for n in range(13)) for _ in range(20))
    table = RuledTable(TableBlock(tuple(TableColumn("head") for _ in range(13)), rows))
    table.wrap(WIDTH, HEIGHT)
    for column, width in enumerate(table._widths):
        assert max(stringWidth(row[column], SANS_BOLD, table._size) for row in rows) < width
