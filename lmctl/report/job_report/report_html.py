"""A report as one HTML file that needs nothing else: styles and pictures are in it, no scripts."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator
from html import escape
from itertools import groupby

from lmctl.report.job_report.document import (
    Block,
    FieldList,
    PictureBlock,
    ReportDocument,
    ReportSection,
    SignatureBlock,
    TableBlock,
    TableColumn,
    TextBlock,
)

_STYLE = """
@page { size: A4 portrait; margin: 14mm 14mm 18mm;
  @bottom-left { content: "FOOTER"; font: 7pt sans-serif; }
  @bottom-right { content: "page " counter(page) " of " counter(pages); font: 7pt sans-serif; } }
:root { color-scheme: light; }
body { font: 9.5pt/1.35 "DejaVu Sans", "Liberation Sans", Arial, sans-serif; color: #111;
  background: #fff; margin: 0 auto; max-width: 190mm; padding: 6mm; }
h1 { font-size: 16pt; margin: 0 0 1mm; }
.subtitle { margin: 0 0 5mm; color: #333; }
h2 { font-size: 11.5pt; margin: 6mm 0 2mm; padding-bottom: 0.6mm; border-bottom: 0.4mm solid #111;
  break-after: avoid; }
p { margin: 1.2mm 0; }
p.note { font-size: 8pt; color: #333; }
p.warning { border-left: 1.2mm solid #111; padding: 0.6mm 0 0.6mm 2mm; font-weight: bold; }
dl { display: grid; grid-template-columns: 44mm 1fr; margin: 0; }
dt { color: #333; padding: 0.5mm 0; }
dd { margin: 0; padding: 0.5mm 0; overflow-wrap: anywhere; }
.blank { display: inline-block; width: 70mm; border-bottom: 0.2mm solid #111; height: 1.1em; }
td .blank { width: 100%; min-width: 8mm; }
table { border-collapse: collapse; width: 100%; font-size: 7pt; line-height: 1.25;
  font-variant-numeric: tabular-nums; }
thead { display: table-header-group; }
tr { break-inside: avoid; }
th { font-weight: bold; text-align: right; vertical-align: bottom; padding: 0.5mm 0.9mm;
  white-space: pre-line; border-bottom: 0.25mm solid #111; }
th.group { text-align: center; border-bottom: 0.15mm solid #777; }
td { text-align: right; vertical-align: top; padding: 0.35mm 0.9mm; white-space: nowrap;
  border-bottom: 0.1mm solid #bbb; }
th.text, td.text { text-align: left; white-space: pre-line; overflow-wrap: anywhere; }
tr.sum td { border-top: 0.25mm solid #111; font-weight: bold; }
figure { margin: 3mm 0; break-inside: avoid; }
figure img { max-width: 100%; height: auto; display: block; }
figcaption { font-size: 8pt; color: #333; }
.signature { display: grid; grid-template-columns: 30mm 1fr 1fr 34mm; gap: 4mm; margin-top: 9mm;
  break-inside: avoid; }
.signature span { border-bottom: 0.2mm solid #111; }
.signature small { grid-column: 1 / -1; }
.new-page { break-before: page; }
@media print { body { max-width: none; padding: 0; } }
@media screen { .scroll { overflow-x: auto; } }
"""


def report_as_html(document: ReportDocument) -> str:
    """The whole file."""
    footer = document.footer.replace("\\", "").replace('"', "'")
    body = "\n".join(part for section in document.sections for part in _section(section))
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; style-src 'unsafe-inline'; img-src data:">
<title>{escape(document.title)}</title>
<style>{_STYLE.replace("FOOTER", escape(footer, quote=False).replace("<", ""))}</style>
</head>
<body>
<h1>{escape(document.title)}</h1>
<p class="subtitle">{escape(document.subtitle)}</p>
{body}
</body>
</html>
"""


def _section(section: ReportSection) -> Iterator[str]:
    yield f'<section{" class=new-page" if section.on_new_page else ""}>'
    yield f"<h2>{escape(section.title)}</h2>"
    for block in section.blocks:
        yield from _block(block)
    yield "</section>"


def _block(block: Block) -> Iterator[str]:
    match block:
        case FieldList(rows):
            yield "<dl>"
            for name, value in rows:
                yield f"<dt>{escape(name)}</dt><dd>{_value(value)}</dd>"
            yield "</dl>"
        case TableBlock():
            yield from _table(block)
        case TextBlock(text, is_warning):
            yield f'<p class="{"warning" if is_warning else "note"}">{escape(text)}</p>'
        case PictureBlock(png, width_mm, _, caption):
            data = b64encode(png).decode("ascii")
            yield (f'<figure><img style="width: {width_mm:g}mm" alt="{escape(caption)}" '
                   f'src="data:image/png;base64,{data}">'
                   f"<figcaption>{escape(caption)}</figcaption></figure>")
        case SignatureBlock(roles):
            for role in roles:
                yield (f'<div class="signature">{escape(role)}<span></span><span></span>'
                       "<span></span></div>")
            yield '<p class="note">name, signature, date</p>'


def _table(table: TableBlock) -> Iterator[str]:
    columns = table.columns
    yield '<div class="scroll"><table><thead>'
    if any(column.group for column in columns):
        cells = []
        for group, of_it in groupby(columns, key=lambda column: column.group):
            span = len(list(of_it))
            kind = " class=group" if group else ""
            cells.append(f"<th colspan={span}{kind}>{escape(group)}</th>")
        yield f"<tr>{''.join(cells)}</tr>"
    yield "<tr>" + "".join(
        f"<th{_class(column)}>{escape(column.heading)}</th>" for column in columns) + "</tr>"
    yield "</thead><tbody>"
    classes = [_class(column) for column in columns]
    for number, row in enumerate(table.rows, start=1):
        is_sum = table.has_sum and number == len(table.rows)
        yield f"<tr{' class=sum' if is_sum else ''}>" + "".join(
            f"<td{kind}>{_value(cell)}</td>" for kind, cell in zip(classes, row, strict=True)
        ) + "</tr>"
    yield "</tbody></table></div>"


def _class(column: TableColumn) -> str:
    return " class=text" if column.is_text else ""


def _value(value: str | None) -> str:
    return '<span class="blank"></span>' if value is None else escape(value)
