"""The reference pages of keys: a table for each table of a file, made from the rows."""

from __future__ import annotations

from collections.abc import Sequence

from lmctl.reference.key_row import FILE_KINDS, KIND_OF_TABLE, KeyRow

_HEAD = ("<!-- Made from the models by `python -m tests.house.reference`: change the docstrings of "
         "the models. -->\n")
_COLUMNS = "| key | type | unit | default | range | example | meaning |\n" + "| --- " * 7 + "|\n"


def pages(rows: Sequence[KeyRow]) -> dict[str, str]:
    """A page for each kind of file, by its name."""
    return {f"{kind}-keys.md": _page(kind, title, [row for row in rows
                                                   if row.path.startswith(f"{kind}.")])
            for kind, title in FILE_KINDS.items()}


def _page(kind: str, title: str, rows: list[KeyRow]) -> str:
    text = (f"{_HEAD}# Keys of {title}\n\nEvery key, with its unit, default, range and an example. "
            f"`lmctl help {kind}.KEY` prints the same, and `lmctl schema {kind}` prints a JSON "
            "schema for editors. A key without default is left out or must be given, as its row "
            "says.\n")
    tables: dict[str, list[KeyRow]] = {}
    for row in rows:
        tables.setdefault(row.path.rpartition(".")[0], []).append(row)
    for table, those in tables.items():
        text += f"\n## `{table}`\n\n{_COLUMNS}" + "".join(map(_line, those))
    return text


def _line(row: KeyRow) -> str:
    if row.type == KIND_OF_TABLE:
        return f"| `kind = \"{row.key}\"` | | | | | | {row.text} |\n"
    default = f"`{row.default}`" if row.default else "required" if row.is_required else "–"
    meaning = row.text + (f" (keys as of `{row.same_as}`)" if row.same_as else "")
    cells = (f"`{row.key}`", row.type, row.unit, default, row.allowed, f"`{row.example}`", meaning)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"
