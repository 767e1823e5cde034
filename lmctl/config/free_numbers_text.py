"""Write chosen numbers into the text of a part file; comments and layout stay as they are."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from lmctl.config import toml_file
from lmctl.config.free_numbers import is_marker, resolve_free_numbers
from lmctl.errors import ConfigError

#: Strings and comments, in which braces mean nothing.
_OPAQUE = re.compile(
    r'''"""[\s\S]*?"""|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|#[^\n]*''')
_DIGITS = 10


def text_with_values(text: str, name: str, values: Mapping[str, float]) -> str:
    """The text of a part file with numbers where it marks them as free.

    values : by name, of every free number
    Raises ConfigError where a marker is not written as an inline table.
    """
    data = toml_file.parse_tables(text, name=name)
    rounded = {key: float(f"{value:.{_DIGITS}g}") for key, value in values.items()}
    wanted = resolve_free_numbers(data, rounded).data
    filled = list(_marked(data, wanted))
    spans = list(_marker_spans(text))
    if len(spans) == len(filled):
        for (start, end), value in zip(reversed(spans), reversed(filled), strict=True):
            text = text[:start] + _toml(value) + text[end:]
        if toml_file.parse_tables(text, name=name) == wanted:
            return text
    raise ConfigError(f"{name}: the free numbers cannot be written into its text",
                      hint="write each as an inline table, on one line, in the order of its tables")


def _marked(data: Any, wanted: Any) -> Iterator[Any]:
    """What takes the place of each marker, in the order of the file."""
    if is_marker(data):
        yield wanted
    elif isinstance(data, dict):
        for key, inner in data.items():
            yield from _marked(inner, wanted[key])
    elif isinstance(data, list):
        for inner, value in zip(data, wanted, strict=True):
            yield from _marked(inner, value)


def _marker_spans(text: str) -> Iterator[tuple[int, int]]:
    """Where each marker stands in the text, outermost inline tables only."""
    bare = _OPAQUE.sub(lambda found: " " * len(found.group()), text)
    depth: list[int] = []
    end_of_last = 0
    spans = []
    for place, character in enumerate(bare):
        if character == "{":
            depth.append(place)
        elif character == "}" and depth:
            start = depth.pop()
            inner = re.sub(r"\{[^{}]*\}", " ", bare[start + 1 : place])
            if re.search(r"(^|,)\s*(free|same_as|sum_of|rest|free_levels)\s*=", inner):
                spans.append((start, place + 1))
    for start, end in sorted(spans):
        if start >= end_of_last:
            end_of_last = end
            yield start, end


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        inner = ", ".join(f"{_key(key)} = {_toml(item)}" for key, item in value.items())
        return f"{{ {inner} }}"
    if isinstance(value, list):
        return "[\n" + "".join(f"  {_toml(item)},\n" for item in value) + "]"
    return repr(float(value)) if isinstance(value, float) else str(value)


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) and not key[0].isdigit() else f'"{key}"'
