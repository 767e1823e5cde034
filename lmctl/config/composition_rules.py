"""Checks across the keys of a composition: mixtures, ranges, weights, names.

They run on plain data of any shape; the models check each key by itself.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from math import isclose, isfinite
from typing import Any

from lmctl.config import materials
from lmctl.errors import Finding

#: How far the sum of fractions or weights may be from 1; the rest is removed by normalising.
SUM_TOLERANCE = 1e-6


def composition_findings(
    path: str, composition: Any, names: list[str], bodies: Collection[str]
) -> Iterator[Finding]:
    """path : of the composition; names : of the part's materials; bodies : those with a name"""
    if not isinstance(composition, dict):
        return
    blend = composition.get("blend")
    parts = [part for part in blend if isinstance(part, dict)] if isinstance(blend, list) else []
    own = isinstance(composition.get("profile"), dict)
    if isinstance(composition.get("sampled"), dict):
        yield from _sampled_findings(path, composition, names)
        return
    if own:
        yield from _part_findings(path, composition, names, bodies)
    if own and parts:
        yield Finding(f"{path}.blend", "is given beside a profile: give one of the two")
    elif not parts and "profile" not in composition:
        yield Finding(f"{path}.profile", "is missing: which mixture at which distance?")
    elif parts and "feature" in composition:
        yield Finding(f"{path}.feature", "is not used: each part of the blend has its own")
    for number, part in enumerate(parts, start=1):
        yield from _part_findings(f"{path}.blend[{number}]", part, names, bodies)
    if parts:
        yield from _weight_findings(path, composition, parts)


def _sampled_findings(
    path: str, composition: dict[str, Any], names: list[str]
) -> Iterator[Finding]:
    for key in ("feature", "profile", "blend", "weights", "power"):
        if key in composition:
            yield Finding(f"{path}.{key}", "is not used: the mixture is sampled in a file")
    stated = composition["sampled"].get("properties")
    for name in stated if isinstance(stated, dict) else ():
        if name not in names:
            yield _no_material(f"{path}.sampled.properties", name, names)


def _part_findings(
    path: str, part: dict[str, Any], names: list[str], bodies: Collection[str]
) -> Iterator[Finding]:
    feature = part.get("feature", {"kind": "surface"})
    kind = feature.get("kind") if isinstance(feature, dict) else None
    if isinstance(feature, dict) and isinstance(feature.get("of"), str):
        yield from unknown_body(f"{path}.feature.of", feature["of"], bodies)
    profile = part.get("profile")
    if not isinstance(profile, dict):
        return
    for place, mixture in _mixtures(profile):
        yield from _mixture_findings(f"{path}.profile.{place}", mixture, names)
    if kind == "surface":
        return
    if profile.get("kind") in ("linear", "power", "parabola") and "over_mm" not in profile:
        yield Finding(f"{path}.profile.over_mm", "is missing: from which distance to which? "
                      "(only a surface has a largest depth to take)")
    if profile.get("kind") == "normalised":
        yield Finding(f"{path}.profile", "only a surface has a largest depth to be normalised by; "
                      'write kind = "linear" with over_mm')


def _weight_findings(
    path: str, composition: dict[str, Any], parts: list[dict[str, Any]]
) -> Iterator[Finding]:
    given = [part.get("weight") for part in parts]
    if composition.get("weights") == "inverse-distance":
        for number, (weight, part) in enumerate(zip(given, parts, strict=True), start=1):
            feature = part.get("feature")
            if weight is not None:
                yield Finding(f"{path}.blend[{number}].weight",
                              "is not used: weights go by inverse distance")
            if isinstance(feature, dict) and feature.get("kind") == "coordinate":
                yield Finding(f"{path}.blend[{number}].feature",
                              "a coordinate is no distance to weigh by")
        return
    for number, weight in enumerate(given, start=1):
        if weight is None:
            yield Finding(f"{path}.blend[{number}].weight", "is missing")
    weights = [w for w in given if isinstance(w, int | float) and not isinstance(w, bool)]
    total = sum(weights)
    if len(weights) < len(given) or not isfinite(total):
        return
    if total == 0:
        yield Finding(f"{path}.blend", "the weights sum to 0: nothing would be deposited")
    elif not isclose(total, 1.0, rel_tol=0, abs_tol=SUM_TOLERANCE):
        yield Finding(f"{path}.blend", f"the weights sum to {total:g}, not to 1")


def unknown_body(path: str, name: str, bodies: Collection[str]) -> Iterator[Finding]:
    """A finding where no body has this name."""
    if name not in bodies:
        guess = materials.suggest_name(name, sorted(bodies))
        listed = guess or f"names are {', '.join(sorted(bodies)) or 'given to none'}"
        yield Finding(path, f"there is no body {name!r}: {listed}")


def _mixtures(profile: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    for key in ("near", "far", "of"):
        if key in profile:
            yield key, profile[key]
    for key in ("points", "steps"):
        rows = profile.get(key)
        for number, row in enumerate(rows if isinstance(rows, list) else [], start=1):
            if isinstance(row, dict) and "of" in row:
                yield f"{key}[{number}].of", row["of"]


def _mixture_findings(path: str, mixture: Any, names: list[str]) -> Iterator[Finding]:
    if not isinstance(mixture, dict) or not mixture:
        return  # the model reports this
    for name in mixture:
        if name not in names:
            yield _no_material(path, name, names)
    shares = list(mixture.values())
    if any(isinstance(v, bool) or not isinstance(v, int | float) for v in shares):
        return
    total = sum(shares)
    if isfinite(total) and not isclose(total, 1.0, rel_tol=0, abs_tol=SUM_TOLERANCE):
        yield Finding(path, f"the fractions sum to {total:g}, not to 1")


def _no_material(path: str, name: str, names: list[str]) -> Finding:
    guess = materials.suggest_name(name, names)
    listed = guess or f"the part's materials are {', '.join(names) or 'missing'}"
    return Finding(path, f"there is no material {name!r}: {listed}")
