"""Outlines cut from triangles, against what geometry says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmctl.field.plane import loop_area_mm2
from lmctl.part.sources import slicing
from lmctl.part.sources.slicing import MeshSlicer


def area(loops: list[Any]) -> float:
    return sum(loop_area_mm2(loop) for loop in loops)


def test_a_box_has_its_corners_exactly(making: Any) -> None:
    slicer = MeshSlicer(*making.box((1, 2, 3), (11, 22, 33)))
    (loop,) = slicer.loops(10.0)
    assert loop_area_mm2(loop) == pytest.approx(200, abs=1e-12)
    for corner in [(1, 2), (11, 2), (11, 22), (1, 22)]:
        assert np.abs(loop - corner).sum(axis=1).min() < 1e-12
    assert np.array_equal(loop[0], loop[-1])


def test_planes_through_corners_are_half_open(making: Any) -> None:
    slicer = MeshSlicer(*making.box((0, 0, 0), (10, 10, 5)))
    assert area(slicer.loops(0.0)) == pytest.approx(100)
    assert slicer.loops(5.0) == []
    assert slicer.loops(-1e-9) == []
    steps = MeshSlicer(*making.join([making.box((0, 0, 0), (10, 10, 5)),
                                     making.box((20, 0, 5), (30, 10, 9))]))
    assert area(steps.loops(5.0)) == pytest.approx(100)


@settings(max_examples=40, deadline=None)
@given(st.floats(-9.99, 9.99), st.integers(3, 20))
def test_a_ball_at_any_height(making: Any, z: float, rows: int) -> None:
    vertices, triangles = making.ball(10.0, 2 * rows, 64)
    loops = MeshSlicer(vertices, triangles).loops(z)
    assert len(loops) == 1
    # the polyhedron lies in the ball of its corners and around a slightly smaller one
    smaller = 10 * np.cos(np.pi / (2 * rows)) * np.cos(np.pi / 64)
    inner = np.pi * max(0.0, smaller**2 - z * z)
    assert inner <= loop_area_mm2(loops[0]) <= np.pi * (100 - z * z) + 1e-9


def test_holes_run_clockwise_and_islands_in_holes_do_not(making: Any) -> None:
    def shell(half: float) -> Any:
        return making.box((-half, -half, 0), (half, half, 10))

    nested = making.join([shell(20), shell(15), shell(10), shell(5)])
    rng = np.random.default_rng(1)
    turned = nested[1].copy()
    flip = rng.random(len(turned)) < 0.5  # parity does not ask which way triangles face
    turned[flip] = turned[flip][:, ::-1]
    for triangles in (nested[1], turned):
        areas = sorted(loop_area_mm2(p) for p in MeshSlicer(nested[0], triangles).loops(5.0))
        assert areas == pytest.approx([-900, -100, 400, 1600])


boxes = st.tuples(*[st.integers(0, 12)] * 2, *[st.integers(1, 12)] * 2)


@settings(max_examples=60, deadline=None)
@given(st.lists(boxes, min_size=1, max_size=6))
def test_loops_turn_by_parity_however_they_lie(
    making: Any, of: list[tuple[int, int, int, int]]
) -> None:
    """Nested, side by side, crossing, with walls in line: the area left of all is the parity's."""
    at = [(x + 0.01 * n, y + 0.013 * n, w, h) for n, (x, y, w, h) in enumerate(of)]
    mesh = making.join([making.box((x, y, 0), (x + w, y + h, 1)) for x, y, w, h in at])
    loops = MeshSlicer(*mesh).loops(0.5)
    for loop in loops:
        x, y = loop[0]
        within = [a < x < a + w and b < y < b + h for a, b, w, h in at]
        assert (loop_area_mm2(loop) > 0) == (sum(within) % 2 == 0)


def test_islands_are_not_compared_with_each_other(
    making: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    pins = making.join([making.box((3 * x, 3 * y, 0), (3 * x + 2, 3 * y + 2, 1))
                        for x in range(12) for y in range(12)])
    asked = []
    monkeypatch.setattr(slicing, "count_ray_crossings", lambda *what: asked.append(what) or 0)
    loops = MeshSlicer(*pins).loops(0.5)
    assert len(loops) == 144
    assert all(loop_area_mm2(loop) == pytest.approx(4) for loop in loops)
    assert not asked


def test_a_grate_has_all_its_holes(making: Any) -> None:
    loops = MeshSlicer(*making.grate(6, 4.0, 5.0)).loops(2.0)
    assert len(loops) == 37
    assert area(loops) == pytest.approx((13 * 13 - 36) * 16)


def test_above_and_below_there_is_nothing(making: Any) -> None:
    slicer = MeshSlicer(*making.ball(10.0, 12, 24))
    assert slicer.loops(10.5) == []
    assert slicer.loops(-10.5) == []
