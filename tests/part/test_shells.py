"""Shells: as thin as they are asked for, whatever the raster; never deeper than their body."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lmctl.errors import InputError
from lmctl.field.plane import loop_area_mm2
from lmctl.part.load import load_part
from lmctl.part.part import Part

Folder = Callable[..., Path]
STEEL = 'name = "p"\n[[material]]\nname = "316L"\n'
BALL = '[[body]]\nname = "b"\nkind = "sphere"\ncentre_mm = [0.1, 0.2, 0.3]\nradius_mm = 9\n'
TUBE = ('[[body]]\nname = "b"\nkind = "cylinder"\nbase_mm = [0, 0, -20]\ntop_mm = [0, 0, 20]\n'
        "radius_mm = 7.3\n")
RING = '[[body]]\nname = "b"\nkind = "torus"\ncentre_mm = [0, 0, 0]\nradius_mm = 9\n' \
       "tube_radius_mm = 3\n"
MESH = '[[body]]\nname = "b"\nkind = "mesh"\nfile = "m.stl"\nunits = "mm"\n'
TWO = ('[[body]]\nname = "one"\nkind = "box"\nlow_mm = [0, 0, 0]\nhigh_mm = [10, 10, 10]\n'
       '[[body]]\nname = "two"\nkind = "box"\nlow_mm = [8, 3, 0]\nhigh_mm = [20, 7, 10]\n'
       '[[body]]\nname = "b"\nkind = "union"\nof = ["one", "two"]\n')
MOVED = BALL.replace('"b"', '"c"') + (
    '[[body]]\nname = "b"\nkind = "moved"\nof = "c"\nscale = 0.5\nby_mm = [3, 0, 0]\n')


CROSS = ('[[body]]\nname = "one"\nkind = "box"\nlow_mm = [0, 9, 0]\nhigh_mm = [20, 11, 20]\n'
         '[[body]]\nname = "two"\nkind = "box"\nlow_mm = [9, 0, 0]\nhigh_mm = [11, 20, 20]\n'
         '[[body]]\nname = "b"\nkind = "union"\nof = ["one", "two"]\n')


def shell(from_mm: float, to_mm: float | None = None) -> str:
    end = "" if to_mm is None else f"to_mm = {to_mm}\n"
    return f'[[body]]\nkind = "shell"\nof = "b"\nfrom_mm = {from_mm}\n{end}'


def part_of(folder: Folder, text: str, making: Any = None, head: str = "") -> Part:
    files = {} if making is None else {"m__stl": making.stl(making.box((0, 0, 0), (17, 12, 9)))}
    return load_part(folder(part__toml=head + STEEL + text, **files) / "part.toml")


def area(part: Part, z: float) -> float:
    return sum(map(loop_area_mm2, part.section(z).loops))


@pytest.mark.parametrize("thick", [0.02, 0.05, 0.2, 0.25, 0.3, 1.0])
@pytest.mark.parametrize("outside", [0.0, 0.4])
def test_thin_shells_keep_their_area(
    thick: float, outside: float, folder: Folder, making: Any
) -> None:
    """The raster's pitch is 0.25 mm."""
    levels = shell(-outside, thick - outside)
    outer, inner = outside, outside - thick
    for z in (0.37, 2.9):
        true = np.pi * ((9 + outer) ** 2 - (9 + inner) ** 2)
        assert area(part_of(folder, BALL + levels), z) == pytest.approx(true, rel=0.01)
    true = np.pi * ((7.3 + outer) ** 2 - (7.3 + inner) ** 2)
    assert area(part_of(folder, TUBE + levels), 1.0) == pytest.approx(true, rel=0.01)

    def round_box(by: float) -> float:
        return 17 * 12 + 2 * (17 + 12) * by + (np.pi if by > 0 else 4.0) * by**2

    true = round_box(outer) - round_box(inner)
    assert area(part_of(folder, MESH + levels, making), 4.1) == pytest.approx(true, rel=0.01)


@pytest.mark.parametrize("wall", [0.01, 0.1, 0.24])
def test_walls_that_a_difference_leaves_keep_their_area(wall: float, folder: Folder) -> None:
    text = (
        'combine = "difference"\n[[body]]\nkind = "box"\nlow_mm = [0, 0, 0]\n'
        f'high_mm = [20, 20, 10]\n[[body]]\nkind = "box"\nlow_mm = [{wall}, {wall}, -1]\n'
        f"high_mm = [{20 - wall}, {20 - wall}, 11]\n")
    part = load_part(folder(part__toml='name = "p"\n' + text.replace(
        "[[body]]", '[[material]]\nname = "316L"\n[[body]]', 1)) / "part.toml")
    assert area(part, 5.0) == pytest.approx(400 - (20 - 2 * wall) ** 2, rel=1e-3)


def test_a_skin_and_its_core_are_the_body_again(folder: Folder, making: Any) -> None:
    mesh = MESH
    text = mesh + (
        '[[body]]\nname = "skin"\nkind = "shell"\nof = "b"\nto_mm = 0.1\n'
        '[[body]]\nname = "core"\nkind = "shell"\nof = "b"\nfrom_mm = 0.1\n'
        '[[body]]\nkind = "union"\nof = ["skin", "core"]\n')
    part = part_of(folder, text, making)
    (loop,) = part.section(4.1).loops
    assert loop_area_mm2(loop) == pytest.approx(17 * 12, rel=1e-6)


@pytest.mark.parametrize(
    ("body", "deepest"),
    [(BALL, 9.0), (TUBE, 7.3), (RING, 3.0), (MESH, 4.5), (TWO, 5.0), (MOVED, 4.5), (CROSS, 1.41)],
)
@pytest.mark.parametrize("key", ["from_mm", "to_mm"])
def test_shells_deeper_than_their_body_are_refused_when_the_part_is_checked(
    body: str, deepest: float, key: str, folder: Folder, making: Any
) -> None:
    deep = shell(deepest + 0.01) if key == "from_mm" else shell(0.5, deepest + 0.01)
    with pytest.raises(InputError, match="lies deeper than") as caught:
        part_of(folder, body + deep, making, "pitch_mm = 1.0\n")
    if key == "to_mm":
        assert f"{deepest:.2g}"[:3] in caught.value.where[0]
    just = shell(deepest - 0.3) if key == "from_mm" else shell(0.5, deepest - 0.3)
    part_of(folder, body + just, making, "pitch_mm = 1.0\n")
