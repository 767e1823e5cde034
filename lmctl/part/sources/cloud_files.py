"""Measured points from XYZ, CSV and PLY files.

Scanners write columns in many ways: spaces, commas, semicolons or tabs, with or without a line of
names, with intensity, colour or normals behind the coordinates. What is ignored is said.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.errors import InputError
from lmctl.part.sources.files import DataFile
from lmctl.part.sources.mesh_files import checked_points
from lmctl.part.sources.ply_files import read_ply

CLOUD_SUFFIXES = ("xyz", "csv", "txt", "asc", "ply")

#: More points than this do not make any field finer, only slower.
MOST_POINTS = 20_000_000

#: Fewer points enclose nothing.
FEWEST_POINTS = 100

#: What the parts of a normal are called.
NORMAL_NAMES = (
    ("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"), ("normalx", "normaly", "normalz"),
)

#: Columns without names are normals where so many rows are of length 1, within this.
SHARE_UNIT, UNIT_WITHIN = 0.99, 0.01

#: Points, normals or None, notes.
Read = tuple[NDArray[np.float64], NDArray[np.float64] | None, list[str]]


@dataclass(frozen=True)
class Cloud:
    """points: (n, 3) float64 [mm], in no order; notes: what of the file was left out.

    normals: (n, 3) float64, where the outside is at each point, if the file says; else None
    """

    points: NDArray[np.float64]
    notes: tuple[str, ...]
    normals: NDArray[np.float64] | None = None


def read_cloud(file: DataFile, units: str) -> Cloud:
    """The points of a cloud file in mm, each place once.

    Raises InputError where it cannot be read (with the line), has too few or too many points,
    coordinates that are not numbers, or a size no part of this machine's kind has.
    """
    if file.suffix == "ply":
        points, normals, notes = _from_ply(file)
    elif file.suffix in CLOUD_SUFFIXES:
        points, normals, notes = _from_text(file)
    else:
        raise InputError(
            f"{file.path} is not a kind of point cloud that can be read",
            hint="XYZ, CSV and PLY files can; the ending must say which it is",
        )
    if not FEWEST_POINTS <= len(points) <= MOST_POINTS:
        raise InputError(
            f"{file.path} has {len(points):,} points",
            where=f"{FEWEST_POINTS} to {MOST_POINTS:,} points can be used",
            hint="scan the surface more densely" if len(points) < FEWEST_POINTS else
            "thin it out: detail far below the bead width is lost anyway",
        )
    points = checked_points(file, points, units, used=None, what="point")
    single, first = np.unique(points, axis=0, return_index=True)
    if len(single) < len(points):
        notes.append(f"{file.path.name}: {len(points) - len(single):,} points are there twice")
    return Cloud(single, tuple(notes), None if normals is None else normals[first])


def _from_ply(file: DataFile) -> Read:
    elements = read_ply(file)
    vertex = elements["vertex"].numbers if "vertex" in elements else {}
    if not all(axis in vertex for axis in "xyz") or len(vertex["x"]) == 0:
        raise InputError(f"{file.path} holds no points",
                         where="its head names no rows of an element vertex with x, y and z",
                         hint="export it again")
    points = np.stack([vertex[axis] for axis in "xyz"], axis=1)
    notes = []
    faces = elements.get("face")
    count = max((len(sizes) for sizes, _ in faces.lists.values()), default=0) if faces else 0
    if count:
        notes.append(f"{file.path.name}: its {count:,} faces are not used, as it is given as a "
                     "cloud")
    normals = None
    if all(name in vertex for name in NORMAL_NAMES[0]):
        normals = np.stack([vertex[name] for name in NORMAL_NAMES[0]], axis=1)
        notes.append(f"{file.path.name}: its normals are used")
    return points, normals, notes


def _from_text(file: DataFile) -> Read:
    text = _text(file)
    lines = text.splitlines()
    first = next((i for i, line in enumerate(lines) if _bare(line)), None)
    if first is None:
        raise InputError(f"{file.path} has no points", where="only blank lines and comments")
    delimiter = _delimiter(lines[first])
    names = _split(_bare(lines[first]), delimiter)
    headed = not _is_number(names[0].replace(",", "."))  # a decimal comma makes no head
    start = first + 1 if headed else first
    places = _columns(file, names) if headed else (0, 1, 2)
    facing = _normal_columns(names) if headed else ((3, 4, 5) if len(names) >= 6 else ())
    columns = places + facing
    if not headed and len(names) < 3:
        raise InputError(
            f"{file.path} has no three columns of coordinates", where=f"line {first + 1}: "
            f"{lines[first][:60]!r}", hint="each line needs x, y and z",
        )
    try:
        points = np.loadtxt(
            lines[start:], delimiter=delimiter, usecols=columns, comments="#", ndmin=2,
            dtype=np.float64,
        ) if any(_bare(line) for line in lines[start:]) else np.empty((0, 3))
    except (ValueError, IndexError):
        if facing and not headed:  # what is behind the coordinates need not be numbers
            return _places_only(file, lines, start, delimiter, names)
        raise _bad_line(file, lines, start, delimiter, columns) from None
    normals = points[:, 3:] if facing and (headed or _all_unit(points[:, 3:])) else None
    notes = []
    if len(names) > 3:
        notes.append(f"{file.path.name}: of {len(names)} columns, "
                     f"{', '.join(str(c + 1) for c in places)} are read as x, y, z")
    if normals is not None:
        said = "" if headed else ", as they are of length 1"
        notes.append(f"{file.path.name}: columns {', '.join(str(c + 1) for c in facing)} are "
                     f"read as normals{said}")
    return points[:, :3], normals, notes


def _places_only(
    file: DataFile, lines: list[str], start: int, delimiter: str | None, names: list[str]
) -> Read:
    """Coordinates from lines without a head whose further columns are no numbers."""
    try:
        points = np.loadtxt(
            lines[start:], delimiter=delimiter, usecols=(0, 1, 2), comments="#", ndmin=2,
            dtype=np.float64,
        )
    except (ValueError, IndexError):
        raise _bad_line(file, lines, start, delimiter, (0, 1, 2)) from None
    note = f"{file.path.name}: of {len(names)} columns, 1, 2, 3 are read as x, y, z"
    return points, None, [note]


def _all_unit(columns: NDArray[np.float64]) -> bool:
    """Whether three columns can only be normals: nearly all of length 1, and not all alike."""
    with np.errstate(invalid="ignore", over="ignore"):
        size = np.linalg.norm(columns, axis=1)
    unit = np.abs(size - 1.0) < UNIT_WITHIN
    return bool(unit.mean() >= SHARE_UNIT) and bool(np.ptp(columns[unit], axis=0).max() > 0.5)


def _normal_columns(names: list[str]) -> tuple[int, ...]:
    """Where a head line puts the three parts of a normal; () where it names none."""
    plain = [re.split(r"[\s(\[]", name.strip().lower().lstrip("/"))[0] for name in names]
    for wanted in NORMAL_NAMES:
        if all(plain.count(name) == 1 for name in wanted):
            return tuple(plain.index(name) for name in wanted)
    return ()




def _text(file: DataFile) -> str:
    try:
        if b"\0" in file.data:
            raise UnicodeDecodeError("utf-8", b"", 0, 1, "NUL")
        return file.data.decode("utf-8")
    except UnicodeDecodeError:
        raise InputError(
            f"{file.path} is not text",
            hint=f"a {file.suffix.upper()} file has three numbers on each line; export it again",
        ) from None


def _bare(line: str) -> str:
    return line.partition("#")[0].strip()


def _delimiter(line: str) -> str | None:
    """The separator of a line; None for blanks of any kind."""
    return next((mark for mark in (";", ",") if mark in line), None)


def _split(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _columns(file: DataFile, names: list[str]) -> tuple[int, int, int]:
    """Where a head line puts x, y and z; units and case are ignored: "X [mm]" is x."""
    plain = [re.split(r"[\s_(\[]", name.strip().lower().lstrip("/"))[0] for name in names]
    missing = [axis for axis in "xyz" if plain.count(axis) != 1]
    if missing:
        raise InputError(
            f"{file.path} has no column {', '.join(missing)}",
            where=f"its columns are {', '.join(names)[:100]}",
            hint="name the columns x, y, z, or leave the line of names out",
        )
    return plain.index("x"), plain.index("y"), plain.index("z")


def _bad_line(
    file: DataFile, lines: list[str], start: int, delimiter: str | None, columns: tuple[int, ...]
) -> InputError:
    """Find the line that numpy stumbled over; it counts rows, people count lines."""
    for number, line in enumerate(lines[start:], start=start + 1):
        bare = _bare(line)
        cells = _split(bare, delimiter) if bare else []
        if bare and not (len(cells) > max(columns) and all(_is_number(cells[c]) for c in columns)):
            if delimiter != "," and len(cells) > max(columns) and all(
                _is_number(cells[c].replace(",", ".")) for c in columns
            ):
                hint = "it is written with decimal commas: export it with decimal points"
            elif number < len(lines):
                hint = "the file is damaged there"
            else:
                hint = "the file is truncated; copy it again"
            return InputError(f"{file.path}, line {number}: three numbers are wanted",
                              where=repr(line[:60]), hint=hint)
    return InputError(f"{file.path} cannot be read as columns of numbers")
