"""Numbers of a part file that an optimisation may choose, and how they are written.

Where a number stands, an inline table may stand instead:

    k = { free = [0.2, 5], start = 1, name = "k" }   a number between bounds
    { free = [1, 3], start = 2, name = "h2", above = "h1" }   the same, added to a named one
    to_mm = { same_as = "h1" }                       the same as a named one
    to_mm = { sum_of = ["h1", "h2"] }                a sum of named ones
    "316L" = { rest = true }                         what its neighbours leave of 1

and, in place of a table's points, a row of free levels between two mixtures:

    points = { free_levels = 12, over_mm = [40, 80], near = {...}, far = {...} }

Everything else reads a part file with the starting values in their place.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

from lmctl.config.materials import suggest_name
from lmctl.errors import Finding

#: Keys that make an inline table a marker, and the other keys each may have.
_MARKERS = {
    "free": {"start", "name", "above"},
    "same_as": set(),
    "sum_of": set(),
    "rest": set(),
    "free_levels": {"over_mm", "near", "far", "start"},
}

#: Where a free number may stand: nothing else leaves the shape of the part as it is.
_ALLOWED = re.compile(r"(^|\.)composition\.|^body\[\d+\]\.(from_mm|to_mm)$")

_MAX_LEVELS = 500


@dataclass(frozen=True)
class FreeNumber:
    """One number to be chosen.

    name : its own, or its path in the part file; low < high, and start between them
    """

    name: str
    path: str
    low: float
    high: float
    start: float


@dataclass(frozen=True)
class ResolvedNumbers:
    """data : plain data with a number in place of every marker; free : in the order of the file"""

    data: dict[str, Any]
    free: tuple[FreeNumber, ...]
    findings: tuple[Finding, ...]


def resolve_free_numbers(
    data: dict[str, Any], values: Mapping[str, float] | None = None
) -> ResolvedNumbers:
    """Plain data of a part file with values in place of its markers.

    values : by name; None takes the starting values
    """
    found: list[FreeNumber] = []
    findings: list[Finding] = []
    expanded = _expand_levels(data, "", findings)
    for path, marker in _markers(expanded, ""):
        findings += _marker_findings(path, marker)
        if "free" in marker and (number := _free_number(path, marker)) is not None:
            if any(number.name == other.name for other in found):
                findings.append(Finding(path, f"there are two free numbers {number.name!r}"))
            found.append(number)
    names = [number.name for number in found]
    for path, marker in _markers(expanded, ""):
        for name in _referenced(marker):
            if name not in names:
                listed = ", ".join(names) or "there are none"
                findings.append(Finding(path, f"there is no free number {name!r}: {listed}"))
    chosen = {number.name: number.start for number in found} | dict(values or {})
    return ResolvedNumbers(_filled(expanded, "", chosen), tuple(found), tuple(findings))


def is_marker(value: Any) -> bool:
    """Whether an inline table stands in the place of a number or of points."""
    return isinstance(value, dict) and any(key in value for key in _MARKERS)


def _markers(value: Any, path: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every marker below a value with its path, in the order of the file."""
    if is_marker(value):
        yield path, value
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield from _markers(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list):
        for number, inner in enumerate(value, start=1):
            yield from _markers(inner, f"{path}[{number}]")


def _marker_findings(path: str, marker: dict[str, Any]) -> Iterator[Finding]:
    kinds = [key for key in _MARKERS if key in marker]
    if len(kinds) > 1:
        yield Finding(path, f"is {' and '.join(kinds)} at once")
        return
    known = _MARKERS[kinds[0]] | {kinds[0]}
    for key in sorted(set(marker) - known):
        guess = suggest_name(key, sorted(known))
        yield Finding(f"{path}.{key}", "there is no such key" + (f"; {guess}" if guess else ""))
    if kinds[0] in ("free", "free_levels", "same_as", "sum_of") and not _ALLOWED.search(path):
        yield Finding(path, "cannot be free: only numbers of a composition, and from_mm and to_mm "
                      "of a shell")
    if kinds[0] == "free":
        yield from _bounds_findings(path, marker)


def _bounds_findings(path: str, marker: dict[str, Any]) -> Iterator[Finding]:
    bounds, start = marker["free"], marker.get("start")
    if not (isinstance(bounds, list) and len(bounds) == 2 and all(map(_is_number, bounds))):
        yield Finding(path, "a free number needs bounds: free = [least, greatest]")
        return
    low, high = bounds
    if low >= high:
        yield Finding(path, f"the bounds contradict: {low:g} is not below {high:g}")
    elif start is None:
        yield Finding(path, "a free number needs a start between its bounds")
    elif not _is_number(start) or not low <= start <= high:
        yield Finding(path, f"start must lie between {low:g} and {high:g}")


def _free_number(path: str, marker: dict[str, Any]) -> FreeNumber | None:
    if any(True for _ in _bounds_findings(path, marker)):
        return None
    low, high = map(float, marker["free"])
    name = marker.get("name")
    return FreeNumber(name if isinstance(name, str) else path, path, low, high,
                      float(marker["start"]))


def _referenced(marker: dict[str, Any]) -> list[str]:
    if "above" in marker:
        return [str(marker["above"])]
    same, total = marker.get("same_as"), marker.get("sum_of")
    names = [same] if same is not None else total if isinstance(total, list) else []
    return [str(name) for name in names]


def _expand_levels(value: Any, path: str, findings: list[Finding]) -> Any:
    """The same data with rows of points in place of `free_levels`."""
    if isinstance(value, list):
        return [_expand_levels(inner, f"{path}[{n}]", findings)
                for n, inner in enumerate(value, start=1)]
    if not isinstance(value, dict):
        return value
    if "free_levels" in value:
        findings += _marker_findings(path, value)
        reason = _levels_mistake(value)
        if reason:
            findings.append(Finding(path, reason))
            return []
        return _level_points(value, path)
    return {key: _expand_levels(inner, f"{path}.{key}" if path else str(key), findings)
            for key, inner in value.items()}


def _levels_mistake(marker: dict[str, Any]) -> str:
    count, over = marker["free_levels"], marker.get("over_mm")
    if not isinstance(count, int) or isinstance(count, bool) or not 2 <= count <= _MAX_LEVELS:
        return f"free_levels must be a whole number from 2 to {_MAX_LEVELS}"
    if not (isinstance(over, list) and len(over) == 2 and all(map(_is_number, over))
            and over[0] < over[1]):
        return "free_levels needs over_mm = [from, to], rising"
    if not all(isinstance(marker.get(key), dict) for key in ("near", "far")):
        return "free_levels needs the mixtures near and far"
    return ""


def _level_points(marker: dict[str, Any], path: str) -> list[dict[str, Any]]:
    """Points whose share of `far` is free between 0 and 1; `start` is that of all, else rising."""
    count, (first, last) = marker["free_levels"], marker["over_mm"]
    points = []
    for number in range(count):
        share = number / (count - 1)
        start = marker.get("start", share)
        points.append({
            "at_mm": round(first + share * (last - first), 6),
            "of": {"between": {"free": [0.0, 1.0], "start": float(start),
                               "name": f"{path} level {number + 1}"},
                   "near": marker["near"], "far": marker["far"]}})
    return points


def _filled(value: Any, path: str, values: Mapping[str, float]) -> Any:
    if is_marker(value):
        return _value_of(value, path, values)
    if isinstance(value, list):
        items = [_filled(inner, f"{path}[{n}]", values) for n, inner in enumerate(value, start=1)]
        return _with_rest_of_weights(value, items)
    if not isinstance(value, dict):
        return value
    if "between" in value and "near" in value:
        share = _filled(value["between"], f"{path}.between", values)
        near, far = value["near"], value["far"]
        return {name: near.get(name, 0.0) * (1 - share) + far.get(name, 0.0) * share
                for name in [*near, *(name for name in far if name not in near)]}
    filled = {key: _filled(inner, f"{path}.{key}" if path else str(key), values)
              for key, inner in value.items()}
    rest = [key for key, inner in value.items() if _is_rest(inner)]
    if len(rest) == 1 and "weight" not in value:
        filled[rest[0]] = 1.0 - sum(v for k, v in filled.items()
                                    if k != rest[0] and _is_number(v))
    return filled


def _with_rest_of_weights(before: list[Any], filled: list[Any]) -> list[Any]:
    """The weight that is the rest of those of the other parts of a blend."""
    rest = [n for n, item in enumerate(before)
            if isinstance(item, dict) and _is_rest(item.get("weight"))]
    if len(rest) == 1:
        others: list[Any] = [item.get("weight") for n, item in enumerate(filled)
                             if n != rest[0] and isinstance(item, dict)]
        filled[rest[0]] = {**filled[rest[0]],
                           "weight": 1.0 - sum(filter(_is_number, others))}
    return filled


def _value_of(marker: dict[str, Any], path: str, values: Mapping[str, float]) -> Any:
    if "free" in marker:
        name = marker.get("name")
        own = values.get(name if isinstance(name, str) else path, marker.get("start", 0.0))
        return own + sum(values.get(below, 0.0) for below in _referenced(marker))
    if "rest" in marker:
        return 0.0
    return sum(values.get(name, 0.0) for name in _referenced(marker))


def _is_rest(value: Any) -> bool:
    return isinstance(value, dict) and "rest" in value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
