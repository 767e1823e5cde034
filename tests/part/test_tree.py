"""Bodies of every kind through part files: where they are, how deep, and what is refused."""

from __future__ import annotations

import importlib.util
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lmctl.errors import InputError, UsageError
from lmctl.field.plane import loop_area_mm2
from lmctl.part.load import load_part
from lmctl.part.part import Part

Folder = Callable[..., Path]
STEEL = 'name = "p"\n[[material]]\nname = "316L"\n'
BALL = '[[body]]\nname = "ball"\nkind = "sphere"\ncentre_mm = [0, 0, 0]\nradius_mm = 5\n'


def part_of(folder: Folder, text: str, **files: Any) -> Part:
    return load_part(folder(part__toml=text, **files) / "part.toml")


def depths(part: Part, *places: tuple[float, float, float]) -> list[float]:
    return [float(v) for v in part.body.distance_at(np.array(places, dtype=float))]


@pytest.mark.parametrize(
    ("body", "places", "expected", "area"),
    [
        ('kind = "cone"\nbase_mm = [0, 0, 0]\ntop_mm = [0, 0, 8]\nbase_radius_mm = 6\n'
         "top_radius_mm = 0", [(0, 0, 0.5), (9, 0, 0)], [0.5, -3], np.pi * 9),
        ('kind = "torus"\ncentre_mm = [0, 0, 4]\nradius_mm = 10\ntube_radius_mm = 3',
         [(10, 0, 4), (0, 0, 4), (14, 0, 4)], [3, -7, -1], np.pi * (169 - 49)),
        ('kind = "prism"\noutline_mm = [[0, 0], [0, 10], [10, 10], [10, 0]]\nlow_mm = 0\n'
         "high_mm = 8", [(5, 5, 4), (13, 14, 4), (13, 5, 12)], [4, -5, -5], 100),
    ],
)
def test_formulas(
    folder: Folder, body: str, places: list[tuple[float, float, float]], expected: list[float],
    area: float,
) -> None:
    part = part_of(folder, f"{STEEL}[[body]]\n{body}\n")
    assert depths(part, *places) == pytest.approx(expected)
    found = sum(loop_area_mm2(loop) for loop in part.section(4.0).loops)
    assert found == pytest.approx(area, rel=3e-3)


def test_a_moved_body_is_scaled_then_turned_then_moved(folder: Folder) -> None:
    box = '[[body]]\nname = "b"\nkind = "box"\nlow_mm = [0, 0, 0]\nhigh_mm = [4, 2, 1]\n'
    part = part_of(folder, STEEL + box + '[[body]]\nkind = "moved"\nof = "b"\nscale = 2\n'
                   "turn = { axis = [0, 0, 1], degrees = 90 }\nby_mm = [10, 0, 3]\n")
    assert part.bounds_mm[0] == pytest.approx([6, 0, 3])
    assert part.bounds_mm[1] == pytest.approx([10, 8, 5])
    assert depths(part, (8, 4, 4), (13, 12, 4)) == pytest.approx([1, -5])
    (loop,) = part.section(4.0).loops
    assert loop_area_mm2(loop) == pytest.approx(32)


def test_a_moved_mesh_keeps_its_exact_outlines(folder: Folder, making: Any) -> None:
    mesh = '[[body]]\nname = "m"\nkind = "mesh"\nfile = "m.stl"\nunits = "mm"\n'
    part = part_of(folder, STEEL + mesh + '[[body]]\nkind = "moved"\nof = "m"\n'
                   "turn = { axis = [1, 0, 0], degrees = 90 }\n",
                   m__stl=making.stl(making.box((0, 0, 0), (6, 4, 10))))
    (loop,) = part.section(2.0).loops
    assert loop_area_mm2(loop) == pytest.approx(60)
    assert part.bounds_mm[0] == pytest.approx([0, -10, 0], abs=1e-6)


def test_a_shell_is_between_its_iso_contours(folder: Folder) -> None:
    part = part_of(folder, STEEL + BALL + '[[body]]\nkind = "shell"\nof = "ball"\nfrom_mm = 1\n'
                   "to_mm = 3\n")
    assert depths(part, (3, 0, 0), (2.5, 0, 0), (0, 0, 0), (0, 4.5, 0), (0, 0, 9)) == (
        pytest.approx([1, 0.5, -2, -0.5, -5], abs=0.02))
    assert part.bounds_mm[1] == pytest.approx([4, 4, 4], abs=0.02)
    outside = part_of(folder, STEEL + BALL + '[[body]]\nkind = "shell"\nof = "ball"\n'
                      "from_mm = -2\nto_mm = 0\n")
    assert depths(outside, (6, 0, 0), (0, 0, 0), (0, 9, 0)) == pytest.approx([1, -5, -2], abs=0.02)


def test_the_shell_of_a_box_has_true_corners(folder: Folder) -> None:
    """Outside of an inner contour its corners count: √2 and √3 of what the depths differ by."""
    box = '[[body]]\nname = "b"\nkind = "box"\nlow_mm = [0, 0, 0]\nhigh_mm = [12, 12, 12]\n'
    part = part_of(folder, STEEL + box + '[[body]]\nkind = "shell"\nof = "b"\nfrom_mm = 3\n')
    assert depths(part, (6, 6, 1), (1, 1, 6), (1, 1, 1), (6, 6, 6)) == pytest.approx(
        [-2, -2 * 2**0.5, -2 * 3**0.5, 3], abs=1e-6)


