"""Checks between the bodies of a part file: names, circles, bodies without a composition.

They run on plain data of any shape; the models check each key by itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from lmctl.config.bodies import MAX_BODIES, MAX_TREE_DEPTH
from lmctl.config.composition_rules import unknown_body
from lmctl.errors import Finding

_BOOLEANS = ("union", "difference", "intersection")


def body_tree_findings(data: dict[str, Any], *, several_materials: bool) -> list[Finding]:
    """All mistakes between the bodies of a part file."""
    found = data.get("body")
    bodies = [b if isinstance(b, dict) else {} for b in found] if isinstance(found, list) else []
    names = [b.get("name") for b in bodies]
    index = {name: n for n, name in enumerate(names) if isinstance(name, str)}
    findings = list(_own_findings(bodies))
    for number, name in enumerate(names):
        if isinstance(name, str) and index[name] != number:
            findings.append(Finding(f"body[{index[name] + 1}].name", f"{name!r} is there twice"))
    below = [[index[name] for name in _of(body) if name in index] for body in bodies]
    for number, body in enumerate(bodies):
        for name in _of(body):
            findings += unknown_body(f"body[{number + 1}].of", name, index)
    circle = _circle(below)
    if circle:
        words = " is made of ".join(repr(names[n]) for n in circle)
        findings.append(Finding(f"body[{circle[0] + 1}].of", f"runs in a circle: {words}"))
        return findings
    deepest, largest = _extents(below)
    if deepest > MAX_TREE_DEPTH or largest > MAX_BODIES:
        findings.append(Finding("body", f"bodies of bodies: {deepest} deep, {largest:,} in all; at "
                                f"most {MAX_TREE_DEPTH} deep and {MAX_BODIES:,} in all"))
        return findings
    roots = root_body_indices(data)
    findings += _root_findings(data, bodies, roots)
    if several_materials and bodies:
        findings += _rule_findings(data, bodies, below, roots)
    return findings


def root_body_indices(data: dict[str, Any]) -> list[int]:
    """The bodies that no other body and no feature names: those the part is made of.

    A body whose own composition names it is one of them.
    """
    found = data.get("body")
    bodies = [b if isinstance(b, dict) else {} for b in found] if isinstance(found, list) else []
    used = {name for body in bodies for name in _of(body)}
    used |= _featured(data.get("composition"))
    for body in bodies:
        used |= {name for name in _featured(body.get("composition")) if name != body.get("name")}
    return [n for n, b in enumerate(bodies)
            if not (isinstance(b.get("name"), str) and b["name"] in used)]


def _featured(composition: Any) -> set[str]:
    """Names of the bodies that a composition's features measure from."""
    if not isinstance(composition, dict):
        return set()
    blend = composition.get("blend")
    holders = [composition, *(blend if isinstance(blend, list) else [])]
    features = [h.get("feature") for h in holders if isinstance(h, dict)]
    return {f["of"] for f in features if isinstance(f, dict) and isinstance(f.get("of"), str)}


def _of(body: dict[str, Any]) -> list[str]:
    of = body.get("of")
    names = [of] if isinstance(of, str) else of if isinstance(of, list) else []
    return [name for name in names if isinstance(name, str)]


def _own_findings(bodies: list[dict[str, Any]]) -> Iterator[Finding]:
    for number, body in enumerate(bodies, start=1):
        file = body.get("file")
        states_its_own = isinstance(file, str) and file.lower().endswith(".3mf")
        if body.get("kind") == "mesh" and "units" not in body and not states_its_own:
            yield Finding(f"body[{number}].units", 'is missing: "mm", "cm", "m" or "inch"; '
                          "the file does not say")
        if "group" in body and isinstance(file, str) and not file.lower().endswith(".obj"):
            yield Finding(f"body[{number}].group", "only OBJ files name groups; leave it out")


def _circle(below: list[list[int]]) -> list[int]:
    """Bodies that are made of one another in a circle, the first repeated last; [] if none are."""
    state = [0] * len(below)  # 1: being walked, 2: done
    for start in range(len(below)):
        path, turns = [start], [iter(below[start])]
        if state[start]:
            continue
        state[start] = 1
        while path:
            following = next(turns[-1], None)
            if following is None:
                state[path.pop()] = 2
                turns.pop()
            elif state[following] == 1:
                return [*path[path.index(following):], following]
            elif state[following] == 0:
                state[following] = 1
                path.append(following)
                turns.append(iter(below[following]))
    return []


def _extents(below: list[list[int]]) -> tuple[int, int]:
    """Levels of the deepest body, and bodies in the largest tree, each as often as it is named."""
    depths: dict[int, int] = {}
    sizes: dict[int, int] = {}
    for start in range(len(below)):
        stack = [start]
        while stack:
            n = stack[-1]
            waiting = [m for m in below[n] if m not in depths]
            if waiting:
                stack += waiting
            else:
                depths[n] = 1 + max((depths[m] for m in below[n]), default=0)
                sizes[n] = 1 + sum(sizes[m] for m in below[n])
                stack.pop()
    return max(depths.values(), default=0), max(sizes.values(), default=0)


def _root_findings(
    data: dict[str, Any], bodies: list[dict[str, Any]], roots: list[int]
) -> Iterator[Finding]:
    if bodies and not roots:
        yield Finding("body", "every body is only measured from: which of them is the part?")
    if len(roots) > 1 and "combine" not in data:
        yield Finding("combine", f"is missing: how do the {len(roots)} bodies make one solid? "
                      '"union", "difference" or "intersection"; write it above the first [table]')
    if len(roots) == 1 and "combine" in data:
        yield Finding("combine", "has nothing to combine: there is one body"
                      + (" that no other is made of" if len(bodies) > 1 else ""))


def _rule_findings(
    data: dict[str, Any], bodies: list[dict[str, Any]], below: list[list[int]], roots: list[int]
) -> Iterator[Finding]:
    """Bodies that lack a composition for several materials, and compositions without effect."""
    ruled = ["composition" in body for body in bodies]
    if "composition" in data:
        for number in [n for n, own in enumerate(ruled) if own]:
            yield Finding(f"body[{number + 1}].composition", "is not used: the part has a "
                          "composition for all of it; leave one of them out")
        return
    if not any(ruled):
        yield Finding("composition", "is missing: which of the materials goes where? Say it of the "
                      "part, or of its bodies")
        return
    bare = sorted(set(bodies_without_composition(bodies, below, roots, data.get("combine"))))
    for number in bare:
        yield Finding(f"body[{number + 1}].composition", "is missing: of what is it?")


def bodies_without_composition(
    bodies: list[dict[str, Any]], below: list[list[int]], roots: list[int], combine: Any
) -> list[int]:
    """The bodies that are deposited although no composition is given for them.

    A union needs a composition for each of its bodies, a difference for its first, an intersection
    for one at least: the others only cut.
    """

    def needed(numbers: list[int], operation: Any) -> list[int]:
        if operation == "difference":
            return bare(numbers[0]) if numbers else []
        each = [bare(n) for n in numbers]
        if operation == "intersection" and any(not found for found in each):
            return []
        return [n for found in each for n in found]

    def bare(number: int) -> list[int]:
        kind = bodies[number].get("kind")
        if "composition" in bodies[number]:
            return []
        if not below[number] or (kind not in _BOOLEANS and kind not in ("shell", "moved")):
            return [number]
        return needed(below[number], kind)

    return needed(roots, combine) if len(roots) > 1 else [n for r in roots for n in bare(r)]
