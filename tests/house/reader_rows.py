"""Rows of keys that a table reader asks for, found by reading a file that has every key.

Bench, fault and map files are read key by key; this reader notes what is asked of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from firmware_protocol import table_reader
from firmware_protocol.table_reader import TableReader
from lmctl.reference.key_row import KeyRow, as_toml, unit_of_key
from lmctl.reference.model_rows import docstring_entries

_REQUIRED = table_reader._REQUIRED


class RecordingReader(TableReader):
    """Answers with values that are possible, and keeps a row for each key.

    rows : by path
    meanings : of a key, by the path of its table and its name
    """

    def __init__(self, path: str, rows: dict[str, KeyRow],
                 meanings: Callable[[str, str], str]) -> None:
        super().__init__({}, "", [])
        self._at = path
        self._rows = rows
        self._meanings = meanings
        self._optional: set[str] = set()

    def has_key(self, key: str) -> bool:
        """Every key is there; one that is asked about first may be left out."""
        self._optional.add(key)
        return True

    def is_table(self, key: str) -> bool:
        self._note(key, "text, or a table", None, "")
        return True

    def number(self, key: str, default: float = _REQUIRED, *, least: float = float("-inf"),
               above: float = float("-inf"), most: float = float("inf")) -> float:
        words = [f"{word} {limit:,.10g}".replace(",", " ")
                 for word, limit in (("from", least), ("above", above), ("to", most))
                 if abs(limit) < 1e300]
        self._note(key, "number", default, " ".join(words))
        if default is not _REQUIRED:
            return float(default)
        low = max(least, above, 0.0)
        return low + (min(most, low + 2.0) - low) / 2

    def integer(self, key: str, default: int = _REQUIRED, *, least: int, most: int) -> int:
        self._note(key, "whole number", default, f"from {least} to {most}")
        return least if default is _REQUIRED else default

    def text(self, key: str, default: str = _REQUIRED) -> str:
        self._note(key, "text", default, "")
        # A row of a map that is not named lets its reader go on to all other keys.
        usual = {"endpoint": "pty", "register": "?"}.get(key, "x")
        return usual if default is _REQUIRED or key in ("endpoint", "register") else default

    def boolean(self, key: str, default: bool) -> bool:
        self._note(key, "true or false", default, "")
        return default

    def choice(self, key: str, options: Iterable[str], default: str = _REQUIRED) -> str:
        those = tuple(options)
        self._note(key, "text", default, ", ".join(map(as_toml, those)))
        return those[0] if default is _REQUIRED else default

    def integers(self, key: str, default: tuple[int, ...] = _REQUIRED, *, least: int,
                 most: int) -> tuple[int, ...]:
        self._note(key, "list of whole numbers", default, f"from {least} to {most}")
        return () if default is _REQUIRED else default

    def texts(self, key: str, default: tuple[str, ...] = _REQUIRED) -> tuple[str, ...]:
        self._note(key, "list of texts", default, "")
        return () if default is _REQUIRED else default

    def names_or_integers(self, key: str) -> tuple[str | int, ...]:
        self._note(key, "name, whole number, or list of them", None, "")
        return ()

    def table(self, key: str, default: Mapping[str, Any] = _REQUIRED) -> RecordingReader:
        self._note(key, "table", default if default is _REQUIRED else None, "")
        return RecordingReader(f"{self._at}.{key}", self._rows, self._meanings)

    def tables(self, key: str) -> list[TableReader]:
        self._note(key, "list of tables", None, "")
        return [RecordingReader(f"{self._at}.{key}", self._rows, self._meanings)]

    def number_rows(self, key: str, **limits: float) -> tuple[tuple[float, ...], ...]:
        self._note(key, "list of lists of numbers", _REQUIRED,
                   " ".join(f"from {limit:g}" for limit in limits.values()))
        return ((0.0, 0.0), (0.0, 0.0))

    def numbers_by_integer_key(self) -> dict[int, float]:
        return {}

    def _get(self, key: str, default: Any) -> Any:
        raise NotImplementedError(
            f"{self._at}.{key} is read in a way that {__name__}.RecordingReader does not know: add "
            "the reader's method to it")

    def _note(self, key: str, kind: str, default: Any, allowed: str) -> None:
        path = f"{self._at}.{key}"
        required = default is _REQUIRED and key not in self._optional
        usual = "" if default is _REQUIRED or default is None else as_toml(
            int(default) if kind == "number" and float(default).is_integer() else default)
        self._rows.setdefault(path, KeyRow(
            path, kind, unit_of_key(key), usual, required, allowed, "",
            self._meanings(self._at, key), ""))


def reader_rows(
    path: str, read: Callable[[TableReader], object], meanings: Callable[[str, str], str]
) -> list[KeyRow]:
    """The rows of a file, in the order in which its keys are read.

    path : its kind; read : what reads it from a reader
    Tables with the same keys as one before them refer to that one.
    """
    rows: dict[str, KeyRow] = {}
    read(RecordingReader(path, rows, meanings))
    tables: dict[tuple[tuple[str, str], ...], str] = {}
    dropped: set[str] = set()
    for row in list(rows.values()):
        if "table" not in row.type or row.path in dropped:
            continue
        inner = [one.path for one in rows.values() if one.path.startswith(row.path + ".")]
        keys = tuple((one.removeprefix(row.path), rows[one].type) for one in inner)
        first = tables.setdefault(keys, row.path) if keys else row.path
        if first != row.path:
            dropped |= set(inner)
            rows[row.path] = row._replace(same_as=first)
    return [row for row in rows.values() if row.path not in dropped]


def documented_by(
    places: Mapping[str, Iterable[Any]], more: Mapping[str, str]
) -> Callable[[str, str], str]:
    """What a key means: by the docstrings that speak of its table, else by its name.

    places : classes and functions, by the path of the table
    more : texts by the key, of the table or of any
    """
    def meaning(table: str, key: str) -> str:
        for documented in places.get(table, ()):
            if text := docstring_entries(documented, [key, *_neighbours(documented)]).get(key):
                return text
        return more.get(f"{table}.{key}", more.get(key, ""))

    return meaning


def _neighbours(documented: Any) -> list[str]:
    """Fields of a dataclass, so that entries of several keys are recognised; of a function, any."""
    fields = getattr(documented, "__dataclass_fields__", None)
    if fields is not None:
        return list(fields)
    words = (documented.__doc__ or "").replace(",", " ").replace(":", " ").split()
    return list(dict.fromkeys(words))
