"""An allowance around one body: in every layer, and nowhere else."""

from pathlib import Path

import numpy as np
import pytest

from lmctl.field.outline_offset import offset_loops
from lmctl.field.plane import loop_area_mm2
from lmctl.part.load import load_part

SQUARE = np.array([[0, 0], [10, 0], [10, 10], [0, 10], [0, 0.0]])
HOLE = np.array([[3, 3], [3, 7], [7, 7], [7, 3], [3, 3.0]])


def area(loops) -> float:
    return sum(loop_area_mm2(loop) for loop in loops)


@pytest.mark.parametrize(("by_mm", "wanted"), [
    (0.0, 84), (1.0, 100 + 40 + np.pi - 4), (-1.0, 64 - 16 - 16 - np.pi), (-2.2, 0)])
def test_an_outline_is_moved_by_distance(by_mm, wanted):
    loops = offset_loops([SQUARE, HOLE], by_mm)
    assert area(loops) == pytest.approx(wanted, abs=0.01)
    assert all(np.array_equal(loop[0], loop[-1]) for loop in loops)


def part(folder: Path, bodies: str):
    path = folder / "part.toml"
    path.write_text('name = "p"\n[[material]]\nname = "316L"\n' + bodies, encoding="utf-8")
    return load_part(path)


BOX = ('[[body]]\nkind = "box"\nname = "block"\nlow_mm = [0, 0, 0]\nhigh_mm = [20, 20, 8]\n')
BORE = ('[[body]]\nkind = "cylinder"\nname = "bore"\nbase_mm = [10, 10, -1]\n'
        'top_mm = [10, 10, 9]\nradius_mm = 4\n')


def test_a_body_alone(tmp_path):
    loops = part(tmp_path, BOX + "allowance_mm = 0.5\n").section(4.0).loops
    assert area(loops) == pytest.approx(400 + 40 + np.pi / 4, abs=0.01)


def test_a_bore_keeps_material_on_its_wall(tmp_path):
    text = 'combine = "difference"\n'
    path = tmp_path / "part.toml"
    path.write_text('name = "p"\n' + text + '[[material]]\nname = "316L"\n' + BOX + BORE
                    + "allowance_mm = -0.5\n", encoding="utf-8")
    found = load_part(path)
    assert area(found.section(4.0).loops) == pytest.approx(400 - np.pi * 3.5**2, rel=0.002)
    points = np.array([[16.0, 10.0, 4.0]])  # depths stay those of the drawing
    assert found.body.distance_at(points) == pytest.approx([2.0], abs=0.05)


def test_a_moved_copy_has_the_allowance_too(tmp_path):
    loops = part(tmp_path, BOX + "allowance_mm = 0.5\n"
                 + '[[body]]\nkind = "moved"\nof = "block"\nby_mm = [3, 0, 0]\n'
                 ).section(4.0).loops
    assert area(loops) == pytest.approx(400 + 40 + np.pi / 4, abs=0.01)
    assert np.vstack(loops)[:, 0].min() == pytest.approx(2.5, abs=0.01)


def test_the_bounds_hold_the_allowance_of_the_body_that_a_shell_is_of(tmp_path):
    """So that a part is placed and checked against the machine as it is deposited."""
    low, high = part(tmp_path, BOX.replace("8]", "20]") + "allowance_mm = 0.5\n"
                     + '[[body]]\nkind = "shell"\nof = "block"\nfrom_mm = 0\nto_mm = 3\n'
                     ).bounds_mm
    assert low == pytest.approx([-0.5, -0.5, 0])
    assert high == pytest.approx([20.5, 20.5, 20])
