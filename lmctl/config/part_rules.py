"""Read a part file and report every mistake at once, also those that concern several keys.

The cross-checks run on the plain data, before and regardless of the models' own checks: a file with
a misspelt key *and* an unknown material gets both reported. Checks between bodies are in
`tree_rules`, checks of mixtures and blends in `composition_rules`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from lmctl.config import materials, toml_file
from lmctl.config.alloy_rules import alloy_rule_findings
from lmctl.config.composition_rules import composition_findings
from lmctl.config.deposition_heat_rules import deposition_heat_findings
from lmctl.config.file_kind import FileKind, refuse_other_kind
from lmctl.config.free_numbers import resolve_free_numbers
from lmctl.config.part_file import PartFile
from lmctl.config.simulation_rules import simulation_findings
from lmctl.config.traveller import unknown_powders
from lmctl.config.tree_rules import body_tree_findings
from lmctl.errors import ConfigError, Finding

#: What pydantic puts into the path of a key: the kind of the body, feature or profile it is in.
_TAG = re.compile(
    r"(body\[\d+\]|\bfeature|\bprofile)\."
    r"(?:mesh|cloud|box|sphere|cylinder|cone|torus|half-space|prism|shell|moved|union|difference"
    r"|intersection|point|segment|axis|polyline|spline|plane|face|sheet|surface|coordinate"
    r"|linear|parabola|normalised|power|table|steps|constant)(?=$|\.)"
)


def load_part_file(path: Path) -> tuple[PartFile, str]:
    """The checked part file and its own text. Raises ConfigError with all findings."""
    text = toml_file.read_text(path)
    refuse_other_kind(toml_file.parse_tables(text, name=str(path)), FileKind.PART, path)
    return parse_part_file(text, name=str(path)), text


def parse_part_file(
    text: str, *, name: str, values: Mapping[str, float] | None = None
) -> PartFile:
    """Check the text of a part file.

    name : what to call it in messages
    values : of its free numbers, by name; None takes their starting values
    Raises ConfigError with all findings, each with the path of its key.
    """
    numbers = resolve_free_numbers(toml_file.parse_tables(text, name=name), values)
    part: PartFile | None = None
    findings: list[Finding] = []
    unlisted = 0
    try:
        part = toml_file.validated_model(numbers.data, PartFile, name=name)
    except ConfigError as error:
        findings = [Finding(_TAG.sub(r"\1", f.path), f.reason) for f in error.findings]
        unlisted = error.unlisted
    findings += [*numbers.findings, *cross_key_findings(numbers.data)]
    if findings or part is None:
        raise ConfigError.of_findings(name, findings, unlisted=unlisted)
    return part


def cross_key_findings(data: dict[str, Any]) -> list[Finding]:
    """Mistakes that concern several keys of a part file, as plain data of any shape."""
    tables = [item for item in _list(data.get("material")) if isinstance(item, dict)]
    names = [item["name"] for item in tables if isinstance(item.get("name"), str)]
    findings = list(_material_findings(tables))
    findings += _traveller_findings(data.get("traveller"), names)
    findings += body_tree_findings(data, several_materials=len(names) > 1)
    bodies = _list(data.get("body"))
    known = {b["name"] for b in bodies if isinstance(b, dict) and isinstance(b.get("name"), str)}
    findings += composition_findings("composition", data.get("composition"), names, known)
    for number, body in enumerate(bodies, start=1):
        if isinstance(body, dict):
            findings += composition_findings(
                f"body[{number}].composition", body.get("composition"), names, known
            )
    findings += _region_findings(data.get("process"), known)
    findings += _substrate_findings(data.get("substrate"), known)
    findings += _copy_findings(data)
    findings += simulation_findings(data, known)
    findings += alloy_rule_findings(data.get("alloy_rule"), names)
    findings += deposition_heat_findings(data)
    return findings


def _region_findings(process: Any, bodies: set[str]) -> Iterator[Finding]:
    """Strategies of bodies that are not there, or that nothing can be planned beside."""
    regions = _list(process.get("region")) if isinstance(process, dict) else []
    for number, region in enumerate(regions, start=1):
        name = region.get("body") if isinstance(region, dict) else None
        if not isinstance(name, str):
            continue
        where = f"process.region[{number}].body"
        if name not in bodies:
            guess = materials.suggest_name(name, sorted(bodies))
            yield Finding(where, f"no body is named {name!r}" + (f" ({guess})" if guess else ""))
        if process.get("strategy") == "iso-3d":
            yield Finding(where, 'beside strategy = "iso-3d" no body can have another: its tracks '
                          "are those of the whole distance field")


def _substrate_findings(substrate: Any, bodies: set[str]) -> Iterator[Finding]:
    """A body that is not there, and a mesh without units."""
    if not isinstance(substrate, dict):
        return
    name, file = substrate.get("of"), substrate.get("file")
    if isinstance(name, str) and name not in bodies:
        guess = materials.suggest_name(name, sorted(bodies))
        yield Finding("substrate.of", f"no body is named {name!r}" + (f" ({guess})" if guess
                                                                    else ""))
    if substrate.get("kind") == "mesh" and "units" not in substrate and not (
            isinstance(file, str) and file.lower().endswith(".3mf")):
        yield Finding("substrate.units", 'is missing: "mm", "cm", "m" or "inch"; the file does not '
                      "say")


def _copy_findings(data: dict[str, Any]) -> Iterator[Finding]:
    """Names that two copies have, and what needs one part on a level plate."""
    copies = _list(data.get("copy"))
    yield from _height_check_findings(data, copies)
    names = [one.get("name") if isinstance(one, dict) else None for one in copies]
    for number, name in enumerate(names, start=1):
        if name is not None and name in names[: number - 1]:
            yield Finding(f"copy[{number}].name", f"{name!r} is there twice")
    substrate = data.get("substrate")
    if copies and isinstance(substrate, dict) and substrate.get("kind", "plate") != "plate":
        yield Finding("copy", "several copies stand on a level plate, and the substrate is a "
                      f"{substrate.get('kind')}")


def _height_check_findings(data: dict[str, Any], copies: list[Any]) -> Iterator[Finding]:
    """Heights are checked over a level plate, of layers that rise one after the other."""
    process, substrate = data.get("process"), data.get("substrate")
    if not isinstance(process, dict) or "height_check_every" not in process:
        return
    if copies and process.get("copy_order") == "part-by-part":
        yield Finding("process.height_check_every", "layers of copies deposited part by part do "
                      "not rise one after the other: deposit layer by layer, or leave it out")
    if isinstance(substrate, dict) and substrate.get("kind", "plate") != "plate":
        yield Finding("process.height_check_every", "heights are checked over a level plate, and "
                      f"the substrate is a {substrate.get('kind')}: leave it out")


def _material_findings(tables: list[dict[str, Any]]) -> Iterator[Finding]:
    seen: set[str] = set()
    for number, item in enumerate(tables, start=1):
        name = item.get("name")
        if not isinstance(name, str):
            continue
        if name in seen:
            yield Finding(f"material[{number}].name", f"{name!r} is there twice")
        seen.add(name)
        if "density_g_cm3" not in item and materials.find_material(name) is None:
            guess = materials.suggest_name(name, list(materials.MATERIAL_LIBRARY))
            yield Finding(
                f"material[{number}].density_g_cm3",
                f"is missing, and the library has no material {name!r}"
                + (f" ({guess})" if guess else ""),
            )


def _traveller_findings(data: Any, names: list[str]) -> Iterator[Finding]:
    powder = data.get("powder") if isinstance(data, dict) else None
    for name in unknown_powders(powder if isinstance(powder, dict) else {}, names):
        guess = materials.suggest_name(name, names)
        yield Finding(f"traveller.powder.{name}",
                      "is no material of the part" + (f" ({guess})" if guess else ""))


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []
