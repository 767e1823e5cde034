"""Maps of forbidden mixtures: CSV tables of cells, such as a phase equilibrium program computes.

Columns are volume fractions of two to four powders, by name, and `forbidden` (0 or 1). Rows are
all mixtures whose fractions are multiples of one step, the map's resolution; each stands for the
cell of mixtures nearest to it. Lines that begin with # are comments.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from math import comb

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.part.sources.files import DataFile

_FORBIDDEN = "forbidden"
_WORDS = {"0": False, "1": True, "false": False, "true": True, "no": False, "yes": True}
#: Fractions in a table are rounded to about so much.
_ROUNDED = 0.0006
#: A map has at most so many rows: four powders at steps of 0.02.
_MOST_ROWS = 25_000


@dataclass(frozen=True, eq=False)
class AlloyMap:
    """powders : column names; forbidden : (c, m) float64, the middles of forbidden cells, rows
    summing to 1; resolution : step between neighbouring cells in a volume fraction"""

    powders: tuple[str, ...]
    forbidden: FloatArray
    resolution: float


def read_alloy_map(file: DataFile, powders: tuple[str, ...]) -> AlloyMap:
    """The forbidden cells of a map of these powders. Raises InputError with the line at fault."""
    try:
        text = file.data.decode("utf-8")
    except UnicodeDecodeError:
        raise InputError(f"{file.path} is not text", hint="export the map as CSV, UTF-8") from None
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1)
             if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise InputError(f"{file.path} has no rows", where="only blank lines and comments",
                         hint="export the map again")
    if len(lines) > _MOST_ROWS:
        raise InputError(f"{file.path} has too many rows", where=f"{len(lines):,}; at most "
                         f"{_MOST_ROWS:,}", hint="compute the map with a coarser step")
    names = [cell.strip() for cell in next(csv.reader([lines[0][1]]))]
    if sorted(names) != sorted([*powders, _FORBIDDEN]):
        raise InputError(
            f"{file.path} does not have the columns of its rule",
            where=(f"it has {', '.join(names)}", f"wanted: {', '.join(powders)}, {_FORBIDDEN}"),
            hint="name the columns by the rule's powders")
    columns = [names.index(name) for name in powders]
    flag = names.index(_FORBIDDEN)
    rows, flags = [], []
    for number, line in lines[1:]:
        cells = [cell.strip() for cell in next(csv.reader([line]))]
        try:
            rows.append([float(cells[column]) for column in columns])
            flags.append(_WORDS[cells[flag].lower()])
        except (ValueError, IndexError, KeyError):
            raise InputError(f"{file.path}, line {number}: no mixture with 0 or 1",
                             where=repr(line[:80]),
                             hint="each row states the volume fractions, and 1 where the mixture "
                                  "is forbidden") from None
    return _checked(file, powders, np.array(rows).reshape(-1, len(powders)), np.array(flags, bool))


def _checked(
    file: DataFile, powders: tuple[str, ...], rows: FloatArray, flags: FloatArray
) -> AlloyMap:
    """Every cell of the map once, on one step."""
    if len(rows) < 2 or not np.isfinite(rows).all():
        raise InputError(f"{file.path} has too few mixtures", where=f"{len(rows)} rows of numbers",
                         hint="list all mixtures of the powders in steps of one fraction")
    m, steps = len(powders), 1
    while comb(steps + m - 1, m - 1) < len(rows):
        steps += 1
    on_step = np.rint(rows * steps)
    wrong = (np.abs(rows - on_step / steps) > _ROUNDED).any(axis=1)
    wrong |= (on_step.sum(axis=1) != steps) | (on_step < 0).any(axis=1)
    expected = comb(steps + m - 1, m - 1)
    if wrong.any():
        raise InputError(
            f"{file.path} is not a whole map", where=f"row {int(np.argmax(wrong)) + 1} of "
            f"{len(rows)}: {', '.join(f'{value:g}' for value in rows[np.argmax(wrong)])} is no "
            f"mixture in steps of 1/{steps}",
            hint="list all mixtures whose fractions are multiples of one step and sum to 1")
    if len(np.unique(on_step, axis=0)) != expected or len(rows) != expected:
        raise InputError(
            f"{file.path} is not a whole map", where=f"{len(rows)} rows; all mixtures of "
            f"{m} powders in steps of 1/{steps} are {expected}, each once",
            hint="what no row decides cannot be planned: add the missing mixtures")
    return AlloyMap(powders, on_step[flags] / steps, 1 / steps)
