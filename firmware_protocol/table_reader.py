"""Reads a TOML table key by key and collects all mistakes, so that they are reported at once."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

_REQUIRED: Any = object()
_HUGE = 1e300


class TableReader:
    """One table. path : its name in messages, "" at the top; mistakes : collects "key: reason".

    A wrong key yields some value of its type, so that reading continues.
    """

    def __init__(self, table: Mapping[str, Any], path: str, mistakes: list[str]) -> None:
        self._table = table
        self._path = path
        self._asked: set[str] = set()
        self.mistakes = mistakes

    def report_mistake(self, key: str, reason: str) -> None:
        place = f"{self._path}.{key}" if self._path and key else self._path + key
        self.mistakes.append(f"{place}: {reason}" if place else reason)

    def has_key(self, key: str) -> bool:
        return key in self._table

    def is_table(self, key: str) -> bool:
        """Whether the key is there and holds a table."""
        return isinstance(self._table.get(key), dict)

    def number(
        self, key: str, default: float = _REQUIRED, *, least: float = -math.inf,
        above: float = -math.inf, most: float = math.inf,
    ) -> float:
        """A finite number, at least `least`, above `above`, at most `most`."""
        value = self._get(key, default)
        if value is _REQUIRED:
            return 1.0
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.report_mistake(key, "must be a number")
        elif not abs(value) < _HUGE:
            self.report_mistake(key, "must be finite")
        elif value < least:
            self.report_mistake(key, f"must be at least {least:g}")
        elif value <= above:
            self.report_mistake(key, f"must be above {above:g}")
        elif value > most:
            self.report_mistake(key, f"must be at most {most:g}")
        else:
            return float(value)
        return 1.0

    def integer(self, key: str, default: int = _REQUIRED, *, least: int, most: int) -> int:
        value = self._get(key, default)
        if value is _REQUIRED:
            return least
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            self.report_mistake(key, f"must be a whole number from {least} to {most}")
            return least
        return value

    def text(self, key: str, default: str = _REQUIRED) -> str:
        value = self._get(key, default)
        if value is _REQUIRED:
            return "?"
        if not isinstance(value, str) or not value.strip():
            self.report_mistake(key, "must be text")
            return "?"
        return value

    def boolean(self, key: str, default: bool) -> bool:
        value = self._get(key, default)
        if not isinstance(value, bool):
            self.report_mistake(key, "must be true or false")
            return default
        return value

    def choice(self, key: str, options: Iterable[str], default: str = _REQUIRED) -> str:
        options = tuple(options)
        value = self._get(key, default)
        if value is not _REQUIRED and value not in options:
            self.report_mistake(key, f"must be {' or '.join(repr(option) for option in options)}")
        return next((str(text) for text in (value, default) if text in options), options[0])

    def integers(
        self, key: str, default: tuple[int, ...] = _REQUIRED, *, least: int, most: int,
    ) -> tuple[int, ...]:
        """A list of whole numbers; a single one may be written without brackets."""
        value = self._get(key, default)
        if value is _REQUIRED:
            return ()
        items = tuple(value) if isinstance(value, list | tuple) else (value,)
        if not all(type(item) is int and least <= item <= most for item in items):
            self.report_mistake(key, f"must be whole numbers from {least} to {most}")
            return ()
        return items

    def texts(self, key: str, default: tuple[str, ...] = _REQUIRED) -> tuple[str, ...]:
        """A list of texts."""
        value = self._get(key, default)
        if value is _REQUIRED:
            return ()
        if not isinstance(value, list | tuple) or not all(isinstance(one, str) for one in value):
            self.report_mistake(key, "must be a list of texts")
            return ()
        return tuple(value)

    def names_or_integers(self, key: str) -> tuple[str | int, ...]:
        """Names and whole numbers of at least 0, in a list or a single one; () where missing."""
        value = self._get(key, ())
        items = tuple(value) if isinstance(value, list | tuple) else (value,)
        if not all(isinstance(one, str) or (type(one) is int and one >= 0) for one in items):
            self.report_mistake(key, "must be names or whole numbers of at least 0")
            return ()
        return items

    def key_names(self) -> tuple[str, ...]:
        """The keys that the table has."""
        return tuple(self._table)

    def table(self, key: str, default: Mapping[str, Any] = _REQUIRED) -> TableReader:
        value = self._get(key, default)
        if not isinstance(value, dict):
            if value is not _REQUIRED:
                self.report_mistake(key, "must be a table")
            value = {}
        return TableReader(value, f"{self._path}.{key}" if self._path else key, self.mistakes)

    def tables(self, key: str) -> list[TableReader]:
        """An array of tables, counted from one in messages; empty if the key is missing."""
        value = self._get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            self.report_mistake(key, "must be an array of tables")
            return []
        path = f"{self._path}.{key}" if self._path else key
        return [
            TableReader(item, f"{path}[{number}]", self.mistakes)
            for number, item in enumerate(value, 1)
        ]

    def number_rows(self, key: str, *, least: float) -> tuple[tuple[float, ...], ...]:
        """At least two rows, equally long, of at least two finite numbers ≥ `least`."""
        rows = self._get(key, _REQUIRED)
        if rows is not _REQUIRED:
            if _is_rectangle(rows):
                if min(min(row) for row in rows) >= least:
                    return tuple(tuple(float(value) for value in row) for row in rows)
                self.report_mistake(key, f"must be at least {least:g} everywhere")
            else:
                self.report_mistake(key, "must be two or more rows of as many numbers, two or more")
        return ((least, least), (least, least))

    def numbers_by_integer_key(self) -> dict[int, float]:
        """The whole table as {whole number: number}: `$` settings."""
        values = {}
        for key in self._table:
            if not key.isascii() or not key.isdecimal():
                self._asked.add(key)
                self.report_mistake(key, "must be the number of a setting")
            else:
                values[int(key)] = self.number(key)
        return values

    def report_unknown_keys(self) -> None:
        """Report every key that the caller did not read: a typo."""
        for key in self._table:
            if key not in self._asked:
                from difflib import get_close_matches  # needed for mistakes only

                near = get_close_matches(key, sorted(self._asked), n=1)
                guess = f"; did you mean {near[0]!r}?" if near else ""
                self.report_mistake(key, "there is no such key" + guess)

    def _get(self, key: str, default: Any) -> Any:
        """Return the value or the default; report a required key that is missing."""
        self._asked.add(key)
        value = self._table.get(key, default)
        if value is _REQUIRED:
            self.report_mistake(key, "is missing")
        return value


def _is_rectangle(rows: object) -> bool:
    """Whether rows are at least two, equally long, each of at least two finite numbers."""
    if not isinstance(rows, list) or len(rows) < 2 or not all(isinstance(r, list) for r in rows):
        return False
    are_numbers = all(
        isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < _HUGE
        for row in rows for value in row)
    return are_numbers and len(rows[0]) >= 2 and all(len(row) == len(rows[0]) for row in rows)
