"""A report as plain data: sections of fields, tables, pictures and text, which any form can print.

The sections know nothing of pages, fonts or tags. Every form prints the same document, so that the
HTML and the PDF of a report never say different things.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True)
class FieldList:
    """Names with their values, one a line. A value of None is a ruled blank to be filled in."""

    rows: tuple[tuple[str, str | None], ...]


@dataclass(frozen=True)
class TableColumn:
    """heading : may be broken at "\\n"; width : relative to the other columns

    is_text : aligned to the left and wrapped; else a number, aligned to the right
    group : printed once above neighbours of the same group, "" for none
    """

    heading: str
    width: float = 1.0
    is_text: bool = False
    group: str = ""


@dataclass(frozen=True)
class TableBlock:
    """A table. rows : as many cells as columns; a cell of None is a ruled blank

    has_sum : the last row is a sum, set apart by a rule
    """

    columns: tuple[TableColumn, ...]
    rows: tuple[tuple[str | None, ...], ...]
    has_sum: bool = False


@dataclass(frozen=True)
class TextBlock:
    """A paragraph. is_warning : something a reader must not miss"""

    text: str
    is_warning: bool = False


@dataclass(frozen=True)
class PictureBlock:
    """A picture. png : its bytes; width_mm, height_mm : as printed; caption : what it shows"""

    png: bytes
    width_mm: float
    height_mm: float
    caption: str


@dataclass(frozen=True)
class SignatureBlock:
    """Ruled lines for names, signatures and dates. roles : who signs"""

    roles: tuple[str, ...]


Block = FieldList | TableBlock | TextBlock | PictureBlock | SignatureBlock


@dataclass(frozen=True)
class ReportSection:
    """A heading and what stands under it. on_new_page : it begins one in print"""

    title: str
    blocks: tuple[Block, ...]
    on_new_page: bool = False


@dataclass(frozen=True)
class ReportDocument:
    """title, subtitle : at the head; footer : at the foot of every page, beside its number"""

    title: str
    subtitle: str
    footer: str
    sections: tuple[ReportSection, ...] = field(default=())


def fields(rows: Sequence[tuple[str, str | None]]) -> FieldList:
    """Names with their values; empty values become ruled blanks."""
    return FieldList(tuple((name, value or None) for name, value in rows))
