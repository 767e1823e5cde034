"""Tables of points as text: one line per point, in the various styles of scanners.

Columns are separated by blanks, tabs, commas or semicolons; numbers have decimal points or decimal
commas; a line may name the columns, as a comment or not; a PTS file begins with how many lines
follow. The first lines show how a table is written; what stays ambiguous is refused.
"""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.part.sources.files import DataFile
from lmctl.part.sources.recognition import unreadable_file
from lmctl.part.sources.table_style import TableStyle, is_number, table_style, without_comment

#: What the parts of a normal are called.
NORMAL_NAMES = (
    ("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"), ("normalx", "normaly", "normalz"),
)

#: Lines that begin so are comments. Of a line that has columns of numbers none is one.
COMMENT_MARKS = ("#", "//", "%", "!", ";", "*", "'", "--", "$", "REM ", "rem ", "/*", "c ", "C ")

#: Columns without names are normals where so many rows are of length 1, within this.
SHARE_UNIT, UNIT_WITHIN = 0.99, 0.01

#: Lines that are examined to find how a table is written.
LINES_LOOKED_AT = 50


@dataclass(frozen=True)
class PointTable:
    """points : (n, 3) float64; normals : (n, 3) or None; notes : for the user"""

    points: FloatArray
    normals: FloatArray | None
    notes: tuple[str, ...]


def read_point_table(file: DataFile) -> PointTable:
    """The points of a table. Raises InputError, with the line that is wrong."""
    lines = _text(file).splitlines()
    rows = [number for number, line in enumerate(lines) if not _is_comment(line)]
    if not rows:
        raise InputError(f"{file.path} has no points", where="only blank lines and comments",
                         hint="export it again")
    if re.match(r"(?i)\s*ncols\b", lines[rows[0]]):
        raise unreadable_file(file, "it is a grid of heights (ESRI), not a list of points",
                         "export points as x, y and z")
    promised = [number for number in rows if re.fullmatch(r"\s*\d+\s*", lines[number])]
    rows = [number for number in rows if number not in set(promised)] if promised else rows
    style = table_style(file, lines, rows[:LINES_LOOKED_AT])
    names = _head(lines, rows, style)
    data = rows[1:] if names is not None and rows and names[0] == rows[0] else rows
    if promised and len(data) != sum(int(lines[number]) for number in promised):
        raise InputError(
            f"{file.path} is not whole",
            where=f"line {promised[0] + 1} promises {lines[promised[0]].strip()} points, "
            f"{len(data):,} follow", hint="export or copy it again")
    return _read(file, lines, data, style, names[1] if names is not None else None)


def _read(
    file: DataFile, lines: list[str], data: list[int], style: TableStyle, names: list[str] | None
) -> PointTable:
    if names is not None:
        width, places, facing = len(names), _columns(file, names), _normal_columns(names)
    else:
        width = len(style.cells(lines[data[0]])) if data else 0
        places, facing = (0, 1, 2), (3, 4, 5) if width >= 6 else ()
        if width < 3:
            raise InputError(
                f"{file.path} has no three columns of coordinates",
                where=f"line {data[0] + 1}: {lines[data[0]][:60]!r}" if data else "",
                hint="each line needs x, y and z")
    try:
        table = _numbers(lines, data, style, places + facing)
    except (ValueError, IndexError):
        try:  # what is behind the coordinates need not be numbers
            if names is not None or not facing:
                raise
            facing, table = (), _numbers(lines, data, style, places)
        except (ValueError, IndexError):
            wanted = places if names is None else places + facing
            raise _bad_line(file, lines, data, style, wanted) from None
    has_normals = bool(facing) and (names is not None or _all_unit(table[:, 3:]))
    name, notes = file.path.name, []
    if width > 3:
        notes.append(f"{name}: of {width} columns, {_listed(places)} are read as x, y, z")
    if has_normals:
        reason = "" if names is not None else ", as they are of length 1"
        notes.append(f"{name}: columns {_listed(facing)} are read as normals{reason}")
    if style.decimal_comma:
        notes.append(f"{name}: its numbers have decimal commas")
    return PointTable(table[:, :3], table[:, 3:] if has_normals else None, tuple(notes))


def _numbers(
    lines: list[str], data: list[int], style: TableStyle, columns: tuple[int, ...]
) -> FloatArray:
    """(n, len(columns)) float64. Raises ValueError or IndexError where a line has them not."""
    if not data:
        return np.empty((0, len(columns)))
    text = [without_comment(lines[number]) for number in data]
    if style.decimal_comma:
        text = [line.replace(",", ".") for line in text]
    table: FloatArray = np.loadtxt(
        text, delimiter=style.delimiter, usecols=columns, comments=None, ndmin=2, dtype=np.float64,
        quotechar='"')
    return table