def test_the_shell_of_a_notched_box_is_round_about_the_notch(folder: Folder) -> None:
    """Its contour keeps away from the notch's edge by a round; its own corners are sharp."""
    boxes = "".join(
        f'[[body]]\nname = "{name}"\nkind = "box"\nlow_mm = {low}\nhigh_mm = {high}\n'
        for name, low, high in (("b", [0, 0, 0], [12, 12, 12]), ("c", [6, 6, -1], [13, 13, 13])))
    part = part_of(folder, STEEL + boxes + '[[body]]\nname = "notched"\nkind = "difference"\n'
                   'of = ["b", "c"]\n[[body]]\nkind = "shell"\nof = "notched"\nfrom_mm = 2\n')
    place = 6 - 2.5 * 0.5**0.5
    assert depths(part, (place, place, 6), (5, 5, 6), (1, 1, 6), (11, 5, 6), (3, 3, 3)) == (
        pytest.approx([0.5, 2**0.5 - 2, -(2**0.5), -(2**0.5), 1], abs=1e-6))


def test_a_moved_boolean_is_a_boolean_of_moved_bodies(folder: Folder) -> None:
    """Its leaves are carried, so that others see it as their own kind: what is cut off comes back
    whole, wherever it is."""
    text = STEEL + BALL + (
        '[[body]]\nname = "box"\nkind = "box"\nlow_mm = [0, -6, -6]\nhigh_mm = [6, 6, 6]\n'
        '[[body]]\nname = "cut"\nkind = "difference"\nof = ["ball", "box"]\n'
        '[[body]]\nname = "rest"\nkind = "intersection"\nof = ["ball", "box"]\n')
    turn = 'turn = { axis = [1, 2, 3], degrees = 40 }\nby_mm = [3, 0, 1]\n'
    text += "".join(f'[[body]]\nname = "{name} moved"\nkind = "moved"\nof = "{name}"\n{turn}'
                    for name in ("cut", "rest"))
    part = part_of(folder, text + '[[body]]\nkind = "union"\nof = ["cut moved", "rest moved"]\n')
    points = np.random.default_rng(3).uniform(-5, 9, (500, 3))
    expected = 5 - np.linalg.norm(points - [3, 0, 1], axis=1)
    assert np.abs(part.body.distance_at(points) - expected).max() < 0.01


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (STEEL + '[[body]]\nkind = "half-space"\npoint_mm = [0, 0, 0]\noutward = [0, 0, 1]\n',
         "no end"),
        (STEEL + '[[body]]\nkind = "prism"\noutline_mm = [[0, 0], [9, 9], [9, 0], [0, 9]]\n'
         "low_mm = 0\nhigh_mm = 5\n", "crosses itself"),
        (STEEL + '[[body]]\nkind = "prism"\noutline_mm = [[0, 0], [9, 9], [5, 5]]\nlow_mm = 0\n'
         "high_mm = 5\n", "outline of body"),
        (STEEL + BALL + '[[body]]\nkind = "shell"\nof = "ball"\nfrom_mm = 6\n', "lies deeper than"),
        (STEEL + BALL + '[[body]]\nkind = "difference"\nof = ["ball", "ball"]\n', "leaves nothing"),
    ],
)
def test_what_cannot_be_made(folder: Folder, text: str, what: str) -> None:
    with pytest.raises(InputError, match=what) as caught:
        part_of(folder, text)
    assert caught.value.hint


def test_a_feature_far_from_the_part_is_doubted(folder: Folder) -> None:
    part = part_of(
        folder, STEEL + '[[material]]\nname = "WC-12Co"\n' + BALL + '[composition]\nfeature = '
        '{ kind = "point", at_mm = [0, 0, 500] }\nprofile = { kind = "linear", '
        'near = {"316L" = 1}, far = {"WC-12Co" = 1}, over_mm = [0, 10] }\n')
    assert any("does not change in the part" in text for text in part.warnings)


def test_memory_is_limited_by_the_user(
    folder: Folder, making: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = '[[body]]\nkind = "mesh"\nfile = "m.stl"\nunits = "mm"\n'
    ball = making.ball(30.0, 24, 48)
    files = {"m__stl": making.stl(ball),
             "m__xyz": "\n".join("{} {} {}".format(*corner) for corner in ball[0].tolist())}
    text = "pitch_mm = 0.3\n" + STEEL + mesh
    path = folder(part__toml=text, **files) / "part.toml"
    monkeypatch.setenv("LMCTL_MEMORY_MB", "100")
    assert load_part(path).grid.n_nodes > 8_000_000  # of a mesh nothing is stored
    path.write_text(text.replace("mesh", "cloud").replace("stl", "xyz"))
    with pytest.raises(InputError, match=r"needs 9e\+06 grid nodes, 18. MB") as caught:
        load_part(path)
    assert "LMCTL_MEMORY_MB" in caught.value.hint
    monkeypatch.setenv("LMCTL_MEMORY_MB", "lots")
    with pytest.raises(UsageError, match="no amount of memory"):
        load_part(path)


def test_a_tree_of_twelve_is_walked_in_bounded_memory(tmp_path: Path) -> None:
    """tests/benchmarks/tree_memory.py over 1000³; here over 25³."""
    place = Path(__file__).parent.parent / "benchmarks" / "tree_memory.py"
    spec = importlib.util.spec_from_file_location("tree_memory", place)
    assert spec is not None
    assert spec.loader is not None
    benchmark = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(benchmark)
    text = benchmark.part_text().replace("pitch_mm = 0.1", "pitch_mm = 4")
    (tmp_path / "t.toml").write_text(text)
    part = load_part(tmp_path / "t.toml")
    tracemalloc.start()
    deepest = max(float(part.distance(window).max()) for window in part.grid.slabs(8))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 15 < deepest < 35
    assert peak < 60e6
