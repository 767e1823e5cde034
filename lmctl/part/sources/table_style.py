"""How the lines of a point table are written: separators between columns, and decimal commas."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass

from lmctl.errors import InputError
from lmctl.part.sources.files import DataFile


@dataclass(frozen=True)
class TableStyle:
    """How a line is written: what is between its columns (None for blanks), and whether its
    numbers have decimal commas."""

    delimiter: str | None
    decimal_comma: bool

    def cells(self, line: str) -> list[str]:
        """The columns of a line, numbers with decimal points."""
        if self.delimiter is None:
            cells = line.split()
        else:
            cells = [c.strip() for c in next(csv.reader([line], delimiter=self.delimiter))]
        return [c.replace(",", ".") for c in cells] if self.decimal_comma else cells


def table_style(file: DataFile, lines: list[str], rows: list[int]) -> TableStyle:
    """How a table is written, by its first lines. Raises InputError where that is ambiguous."""
    bare = [without_comment(lines[number]).replace('"', "").strip() for number in rows]
    delimiter = next((mark for line in bare if (mark := _delimiter(line)) is not None), "")
    if delimiter == ",":
        _refuse_decimal_commas(file, rows, bare)
        return TableStyle(",", False)
    if delimiter == "":  # no line of numbers: what names the columns may still show it
        first = bare[0] if bare else ""
        return TableStyle(next((mark for mark in (";", ",") if mark in first), None), False)
    between = ";" if delimiter == ";" else None
    cells = [cell for line in bare for cell in line.split(between)[:3] if _is_decimal(cell)]
    return TableStyle(between, any("," in cell for cell in cells))


def _delimiter(line: str) -> str | None:
    """What separates the numbers of a line: ";", ",", or " " for blanks; None if it has none.
    """
    words = line.split()
    if ";" in line:
        return ";" if _are_numbers([cell.replace(",",
                                                 ".") for cell in line.split(";")[:3]]) else None
    if _are_numbers([word.replace(",", ".") for word in words[:3]]) and (
        not any(word.endswith(",") for word in words)
    ):
        return " "
    return "," if "," in line and _are_numbers(line.split(",")[:3]) else None


def _refuse_decimal_commas(file: DataFile, rows: list[int], bare: list[str]) -> None:
    """Raises InputError where the commas between columns may be decimal commas as well.

    That is so where all columns are whole numbers, an even number of them, and no second one has a
    sign; unless the columns have names.
    """
    table = [line.split(",") for line in bare]
    numbers = [cells for cells in table if _are_numbers(cells[:3])]
    named = len(numbers) < len(table) and len(table[0]) == len(numbers[0])
    width = len(numbers[0])
    if named or width < 6 or width % 2 or any(len(cells) != width for cells in numbers):
        return
    if all(re.fullmatch(r"\s*[-+]?\d+\s*", cell) for cells in numbers for cell in cells) and (
        all(cell.strip().isdigit() for cells in numbers for cell in cells[1::2])
    ):
        first = len(table) - len(numbers)
        raise InputError(
            f"{file.path}, line {rows[first] + 1}: decimal commas between commas?",
            where=repr(bare[first][:60]),
            hint="the file does not show which comma ends a number: export it with decimal points, "
            "with semicolons between the columns, or with a line that names the columns")


def _is_decimal(word: str) -> bool:
    return is_number(word.strip().replace(",", "."))


def _are_numbers(words: list[str]) -> bool:
    return len(words) == 3 and all(map(is_number, words))


def is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return word.isascii() and "_" not in word  # which Python reads, and no table means


def without_comment(line: str) -> str:
    """A line without the comment behind its numbers."""
    return line.partition("#")[0] if "//" not in line else re.split("#|(?<!^)//", line)[0]
