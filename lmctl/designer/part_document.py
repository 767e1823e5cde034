"""A part file being edited: its text with comments and layout kept, undo, and saving."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from lmctl.config.toml_file import read_text
from lmctl.errors import ConfigError, UsageError

#: A value's place in the file: names of keys, and numbers from 0 in arrays.
KeyPath = tuple[str | int, ...]

#: Edits that can be undone.
MAX_UNDO = 500

#: Significant digits of a number that is written.
_DIGITS = 6


class PartDocument:
    """The text of a part file. Raises ConfigError, MissingFileError where it cannot be read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._saved = read_text(path)
        self._document = _parsed(self._saved, path)
        self._undo: list[str] = []
        self._redo: list[str] = []
        self._last_path: KeyPath | None = None

    @property
    def text(self) -> str:
        return tomlkit.dumps(self._document)

    @property
    def is_saved(self) -> bool:
        return self.text == self._saved

    @property
    def can_undo(self) -> bool:
        return bool(self._undo)

    @property
    def can_redo(self) -> bool:
        return bool(self._redo)

    def value_at(self, path: KeyPath) -> Any:
        """The value at a place. Raises UsageError where there is none."""
        return _value(self._document, path)

    def set_number(self, path: KeyPath, value: float, *, continuing: bool = False) -> None:
        """Set one number; shares of a mixture, and weights of a blend, give way to it.

        continuing : part of the same movement of a slider, undone with the edit before it
        Raises UsageError where no number stands at that place.
        """
        before = self.text
        holder, key = _value(self._document, path[:-1]), path[-1]
        if is_share(path):
            if not 0.0 <= value <= 1.0:
                raise UsageError(f"{value:g} is no share", hint="shares go from 0 to 1")
            _set_shares(holder, key, value)
        elif is_weight(path):
            blend = _value(self._document, path[:-2])
            _set_weights(blend, int(path[-2]), value)
        else:
            _refuse_no_number(_value(self._document, path), path)
            holder[key] = written_number(value, holder[key])
        if self.text == before:
            return
        if not (continuing and path == self._last_path and self._undo):
            self._undo = [*self._undo, before][-MAX_UNDO:]
        self._redo.clear()
        self._last_path = path

    def undo(self) -> None:
        """Back to before the last edit. Raises UsageError where there is none."""
        self._step(self._undo, self._redo, "undo")

    def redo(self) -> None:
        """Forward again. Raises UsageError where nothing was undone."""
        self._step(self._redo, self._undo, "redo")

    def restore(self, text: str) -> None:
        """The text before an edit that turned out to be impossible; as if it had not been made."""
        self._document = _parsed(text, self.path)
        if self._undo and self._undo[-1] == text:
            self._undo.pop()
        self._last_path = None

    def save(self) -> None:
        """Write the file, whole or not at all. Raises UsageError, also where it was changed."""
        if read_text(self.path) != self._saved:
            raise UsageError(f"{self.path} was changed by another program since it was read",
                             hint="keep a copy of what you need, then open it again")
        temporary = self.path.with_name(f".{self.path.name}.{os.getpid()}.tmp")
        text = self.text
        try:
            temporary.write_text(text, encoding="utf-8")
            temporary.replace(self.path)
        except OSError as error:
            raise UsageError.cannot_write(self.path, error) from None
        finally:
            temporary.unlink(missing_ok=True)
        self._saved = text

    def _step(self, source: list[str], target: list[str], what: str) -> None:
        if not source:
            raise UsageError(f"there is nothing to {what}", hint="change a number first")
        target.append(self.text)
        self._document = _parsed(source.pop(), self.path)
        self._last_path = None


def is_share(path: KeyPath) -> bool:
    """Whether a place is one material's share of a mixture."""
    return len(path) > 1 and path[-2] in ("near", "far", "of") and "profile" in path


def is_weight(path: KeyPath) -> bool:
    """Whether a place is the weight of one part of a blend."""
    return len(path) > 2 and path[-1] == "weight" and path[-3] == "blend"


def written_number(value: float, before: Any) -> int | float:
    """A number as a person would write it: a whole one stays whole where it was before."""
    rounded = float(f"{value:.{_DIGITS}g}")
    if isinstance(before, int) and not isinstance(before, bool) and rounded.is_integer():
        return int(rounded)
    return rounded


def _parsed(text: str, path: Path) -> tomlkit.TOMLDocument:
    try:
        return tomlkit.parse(text)
    except TOMLKitError as error:
        raise ConfigError(f"{path} is not valid TOML", where=str(error)[:200],
                          hint="correct it in an editor, then load it again") from None


def _value(document: Any, path: Sequence[str | int]) -> Any:
    value = document
    for key in path:
        try:
            value = value[key]
        except (KeyError, IndexError, TypeError):
            raise UsageError(f"{'.'.join(map(str, path))} is not in the part file",
                             hint="load the page again") from None
    return value


def _refuse_no_number(value: Any, path: KeyPath) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise UsageError(f"{'.'.join(map(str, path))} is no number",
                         hint="only numbers and mixtures are moved here; edit the file itself")


def _set_shares(mixture: Any, material: str | int, value: float) -> None:
    """One share of a mixture; the others keep their proportions and fill up to 1."""
    before = {name: float(share) for name, share in mixture.items() if name != material
              and isinstance(share, int | float)}
    for name, share in _filling(before, 1.0 - value).items():
        mixture[name] = share
    mixture[material] = round(value, _DIGITS)


def _set_weights(blend: Any, number: int, value: float) -> None:
    before = {str(at): float(part["weight"]) for at, part in enumerate(blend)
              if at != number and "weight" in part}
    for at, weight in _filling(before, 1.0 - value).items():
        blend[int(at)]["weight"] = weight
    blend[number]["weight"] = round(value, _DIGITS)


def _filling(before: dict[str, float], total: float) -> dict[str, float]:
    """Shares in the proportions of those before that sum to a total, to the last digit written."""
    if not before:
        return {}
    whole = sum(before.values())
    shares = {name: round(total * (share / whole if whole else 1.0 / len(before)), _DIGITS)
              for name, share in before.items()}
    largest = max(shares, key=lambda name: shares[name])
    shares[largest] = round(
        total - sum(share for name, share in shares.items() if name != largest), _DIGITS)
    return shares
