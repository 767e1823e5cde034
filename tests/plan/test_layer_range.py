"""A layer that is said to be wide without looking at its tracks has tracks."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lmctl.config.part_file import ProcessSettings
from lmctl.plan.layer_range import _is_wide


def loop(*corners):
    return np.array([*corners, corners[0]], dtype=float)


def rectangle(x, y, width, height, *, hole=False):
    corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
    return loop(*(corners[::-1] if hole else corners))


def is_wide(*loops, **process):
    values = {"bead_width_mm": 2.0, "layer_height_mm": 0.8, **process}
    return _is_wide(SimpleNamespace(loops=list(loops)), ProcessSettings(**values))


@pytest.mark.parametrize(("loops", "wide"), [
    ([rectangle(0, 0, 30, 20)], True),
    ([rectangle(-5, 100, 9, 9)], True),
    ([rectangle(0, 0, 30, 7.9)], False),
    ([rectangle(0, 0, 0.1, 100)], False),
    ([rectangle(0, 0, 30, 20), rectangle(3, 3, 24, 14, hole=True)], False),
    ([rectangle(0, 0, 30, 20), rectangle(12, 9, 1, 1, hole=True)], True),
    ([rectangle(0, 0, 3, 3), rectangle(50, 50, 3, 3)], False),
    ([], False),
])
def test_only_where_a_circle_of_two_beads_fits(loops, wide):
    assert is_wide(*loops) is wide
    assert not is_wide(*loops, strategy="iso-3d")


def test_an_outline_that_is_moved_inwards_needs_the_room_for_it():
    assert is_wide(rectangle(0, 0, 10, 10), allowance_mm=0.0)
    assert not is_wide(rectangle(0, 0, 10, 10), allowance_mm=-1.5)


def test_many_edges_are_left_to_the_tracks():
    angles = np.linspace(0.0, 2 * np.pi, 3000, endpoint=False)
    assert not is_wide(loop(*np.column_stack([20 * np.cos(angles), 20 * np.sin(angles)])))
    assert is_wide(loop(*np.column_stack([20 * np.cos(angles), 20 * np.sin(angles)])[::5]))