def _text(file: DataFile) -> str:
    for mark, encoding in ((codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16")):
        if file.data.startswith(mark):
            return file.data.decode(encoding, "replace")
    try:
        if b"\0" in file.data:
            raise UnicodeDecodeError("utf-8", b"", 0, 1, "NUL")
        return file.data.decode("utf-8")
    except UnicodeDecodeError:
        pass
    if b"\0" not in file.data and not re.search(rb"[\x01-\x08\x0e-\x1f]", file.data[:100_000]):
        return file.data.decode("latin-1")  # names and comments of older programs
    raise InputError(
        f"{file.path} is not text",
        hint=f"a {file.suffix.upper()} file has three numbers on each line; export it again",
    )


def _is_comment(line: str) -> bool:
    bare = line.strip()
    if not bare or bare == "*/":
        return True
    if not bare.startswith(COMMENT_MARKS):
        return False
    return not (bare.startswith("//") and _names_axes(bare))  # some heads begin so


def _names_axes(line: str) -> bool:
    """Whether the words of a line name x, y and z, once each."""
    plain = [_plain(word) for word in re.split(r"[\s,;]+", line.strip("#/%!;*'$- \t"))]
    return all(plain.count(axis) == 1 for axis in "xyz")


def _plain(name: str) -> str:
    """A column's name without units, signs and case: "//X [mm]" is x."""
    return re.split(r"[\s_(\[]", name.strip().lower().strip("#/%!;*'\"$- \t"))[0]


def _head(lines: list[str], rows: list[int], style: TableStyle) -> tuple[int, list[str]] | None:
    """The line that names the columns, and its names: the first, or the comment before it."""
    if not rows:
        return None
    first = rows[0]
    cells = style.cells(without_comment(lines[first]))
    if not is_number(cells[0].replace(",", ".")):
        bare = without_comment(lines[first]).strip().lstrip("/")
        names = TableStyle(style.delimiter, False).cells(bare)
        return first, [name.strip(",; ") for name in names]
    for number in range(first - 1, -1, -1):
        if not lines[number].strip():
            continue
        bare = lines[number].strip().lstrip("#/%!;*'$- \t")
        if not _names_axes(bare):
            return None
        delimiter = style.delimiter if style.delimiter and style.delimiter in bare else None
        names = TableStyle(delimiter, False).cells(bare)
        width = len(style.cells(lines[first]))
        return (number, names) if len(names) == width else None
    return None


def _columns(file: DataFile, names: list[str]) -> tuple[int, ...]:
    """Where a head puts x, y and z; units and case are ignored: "X [mm]" is x."""
    plain = [_plain(name) for name in names]
    missing = [axis for axis in "xyz" if plain.count(axis) != 1]
    if missing:
        raise InputError(
            f"{file.path} has no column {', '.join(missing)}",
            where=f"its columns are {', '.join(names)[:100]}",
            hint="name the columns x, y, z, or leave the line of names out",
        )
    return plain.index("x"), plain.index("y"), plain.index("z")


def _normal_columns(names: list[str]) -> tuple[int, ...]:
    """Where a head puts the three parts of a normal; () where it names none."""
    plain = [re.split(r"[\s(\[]", name.strip().lower().lstrip("/"))[0] for name in names]
    for wanted in NORMAL_NAMES:
        if all(plain.count(name) == 1 for name in wanted):
            return tuple(plain.index(name) for name in wanted)
    return ()


def _all_unit(columns: FloatArray) -> bool:
    """Whether three columns can only be normals: nearly all of length 1, and not all alike."""
    if len(columns) == 0:
        return False
    with np.errstate(invalid="ignore", over="ignore"):
        size = np.linalg.norm(columns, axis=1)
    unit = np.abs(size - 1.0) < UNIT_WITHIN
    return bool(unit.mean() >= SHARE_UNIT) and bool(np.ptp(columns[unit], axis=0).max() > 0.5)


def _listed(columns: tuple[int, ...]) -> str:
    return ", ".join(str(column + 1) for column in columns)


def _bad_line(
    file: DataFile, lines: list[str], data: list[int], style: TableStyle, columns: tuple[int, ...]
) -> InputError:
    """Find the line that numpy stumbled over; it counts rows, users count lines."""
    def is_whole(number: int) -> bool:
        cells = style.cells(without_comment(lines[number]).strip())
        return len(cells) > max(columns) and all(is_number(cells[c]) for c in columns)

    bad = next((number for number in data if not is_whole(number)), data[0])
    return InputError(
        f"{file.path}, line {bad + 1}: three numbers are wanted",
        where=repr(without_comment(lines[bad]).strip()[:60]),
        hint="the file is truncated; copy it again" if bad == data[-1] else
        "the file is damaged there, or is written in another manner than its first lines")
