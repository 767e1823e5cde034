"""A report as PDF, A4 portrait, from the same document as the HTML; needs the extra `pdf`."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from lmctl.errors import UsageError
from lmctl.report.job_report.document import (
    Block,
    FieldList,
    PictureBlock,
    ReportDocument,
    ReportSection,
    SignatureBlock,
    TableBlock,
    TextBlock,
)

try:
    from reportlab.lib.colors import HexColor
    from reportlab.lib.pagesizes import A4
    from reportlab.lib.styles import ParagraphStyle
    from reportlab.lib.units import mm
    from reportlab.pdfbase import pdfmetrics
    from reportlab.pdfbase.ttfonts import TTFont
    from reportlab.pdfgen.canvas import Canvas
    from reportlab.platypus import (
        BaseDocTemplate,
        CondPageBreak,
        Flowable,
        Frame,
        Image,
        KeepTogether,
        PageBreak,
        PageTemplate,
        Paragraph,
        Spacer,
    )
except ImportError as error:
    raise UsageError(
        "PDF reports need the package reportlab", where=str(error),
        hint="`pip install 'lmctl[pdf]'`, or write the report as .html and print that") from None

from lmctl.report.job_report.pdf_table import SANS, SANS_BOLD, RuledTable

_MARGIN, _FOOT = 15 * mm, 18 * mm
_WIDTH = A4[0] - 2 * _MARGIN
_LABEL = 44 * mm
_INK, _GREY = HexColor("#111111"), HexColor("#333333")


def report_as_pdf(document: ReportDocument) -> bytes:
    """The whole file. Equal documents make equal bytes."""
    _register_fonts()
    file = io.BytesIO()
    template = BaseDocTemplate(
        file, pagesize=A4, invariant=1, title=document.title, author="lmctl",
        leftMargin=_MARGIN, rightMargin=_MARGIN, topMargin=_MARGIN, bottomMargin=_FOOT)
    frame = Frame(_MARGIN, _FOOT, _WIDTH, A4[1] - _MARGIN - _FOOT, 0, 0, 0, 0)
    template.addPageTemplates(PageTemplate("page", [frame]))

    class NumberedCanvas(Canvas):
        """Prints the foot of each page when the number of pages is known."""

        def __init__(self, *args: Any, **kwargs: Any) -> None:
            super().__init__(*args, **kwargs)
            self._pages: list[dict[str, Any]] = []

        def showPage(self) -> None:
            self._pages.append(dict(self.__dict__))
            self._startPage()

        def save(self) -> None:
            for number, page in enumerate(self._pages, start=1):
                self.__dict__.update(page)
                self.setFont(SANS, 7)
                self.setFillColor(_GREY)
                self.drawString(_MARGIN, 10 * mm, document.footer)
                self.drawRightString(A4[0] - _MARGIN, 10 * mm,
                                     f"page {number} of {len(self._pages)}")
                super().showPage()
            super().save()

    template.build(list(_story(document)), canvasmaker=NumberedCanvas)
    return file.getvalue()


def _register_fonts() -> None:
    """The fonts that come with matplotlib: they have every sign that a report prints."""
    import matplotlib

    folder = Path(matplotlib.get_data_path()) / "fonts/ttf"
    for name, file in ((SANS, "DejaVuSans.ttf"), (SANS_BOLD, "DejaVuSans-Bold.ttf")):
        if name not in pdfmetrics.getRegisteredFontNames():
            pdfmetrics.registerFont(TTFont(name, str(folder / file)))


def _style(size: float, **options: Any) -> ParagraphStyle:
    return ParagraphStyle(
        f"{size}", fontName=options.pop("font", SANS), fontSize=size, leading=size * 1.3,
        textColor=options.pop("colour", _INK), splitLongWords=1, **options)


def _text(text: str, style: ParagraphStyle) -> Flowable:
    escaped = text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return Paragraph(escaped, style)


def _story(document: ReportDocument) -> Iterator[Flowable]:
    yield _text(document.title, _style(16, font=SANS_BOLD))
    yield _text(document.subtitle, _style(9, colour=_GREY, spaceAfter=6))
    for section in document.sections:
        yield from _section(section)


def _section(section: ReportSection) -> Iterator[Flowable]:
    yield PageBreak() if section.on_new_page else CondPageBreak(38 * mm)
    yield Spacer(0, 3.5 * mm)
    yield _Heading(section.title)
    for block in section.blocks:
        yield from _block(block)


def _block(block: Block) -> Iterator[Flowable]:
    match block:
        case FieldList(rows):
            yield _Fields(rows)
        case TableBlock():
            yield RuledTable(block)
            yield Spacer(0, 1 * mm)
        case TextBlock(text, is_warning):
            if is_warning:
                yield _text(text, _style(8.5, font=SANS_BOLD, leftIndent=8, spaceBefore=3,
                                         spaceAfter=3, borderPadding=(1, 0, 1, 5), borderWidth=0,
                                         bulletIndent=0, firstLineIndent=0))
            else:
                yield _text(text, _style(7.5, colour=_GREY, spaceBefore=2, spaceAfter=2))
        case PictureBlock(png, width_mm, height_mm, caption):
            yield KeepTogether([
                Spacer(0, 2 * mm),
                Image(io.BytesIO(png), width_mm * mm, height_mm * mm, hAlign="LEFT"),
                _text(caption, _style(7.5, colour=_GREY))])
        case SignatureBlock(roles):
            yield KeepTogether([_SignatureLines(role) for role in roles])


class _Heading(Flowable):
    """A heading with a rule under it; it stays with what follows."""

    keepWithNext = 1

    def __init__(self, title: str) -> None:
        super().__init__()
        self._title = _text(title, _style(11.5, font=SANS_BOLD))

    def wrap(self, width: float, height: float) -> tuple[float, float]:
        self._width = width
        self._height = self._title.wrap(width, height)[1]
        return width, self._height + 2 * mm

    def draw(self) -> None:
        self._title.drawOn(self.canv, 0, 1.8 * mm)
        self.canv.setLineWidth(1.0)
        self.canv.line(0, 1.4 * mm, self._width, 1.4 * mm)


class _Fields(Flowable):
    """Names and values, one a line; a ruled blank where there is no value."""

    def __init__(self, rows: Sequence[tuple[str, str | None]]) -> None:
        super().__init__()
        self._names = [_text(name, _style(8.5, colour=_GREY)) for name, _ in rows]
        self._values = [None if value is None else _text(value, _style(8.5)) for _, value in rows]

    def wrap(self, width: float, height: float) -> tuple[float, float]:
        self._heights = [
            1.2 * mm + max(name.wrap(_LABEL - 2 * mm, height)[1],
                           4 * mm if value is None else value.wrap(width - _LABEL, height)[1])
            for name, value in zip(self._names, self._values, strict=True)]
        return width, sum(self._heights)

    def split(self, width: float, height: float) -> list[Flowable]:
        return []  # short: goes whole to the next page

    def draw(self) -> None:
        y = sum(self._heights)
        for name, value, height in zip(self._names, self._values, self._heights, strict=True):
            name.drawOn(self.canv, 0, y - name.height)
            if value is None:
                self.canv.setLineWidth(0.5)
                self.canv.line(_LABEL, y - 3.6 * mm, _LABEL + 70 * mm, y - 3.6 * mm)
            else:
                value.drawOn(self.canv, _LABEL, y - value.height)
            y -= height


class _SignatureLines(Flowable):
    """One role with lines for name, signature and date."""

    def __init__(self, role: str) -> None:
        super().__init__()
        self._role = role

    def wrap(self, width: float, height: float) -> tuple[float, float]:
        return width, 17 * mm

    def draw(self) -> None:
        canvas = self.canv
        canvas.setLineWidth(0.5)
        canvas.setFillColor(_INK)
        canvas.setFont(SANS, 8.5)
        canvas.drawString(0, 4 * mm, self._role)
        canvas.setFont(SANS, 6.5)
        for left, right, what in ((30, 85, "name"), (90, 140, "signature"), (145, 180, "date")):
            canvas.line(left * mm, 4 * mm, right * mm, 4 * mm)
            canvas.drawString(left * mm, 1 * mm, what)
