"""Depths do not depend on how little of a body is in the part, nor on where it was moved to."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lmctl.array_types import FloatArray
from lmctl.part.load import load_part
from lmctl.part.part import Part

Folder = Callable[..., Path]
TWO = 'name = "p"\npitch_mm = 1.0\n[[material]]\nname = "316L"\n[[material]]\nname = "WC-12Co"\n'
ONE = 'name = "p"\npitch_mm = 1.0\n[[material]]\nname = "316L"\n'
# A bar of 30 × 24 × 18 mm made of two.
BAR = """
[[body]]
name = "a"
kind = "box"
low_mm = [0, 0, 0]
high_mm = [16, 24, 18]
[[body]]
name = "b"
kind = "box"
low_mm = [12, 0, 0]
high_mm = [30, 24, 18]
[[body]]
name = "u"
kind = "union"
of = ["a", "b"]
"""
SIZE = np.array([30.0, 24.0, 18.0])
BY_DEPTH = (
    'composition.profile = { kind = "linear", near = { "316L" = 1 }, far = { "WC-12Co" = 1 }, '
    "over_mm = [0, 10] }\n"
)
FAST = settings(
    max_examples=4, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def part_of(folder: Folder, text: str) -> Part:
    return load_part(folder(part__toml=text) / "part.toml")


def depth(points: FloatArray) -> FloatArray:
    """Below the surface of the bar, at places in it."""
    return np.minimum(points, SIZE - points).min(axis=1)


def window(low: FloatArray, high: FloatArray, of: str) -> str:
    return (f'[[body]]\nname = "w"\nkind = "box"\nlow_mm = {low.tolist()}\n'
            f'high_mm = {high.tolist()}\n[[body]]\nkind = "intersection"\nof = ["{of}", "w"]\n')


shares = st.tuples(*[st.integers(0, 8)] * 3)


@FAST
@given(shares, shares)
def test_a_piece_of_a_body_is_of_what_it_was_in_the_whole(
    folder: Folder, one: tuple[int, ...], other: tuple[int, ...]
) -> None:
    low = np.minimum(one, other) / 8 * (SIZE - 2)
    high = np.maximum(one, other) / 8 * (SIZE - 2) + 2
    part = part_of(folder, TWO + BAR + BY_DEPTH + window(low, high, "u"))
    points = np.random.default_rng(0).uniform(low, high, (200, 3))
    found = part.composition(points)[:, 1]
    assert found == pytest.approx(np.minimum(depth(points) / 10, 1), abs=1e-6)


@FAST
@given(shares, st.sampled_from([(2.0, 5.0), (3.0, 20.0), (4.0, 8.0)]))
def test_a_piece_of_a_shell_is_what_the_whole_shell_has_there(
    folder: Folder, share: tuple[int, ...], levels: tuple[float, float]
) -> None:
    """From just outside the shell, so that something of it is always in the window."""
    low = np.array(share) / 8 * (SIZE - 9)
    high = low + 9
    shell = (f'[[body]]\nname = "s"\nkind = "shell"\nof = "u"\nfrom_mm = {levels[0]}\n'
             + (f"to_mm = {levels[1]}\n" if levels[1] < 9 else ""))
    points = np.random.default_rng(0).uniform(low, high, (400, 3))
    below = depth(points)
    true = (below > levels[0]) & (below < levels[1])
    if not true.any():
        return
    part = part_of(folder, ONE + BAR + shell + window(low, high, "s"))
    clear = np.min([abs(below - level) for level in levels], axis=0) > 1e-6
    assert np.array_equal((part.body.distance_at(points) > 0)[clear], true[clear])


GRADED_PIECES = (
    BAR.replace("high_mm = [16, 24, 18]\n", 'high_mm = [16, 24, 18]\ncomposition.profile = '
                '{ kind = "constant", of = { "316L" = 1 } }\n')
    .replace("high_mm = [30, 24, 18]\n", 'high_mm = [30, 24, 18]\ncomposition.profile = '
             '{ kind = "constant", of = { "WC-12Co" = 1 } }\n')
)


@pytest.mark.parametrize("bodies", [BAR + BY_DEPTH, GRADED_PIECES])
@pytest.mark.parametrize("by", [(5, 0, 0), (40, 40, 0), (200, 0, 0), (0, 0, -60)])
def test_a_body_that_was_moved_takes_its_materials_along(
    folder: Folder, bodies: str, by: tuple[float, ...]
) -> None:
    points = np.random.default_rng(1).uniform(0, SIZE, (200, 3))
    whole = part_of(folder, TWO + bodies)
    moved = part_of(
        folder, TWO + bodies + f'[[body]]\nkind = "moved"\nof = "u"\nby_mm = {list(by)}\n')
    found = moved.composition(points + np.array(by))
    assert found == pytest.approx(whole.composition(points), abs=1e-6)


def test_a_body_without_end_is_measured_to_beyond_the_part(folder: Folder) -> None:
    """A roof of two half-spaces, its ridge at x = 0, z = 40; the part is a cube far below it."""
    roof = "".join(
        f'[[body]]\nname = "{name}"\nkind = "half-space"\npoint_mm = [0, 0, 40]\n'
        f"outward = [{x}, 0, 1]\n" for name, x in (("l", -1), ("r", 1))
    ) + '[[body]]\nname = "roof"\nkind = "intersection"\nof = ["l", "r"]\n'
    rule = BY_DEPTH.replace("[0, 10]", "[0, 40]")
    low, high = np.array([-4.0, -4, 0]), np.array([4.0, 4, 8])
    part = part_of(folder, TWO + roof + rule + window(low, high, "roof"))
    points = np.random.default_rng(0).uniform(low, high, (200, 3))
    true = (40 - points[:, 2] - np.abs(points[:, 0])) / np.sqrt(2)
    assert part.composition(points)[:, 1] == pytest.approx(true / 40, abs=1e-6)
