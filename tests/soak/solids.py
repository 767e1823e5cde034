"""Random trees of bodies with a formula, as part files, and what is true of them.

The truth is written here anew, from the shapes' own formulas: the least and the greatest of signed
distances have the sign of the boolean, and are never deeper than its true distance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray

Bound = Callable[[FloatArray], FloatArray]

#: Where bodies are put [mm].
_LOW, _HIGH = 2.0, 14.0
_DIGITS = 4


@dataclass(frozen=True)
class Body:
    """lines : of the part file; bound : (n, 3) → (n,) mm, positive inside, right in sign, never
    deeper than the true distance; exact for a body of its own."""

    lines: str
    bound: Bound


def random_part(rng: np.random.Generator) -> tuple[str, Bound]:
    """The text of a part file, and the bound of its solid."""
    bodies = [_LEAVES[rng.integers(len(_LEAVES))](rng) for _ in range(rng.integers(1, 6))]
    text = "".join(f'[[body]]\nname = "body {n}"\n{body.lines}' for n, body in enumerate(bodies))
    there = [(f"body {n}", body.bound) for n, body in enumerate(bodies)]
    while len(there) > 1:
        there = [there[n] for n in rng.permutation(len(there))]
        count = min(len(there), int(rng.integers(2, 4)))
        chosen, there = there[:count], there[count:]
        kind = str(rng.choice(["union", "difference", "intersection"], p=[0.55, 0.35, 0.1]))
        name = f"{kind} {len(text)}"
        names = ", ".join(f'"{one}"' for one, _ in chosen)
        text += f'[[body]]\nname = "{name}"\nkind = "{kind}"\nof = [{names}]\n'
        there.append((name, _combined(kind, [bound for _, bound in chosen])))
    head = f'name = "random"\npitch_mm = {rng.uniform(0.4, 0.8):.2f}\n{MATERIALS}'
    return head + text + random_composition(rng) + random_process(rng), there[0][1]


MATERIALS = '[[material]]\nname = "316L"\n[[material]]\nname = "WC-12Co"\n'


def random_composition(rng: np.random.Generator) -> str:
    """One feature and one profile, for all of the part."""
    at, way = _vector(rng.uniform(_LOW, _HIGH, 3)), _vector(rng.normal(size=3))
    feature = str(rng.choice([
        f'{{ kind = "point", at_mm = {at} }}', '{ kind = "surface" }',
        f'{{ kind = "axis", point_mm = {at}, direction = {way} }}',
        f'{{ kind = "plane", point_mm = {at}, normal = {way} }}',
        '{ kind = "coordinate", along = "x" }', '{ kind = "coordinate", along = "z" }',
    ]))
    near, far = (_mixture(share) for share in np.sort(rng.uniform(0.1, 0.9, 2)))
    end = rng.uniform(4.0, 16.0)
    profile = str(rng.choice([
        f'{{ kind = "linear", near = {near}, far = {far}, over_mm = [0, {end:.2f}] }}',
        f'{{ kind = "parabola", near = {far}, far = {near}, over_mm = [0, {end:.2f}] }}',
        f'{{ kind = "constant", of = {near} }}',
        f'{{ kind = "steps", steps = [{{ over_mm = [0, {end / 2:.2f}], of = {near} }}, '
        f"{{ over_mm = [{end / 2:.2f}, {end:.2f}], of = {far} }}] }}",
    ]))
    return f"[composition]\nfeature = {feature}\nprofile = {profile}\n"


def random_process(rng: np.random.Generator) -> str:
    """Beads of any usual size and pace."""
    width = rng.uniform(1.0, 2.5)
    return (
        f"[process]\nbead_width_mm = {width:.2f}\n"
        f"layer_height_mm = {width * rng.uniform(0.3, 0.5):.2f}\n"
        f"speed_mm_s = {rng.uniform(6, 16):.1f}\noverlap = {rng.uniform(0.1, 0.5):.2f}\n"
        f'strategy = "{rng.choice(["offset", "iso-3d"])}"\n'
        f'powder = "{rng.choice(["lead", "lead", "dwell", "none"])}"\n'
        f"dwell_s = {rng.uniform(0, 10):.1f}\nlead_in_mm = {rng.uniform(0, 3):.1f}\n"
        f"fraction_step = {rng.choice([0.005, 0.02, 0.05])}\n"
    )


def _combined(kind: str, bounds: Sequence[Bound]) -> Bound:
    if kind == "union":
        return lambda points: np.max([bound(points) for bound in bounds], axis=0)
    if kind == "intersection":
        return lambda points: np.min([bound(points) for bound in bounds], axis=0)
    first, *others = bounds
    return lambda points: np.min([first(points), *(-one(points) for one in others)], axis=0)


def _sphere(rng: np.random.Generator) -> Body:
    centre, radius = _place(rng), _rounded(rng.uniform(2, 6))
    return Body(
        f'kind = "sphere"\ncentre_mm = {_vector(centre)}\nradius_mm = {radius}\n',
        lambda points: radius - np.linalg.norm(points - centre, axis=1),
    )


def _box(rng: np.random.Generator) -> Body:
    centre, half = _place(rng), np.round(rng.uniform(1.5, 6, 3), _DIGITS)
    low, high = np.round(centre - half, _DIGITS), np.round(centre + half, _DIGITS)
    return Body(
        f'kind = "box"\nlow_mm = {_vector(low)}\nhigh_mm = {_vector(high)}\n',
        lambda points: _corner(np.minimum(points - low, high - points)),
    )


def _cylinder(rng: np.random.Generator) -> Body:
    base, radius = _place(rng), _rounded(rng.uniform(1.5, 5))
    way = np.array([0.0, 0.0, 1.0]) if rng.random() < 0.5 else rng.normal(size=3)
    top = np.round(base + way / np.linalg.norm(way) * rng.uniform(4, 10), _DIGITS)

    def bound(points: FloatArray) -> FloatArray:
        long = float(np.linalg.norm(top - base))
        along = (points - base) @ (top - base) / long
        across = np.linalg.norm(points - base - np.outer(along, (top - base) / long), axis=1)
        return _corner(np.stack([radius - across, along, long - along], axis=1))

    return Body(
        f'kind = "cylinder"\nbase_mm = {_vector(base)}\ntop_mm = {_vector(top)}\n'
        f"radius_mm = {radius}\n", bound,
    )


def _torus(rng: np.random.Generator) -> Body:
    centre, radius, tube = _place(rng), _rounded(rng.uniform(3, 6)), _rounded(rng.uniform(1, 2.5))

    def bound(points: FloatArray) -> FloatArray:
        x, y, z = (points - centre).T
        return tube - np.hypot(np.hypot(x, y) - radius, z)

    return Body(
        f'kind = "torus"\ncentre_mm = {_vector(centre)}\nradius_mm = {radius}\n'
        f"tube_radius_mm = {tube}\n", bound,
    )


_LEAVES = (_sphere, _box, _cylinder, _torus)


def _corner(depths: FloatArray) -> FloatArray:
    """Depth below faces that stand square to each other, opposite ones included."""
    beyond = -np.linalg.norm(np.minimum(depths, 0.0), axis=1)
    inside: FloatArray = depths.min(axis=1)
    return np.where(inside > 0.0, inside, beyond)


def _place(rng: np.random.Generator) -> FloatArray:
    return np.round(rng.uniform(_LOW, _HIGH, 3), _DIGITS)


def _rounded(value: float) -> float:
    return round(float(value), _DIGITS)


def _vector(values: FloatArray) -> str:
    return "[" + ", ".join(f"{value:.{_DIGITS}f}" for value in values) + "]"


def _mixture(share: float) -> str:
    steel = round(float(share), 3)
    return f'{{ "316L" = {steel}, "WC-12Co" = {round(1 - steel, 3)} }}'
