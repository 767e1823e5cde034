"""Checks between what acts on a part and the rest of its part file.

They run on plain data of any shape; the models check each key by itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from lmctl.config.composition_rules import unknown_body
from lmctl.config.materials import suggest_name
from lmctl.config.simulation import WHOLE_SURFACE
from lmctl.errors import Finding

_PLANE = ("plane-stress", "plane-strain")


def simulation_findings(data: dict[str, Any], bodies: set[str]) -> Iterator[Finding]:
    """Mistakes of faces, loads, supports, heat, simulation and optimise. bodies : their names"""
    faces = _tables(data.get("face"))
    names = [face["name"] for face in faces if isinstance(face.get("name"), str)]
    materials = [m["name"] for m in _tables(data.get("material")) if isinstance(m.get("name"), str)]
    for number, face in enumerate(faces, start=1):
        name = face.get("name")
        if isinstance(name, str) and names.index(name) != number - 1:
            yield Finding(f"face[{number}].name", f"{name!r} is there twice")
        if isinstance(name, str) and (name in bodies or name == WHOLE_SURFACE):
            yield Finding(f"face[{number}].name", f"{name!r} already names "
                          + ("a body" if name in bodies else "the whole surface"))
        feature = face.get("feature")
        if isinstance(feature, dict) and isinstance(feature.get("of"), str):
            yield from unknown_body(f"face[{number}].feature.of", feature["of"], bodies)
    known = [*names, *sorted(bodies), WHOLE_SURFACE]
    for key in ("load", "support", "heat"):
        for number, table in enumerate(_tables(data.get(key)), start=1):
            on = table.get("on")
            if isinstance(on, str) and on not in known:
                guess = suggest_name(on, known)
                listed = f"faces are {', '.join(known)}"
                yield Finding(f"{key}[{number}].on",
                              f"there is no face {on!r}: {guess + ' ' if guess else ''}{listed}")
    yield from _model_findings(data, materials)
    yield from _optimise_findings(data.get("optimise"), materials)


def _model_findings(data: dict[str, Any], materials: list[str]) -> Iterator[Finding]:
    simulation = data.get("simulation")
    simulation = simulation if isinstance(simulation, dict) else {}
    model = simulation.get("model", "solid")
    if isinstance(matrix := simulation.get("matrix"), str) and matrix not in materials:
        yield Finding("simulation.matrix", _no_material(matrix, materials))
    for key in ("section_mm", "thickness_mm"):
        if key in simulation and model not in _PLANE:
            yield Finding(f"simulation.{key}", "is of plane models only")
    axes = {"axisymmetric": "rz", "solid": "xyz"}.get(str(model), "xy")
    for number, support in enumerate(_tables(data.get("support")), start=1):
        fix = support.get("fix")
        for axis in fix if isinstance(fix, list) else []:
            if isinstance(axis, str) and axis not in axes:
                yield Finding(f"support[{number}].fix", f"a {model} model has no {axis}: its axes "
                              f"are {', '.join(axes)}")
    for number, load in enumerate(_tables(data.get("load")), start=1):
        for key in ("traction_MPa", "force_N"):
            vector = load.get(key)
            if not isinstance(vector, list) or len(vector) != 3:
                continue
            if model in _PLANE and vector[2] != 0:
                yield Finding(f"load[{number}].{key}", "a plane model takes nothing along z")
            if model == "axisymmetric" and vector[1] != 0:
                yield Finding(f"load[{number}].{key}",
                              "an axisymmetric model takes [radial, 0, axial]")


def _optimise_findings(optimise: Any, materials: list[str]) -> Iterator[Finding]:
    if not isinstance(optimise, dict):
        return
    highest: dict[Any, float] = {}
    lowest: dict[Any, float] = {}
    for number, limit in enumerate(_tables(optimise.get("limit")), start=1):
        name = limit.get("material")
        if isinstance(name, str) and name not in materials:
            yield Finding(f"optimise.limit[{number}].material", _no_material(name, materials))
        of = (limit.get("quantity"), name)
        if isinstance(most := limit.get("at_most"), int | float):
            highest[of] = min(most, highest.get(of, most))
        if isinstance(least := limit.get("at_least"), int | float):
            lowest[of] = max(least, lowest.get(of, least))
    for of, least in lowest.items():
        if least > highest.get(of, least):
            yield Finding("optimise.limit", f"limits contradict: {of[0]} at least {least:g} and at "
                          f"most {highest[of]:g}")
    least_of = {of[1]: least for of, least in lowest.items() if of[0] == "fraction"}
    if sum(least_of.values()) > 1:
        yield Finding("optimise.limit", "limits contradict: the least fractions sum to "
                      f"{sum(least_of.values()):g}, above 1")
    for number, mixture in enumerate(_tables(optimise.get("forbidden")), start=1):
        name = mixture.get("material")
        if isinstance(name, str) and name not in materials:
            yield Finding(f"optimise.forbidden[{number}].material", _no_material(name, materials))


def _no_material(name: str, materials: list[str]) -> str:
    guess = suggest_name(name, materials)
    return f"there is no material {name!r}: " + (
        guess or f"the part's materials are {', '.join(materials) or 'missing'}")


def _tables(value: Any) -> list[dict[str, Any]]:
    return [item for item in value if isinstance(item, dict)] if isinstance(value, list) else []
