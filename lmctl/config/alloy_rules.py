"""Alloy rules: mixtures that must not be deposited, and how a plan avoids them.

A rule forbids one or more regions of volume fractions. It states them as intervals, as linear
inequalities, as a polygon in the plane of three powders, or in a map file of cells. Models check
one key each; `alloy_rule_findings` checks what concerns several keys or the part's materials.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import isclose
from typing import Annotated, Any, Literal

from pydantic import Field

from lmctl.config import materials
from lmctl.config.composition import Fraction, Mixture
from lmctl.config.quantities import FileName, Name
from lmctl.config.toml_file import ConfigModel
from lmctl.errors import Finding

#: Mixtures of more powders than this are not searched for a way round.
MAX_POWDERS = 4
#: How far the fractions of a corner may be from the sum 1.
_SUM_TOLERANCE = 1e-6

#: Intervals of volume fraction by powder; a mixture is in the region where all of them hold.
Region = Annotated[dict[str, tuple[Fraction, Fraction]], Field(min_length=1)]


class LinearInequality(ConfigModel):
    """Holds where Σ of[powder] · fraction ≥ at_least.

    of : factors by powder
    at_least : what the sum must reach
    """

    of: Annotated[dict[str, Annotated[float, Field(ge=-1000, le=1000)]], Field(min_length=1)]
    at_least: Annotated[float, Field(ge=-1000, le=1000)]


class AlloyRuleSettings(ConfigModel):
    """Mixtures of some powders that must not be deposited.

    name : of the rule, in messages, jobs and logs
    powders : two to four, which the rule is about
    forbidden : regions; in each, all the powders it lists have volume fractions in their intervals
    inequalities : one region, where all of them hold
    polygon : one region, by the mixtures at its corners in order, of exactly three powders
    map_file : CSV of cells, beside the part file (docs/alloy-rules.md)
    others_below : polygon and map hold where all other powders together are at most this fraction;
        there they hold for the rule's powders in proportion
    way : "jump" changes the mixture with the beam off, and what the part has inside is made of the
        nearest allowed mixture; "around" leads a blend round the region through other powders;
        "auto" goes around where there is a way, and else jumps
    through : powders a way round may use; None: all of the part's
    margin : distance that planned mixtures keep from the region, in each volume fraction
    reason : why these mixtures are forbidden
    source : who says so
    """

    name: Name
    powders: Annotated[tuple[Name, ...], Field(min_length=2, max_length=MAX_POWDERS)]
    forbidden: Annotated[tuple[Region, ...], Field(max_length=1000)] = ()
    inequalities: Annotated[tuple[LinearInequality, ...], Field(max_length=100)] = ()
    polygon: Annotated[tuple[Mixture, ...], Field(max_length=1000)] = ()
    map_file: FileName | None = None
    others_below: Annotated[float, Field(ge=0, le=0.9)] = 0.5
    way: Literal["auto", "jump", "around"] = "auto"
    through: Annotated[tuple[Name, ...], Field(max_length=MAX_POWDERS)] | None = None
    margin: Annotated[float, Field(ge=0, le=0.3)] = 0.02
    reason: Annotated[str, Field(min_length=1, max_length=500)]
    source: Annotated[str, Field(max_length=500)] = ""


class AlloyRuleFile(ConfigModel):
    """A file of alloy rules that several parts share."""

    alloy_rule: Annotated[tuple[AlloyRuleSettings, ...], Field(min_length=1, max_length=100)]


def alloy_rule_findings(
    rules: Any, powders: list[str] | None
) -> Iterator[Finding]:
    """Mistakes in rules that concern several keys, as plain data of any shape.

    powders : the part's materials; None for a file of rules that several parts share
    """
    tables = rules if isinstance(rules, list | tuple) else []
    if tables and powders is not None and len(powders) > MAX_POWDERS:
        yield Finding("alloy_rule", f"rules are kept in parts of up to {MAX_POWDERS} materials; "
                      f"this part has {len(powders)}")
    seen: set[str] = set()
    for number, rule in enumerate(tables, start=1):
        if not isinstance(rule, dict):
            continue
        where = f"alloy_rule[{number}]"
        name = rule.get("name")
        if isinstance(name, str):
            if name in seen:
                yield Finding(f"{where}.name", f"{name!r} is there twice")
            seen.add(name)
        yield from _powder_findings(where, rule, powders)
        yield from _region_findings(where, rule)


def _powder_findings(
    where: str, rule: dict[str, Any], powders: list[str] | None
) -> Iterator[Finding]:
    own = _names(rule.get("powders"))
    for place, name in enumerate(own, start=1):
        if own.index(name) != place - 1:
            yield Finding(f"{where}.powders", f"{name!r} is there twice")
        elif powders is not None and name not in powders:
            yield Finding(f"{where}.powders", _unknown(name, powders))
    for name in _names(rule.get("through")):
        if powders is not None and name not in powders:
            yield Finding(f"{where}.through", _unknown(name, powders))
    if powders is not None and rule.get("way") == "around" and len(set(powders)) < 3:
        yield Finding(f"{where}.way", "there is no way round with two powders: a third one is "
                      'needed as a [[material]], or way = "jump"')


def _unknown(name: str, powders: list[str]) -> str:
    guess = materials.suggest_name(name, powders)
    return f"there is no material {name!r}: " + (
        guess or f"the part's materials are {', '.join(powders) or 'missing'}")


def _region_findings(where: str, rule: dict[str, Any]) -> Iterator[Finding]:
    own = _names(rule.get("powders"))
    regions = _list(rule.get("forbidden"))
    inequalities, polygon = _list(rule.get("inequalities")), _list(rule.get("polygon"))
    if not (regions or inequalities or polygon or rule.get("map_file") is not None):
        yield Finding(where, "forbids nothing: state forbidden, inequalities, polygon or map_file")
    tables = [(f"{where}.forbidden[{n}]", region) for n, region in enumerate(regions, start=1)]
    tables += [(f"{where}.inequalities[{n}].of", item.get("of"))
               for n, item in enumerate(inequalities, start=1) if isinstance(item, dict)]
    tables += [(f"{where}.polygon[{n}]", corner) for n, corner in enumerate(polygon, start=1)]
    for path, table in tables:
        for name in table if isinstance(table, dict) else ():
            if name not in own:
                yield Finding(path, f"{name!r} is not among the rule's powders")
    for n, region in enumerate(regions, start=1):
        if isinstance(region, dict):
            yield from _interval_findings(f"{where}.forbidden[{n}]", region)
    if polygon:
        yield from _polygon_findings(f"{where}.polygon", polygon, own)


def _interval_findings(path: str, region: dict[str, Any]) -> Iterator[Finding]:
    least = 0.0
    for name, interval in region.items():
        if not isinstance(interval, list | tuple) or len(interval) != 2 or not all(
                _is_number(value) for value in interval):
            return  # the model reports this
        if interval[0] > interval[1]:
            yield Finding(f"{path}.{name}", f"goes from {interval[0]:g} down to {interval[1]:g}: "
                          "write the lower fraction first")
        least += interval[0]
    if least > 1 + _SUM_TOLERANCE:
        yield Finding(path, "contradicts itself: its least fractions sum to "
                      f"{least:g}, so that no mixture is in all its intervals")


def _polygon_findings(path: str, corners: list[Any], own: list[str]) -> Iterator[Finding]:
    if len(own) != 3:
        yield Finding(path, f"lies in the plane of three powders; the rule names {len(own)}")
    if len(corners) < 3:
        yield Finding(path, f"has {len(corners)} corners; three are the least")
    for number, corner in enumerate(corners, start=1):
        if not isinstance(corner, dict) or not all(map(_is_number, corner.values())):
            continue
        total = sum(corner.values())
        if not isclose(total, 1.0, rel_tol=0, abs_tol=_SUM_TOLERANCE):
            yield Finding(f"{path}[{number}]", f"the fractions sum to {total:g}, not to 1")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _names(value: Any) -> list[str]:
    return [name for name in _list(value) if isinstance(name, str)]


def _list(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else []
