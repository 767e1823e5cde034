"""The paper's cases, as the templates state them.

Source: docs/explanation/multi-colour-distance-field.md, The paper's examples.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lmctl.array_types import FloatArray
from lmctl.examples.templates import TEMPLATES, write_template
from lmctl.field.plane import loop_area_mm2
from lmctl.part.load import load_part
from lmctl.part.part import Part


def template(name: str, folder: Path) -> Part:
    return load_part(write_template(name, folder)[0])


def carbide(part: Part, *points: tuple[float, float, float]) -> FloatArray:
    fractions = part.composition(np.array(points, dtype=float))
    assert np.abs(fractions.sum(axis=1) - 1).max() < 1e-6
    assert fractions.min() >= 0
    return fractions[:, 1]


@pytest.mark.parametrize("name", [name for name in TEMPLATES if name != "gear"])
def test_every_template_is_a_sound_part(name: str, tmp_path: Path) -> None:
    part = template(name, tmp_path)
    assert part.warnings == ()
    low, high = part.bounds_mm
    section = part.section(float(0.5 * (low + high)[2]))
    assert sum(loop_area_mm2(loop) for loop in section.loops) > 30
    random = np.random.default_rng(0).uniform(low, high, (400, 3))
    inside = random[part.body.distance_at(random) > 0]
    fractions = part.composition(inside)
    assert np.abs(fractions.sum(axis=1) - 1).max() < 1e-6
    assert fractions.min() >= 0


@pytest.mark.parametrize(
    ("name", "expected"),
    [("cutter", [1, 0.75, 0.5, 0.25, 0, 0]), ("cutter-parabolic", [1, 0.9375, 0.75, 0.4375, 0, 0])],
)
def test_the_boring_cutter_is_built_along_its_axis(
    name: str, expected: list[float], tmp_path: Path
) -> None:
    part = template(name, tmp_path)
    assert part.bounds_mm[1][2] - part.bounds_mm[0][2] == pytest.approx(82)
    steel = 1 - carbide(part, *[(2, -1, x) for x in (30, 46, 52, 58, 70, 79)])
    assert steel == pytest.approx(expected, abs=1e-9)
    # a slice across x: one round outline of one composition
    (loop,) = part.section(52.0).loops
    assert loop_area_mm2(loop) == pytest.approx(np.pi * 36, rel=2e-3)


def test_the_turbine_blade(tmp_path: Path) -> None:
    part = template("blade", tmp_path)
    walls = part.section(6.0)
    assert len(walls.loops) == 4  # the outline and three passages
    depths = np.array([(20, 13.4 - depth, 6) for depth in (0.5, 1.9, 3, 3.99, 4.3)], dtype=float)
    outer = next(loop for loop in walls.loops if loop_area_mm2(loop) > 0)
    start, along = outer[:-1], np.diff(outer, axis=0)
    below = []
    for x, y, _ in depths:
        t = np.clip((((x, y) - start) * along).sum(1) / (along**2).sum(1), 0, 1)
        below.append(np.linalg.norm((x, y) - start - t[:, None] * along, axis=1).min())
    f = np.clip((np.array(below) - 2) / 2, 0, 1) ** 1.5
    assert carbide(part, *map(tuple, depths)) == pytest.approx(0.8 * (1 - f), abs=0.02)
    in_passage = part.body.distance_at(np.array([[18.0, 6, 6], [18.0, 6, 0.5], [18.0, 8.5, 6]]))
    assert in_passage[:2] == pytest.approx([-1.5, -1.5], abs=0.6)
    assert in_passage[2] == pytest.approx(1.0, abs=0.01)


def test_blends_of_point_and_line(tmp_path: Path) -> None:
    place = (14.0, 10.0, 2.0)  # 6 mm from the point, 10 mm from the line
    near, far = 0.1 + 0.7 * 6 / 20, 0.1 + 0.7 * 10 / 20
    assert carbide(template("fig4-point", tmp_path), place) == pytest.approx([near])
    assert carbide(template("fig4-line", tmp_path), place) == pytest.approx([far])
    assert carbide(template("fig4-blend", tmp_path), place) == pytest.approx(
        [0.3 * near + 0.7 * far])
    assert carbide(template("fig4-blend-reversed", tmp_path), place) == pytest.approx(
        [0.7 * near + 0.3 * far])


def test_materials_of_a_union_pass_into_each_other(tmp_path: Path) -> None:
    """A is 0, B is 0.8 of carbide; on L1 (B's rim in A) the mixture is A's, on L2 it is B's."""
    part = template("fig8-union", tmp_path)
    axis = [(x, 0.0, 2.0) for x in (0, 4.001, 6, 8, 10, 11.999, 20)]
    assert carbide(part, *axis) == pytest.approx([0, 0, 0.2, 0.4, 0.6, 0.8, 0.8], abs=0.002)
    # across L1 and L2 away from the axis, and up to the lids that both share
    angles = np.deg2rad([-30, 10, 25])
    for z in (0.05, 2.0, 3.9):
        for radius, centre, turn, end in ((12, 0, 0, 0.8), (10, 14, np.pi, 0.0)):
            for step in (-0.005, 0.005):
                rim = [(centre + (radius + step) * np.cos(turn + a),
                        (radius + step) * np.sin(turn + a), z) for a in angles]
                assert carbide(part, *rim) == pytest.approx([end] * 3, abs=0.01)


def test_materials_of_the_other_booleans(tmp_path: Path) -> None:
    hole = template("fig7-hole", tmp_path)
    assert carbide(hole, (-8, 0, 2), (8, 0, 2)) == pytest.approx([0, 0])
    both = template("fig9-intersection", tmp_path)
    assert carbide(both, (5, 0, 2), (-1.9, 0, 2), (11.9, 0, 2)) == pytest.approx(
        [0.4, 0, 0.8], abs=0.01)
    within = template("fig6-contained", tmp_path)
    assert carbide(within, (-9, 0, 2), (9.001, 0, 2)) == pytest.approx([0, 0], abs=1e-3)
    assert within.body.distance_at(np.array([[0.0, 0, 2], [10, 0, 2]])) == pytest.approx([2, 2],
                                                                                         abs=1e-6)
