"""Reading a part file with every mistake at once, also those that concern several keys.

The cross-checks run on the plain data, before and regardless of the models' own checks: a file with
a misspelt key *and* an unknown material is told of both.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from math import isclose, isfinite
from pathlib import Path
from typing import Any

from lmctl.config import materials, toml_file
from lmctl.config.part_file import PartFile
from lmctl.errors import ConfigError, Finding

#: How far the fractions of one mixture may be from 1 in sum; what is left is normalised away.
SUM_TOLERANCE = 1e-6

_TAG = re.compile(
    r"^(body\[\d+\]|composition\.feature|composition\.profile)"
    r"\.(?:mesh|cloud|box|sphere|cylinder|axis|point|surface|coordinate|linear|power|table|constant)"
    r"(?=$|\.)"
)


def load_part_file(path: Path) -> tuple[PartFile, str]:
    """The checked part file and its own text. Raises ConfigError with all findings."""
    text = toml_file.read_text(path)
    return parse_part_file(text, name=str(path)), text


def parse_part_file(text: str, *, name: str) -> PartFile:
    """Check the text of a part file. name : what to call it in messages.

    Raises ConfigError with all findings, each with the path of its key.
    """
    part: PartFile | None = None
    findings: list[Finding] = []
    try:
        part = toml_file.parse(text, PartFile, name=name)
    except ConfigError as error:
        if not error.findings:  # not TOML at all
            raise
        findings = [Finding(_TAG.sub(r"\1", f.path), _said(f.reason)) for f in error.findings]
        findings = [f for f in findings if not _follows_from_others(f, findings)]
    findings += cross_findings(tomllib.loads(text))
    if findings or part is None:
        count = "1 mistake" if len(findings) == 1 else f"{len(findings)} mistakes"
        raise ConfigError(f"{name} has {count}", findings=findings)
    return part


def _follows_from_others(finding: Finding, findings: list[Finding]) -> bool:
    """Whether a list is only called too short because its items are wrong, each told already."""
    return finding.reason.startswith("Tuple should have at least") and any(
        other.path.startswith(f"{finding.path}[") for other in findings
    )


def _said(reason: str) -> str:
    """pydantic's words about tagged unions, in the reader's terms."""
    if reason.startswith("Unable to extract tag"):
        return "says no `kind`"
    if reason.startswith("Tuple should have at least 1 item"):
        return "at least one is needed"
    found = re.match(r"Input tag '(.*)' found using 'kind' does not match any of .*: (.*)$", reason)
    return f"there is no kind {found[1]!r}; there are {found[2]}" if found else reason


def cross_findings(data: dict[str, Any]) -> list[Finding]:
    """What is wrong between the keys of a part file as plain data, of whatever shape it is."""
    tables = [item for item in _list(data.get("material")) if isinstance(item, dict)]
    names = [item["name"] for item in tables if isinstance(item.get("name"), str)]
    findings = list(_material_findings(tables))
    bodies = _list(data.get("body"))
    if len(bodies) > 1 and "combine" not in data:
        findings.append(
            Finding("combine", f"is missing: how do the {len(bodies)} bodies make one solid? "
                    '"union", "difference" or "intersection"; write it above the first [table]')
        )
    if len(bodies) == 1 and "combine" in data:
        findings.append(Finding("combine", "has nothing to combine: there is one body"))
    composition = data.get("composition")
    if composition is None and len(names) > 1:
        findings.append(
            Finding("composition", f"is missing: which of the {len(names)} materials goes where?")
        )
    if isinstance(composition, dict) and isinstance(composition.get("profile"), dict):
        profile = composition["profile"]
        for path, mixture in _mixtures(profile):
            findings += _mixture_findings(f"composition.profile.{path}", mixture, names)
        feature = composition.get("feature", {"kind": "surface"})
        if (
            profile.get("kind") in ("linear", "power")
            and "over_mm" not in profile
            and isinstance(feature, dict)
            and feature.get("kind") != "surface"
        ):
            findings.append(
                Finding("composition.profile.over_mm", "is missing: from which distance to which? "
                        "(only the own surface has a largest depth to take)")
            )
    return findings


def _material_findings(tables: list[dict[str, Any]]) -> Iterator[Finding]:
    seen: set[str] = set()
    for number, item in enumerate(tables, start=1):
        name = item.get("name")
        if not isinstance(name, str):
            continue
        if name in seen:
            yield Finding(f"material[{number}].name", f"{name!r} is there twice")
        seen.add(name)
        if "density_g_cm3" not in item and materials.find(name) is None:
            guess = materials.closest(name, list(materials.LIBRARY))
            yield Finding(
                f"material[{number}].density_g_cm3",
                f"is missing, and the library has no material {name!r}"
                + (f" ({guess})" if guess else ""),
            )


def _mixtures(profile: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    for key in ("near", "far", "of"):
        if key in profile:
            yield key, profile[key]
    for number, point in enumerate(_list(profile.get("points")), start=1):
        if isinstance(point, dict) and "of" in point:
            yield f"points[{number}].of", point["of"]


def _mixture_findings(path: str, mixture: Any, names: list[str]) -> Iterator[Finding]:
    if not isinstance(mixture, dict) or not mixture:
        return  # the model says so
    for name in mixture:
        if name not in names:
            guess = materials.closest(name, names)
            listed = guess or f"the part's materials are {', '.join(names) or 'missing'}"
            yield Finding(path, f"there is no material {name!r}: {listed}")
    shares = list(mixture.values())
    if any(isinstance(v, bool) or not isinstance(v, int | float) for v in shares):
        return
    total = sum(shares)
    if isfinite(total) and not isclose(total, 1.0, rel_tol=0, abs_tol=SUM_TOLERANCE):
        yield Finding(path, f"the fractions sum to {total:g}, not to 1")


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []
