"""Loads, supports, limits and free numbers of a part file: every mistake is named, at once."""

from __future__ import annotations

import pytest

from lmctl.config.free_numbers import resolve_free_numbers
from lmctl.config.part_file import PartFile
from lmctl.config.part_rules import parse_part_file
from lmctl.config.toml_file import parse_tables
from lmctl.errors import ConfigError

HEAD = """name = "p"
[[material]]
name = "316L"
[[material]]
name = "WC-12Co"
[[body]]
name = "block"
kind = "box"
low_mm = [0, 0, 0]
high_mm = [10, 10, 10]
"""
GRADED = """[composition]
feature = { kind = "coordinate", along = "x" }
[composition.profile]
kind = "power"
k = { free = [0.2, 5], start = 1, name = "k" }
near = { "316L" = 1 }
far = { "WC-12Co" = 1 }
over_mm = [0, 10]
"""


def mistakes(text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        parse_part_file(text, name="p.toml")
    return caught.value.render()


def profile_of(part: PartFile) -> object:
    assert part.composition is not None
    return part.composition.profile


def test_a_part_with_free_numbers_is_read_with_their_starting_values() -> None:
    part = parse_part_file(HEAD + GRADED, name="p")
    assert profile_of(part).k == 1  # type: ignore[attr-defined]
    other = parse_part_file(HEAD + GRADED, name="p", values={"k": 2.5})
    assert profile_of(other).k == 2.5  # type: ignore[attr-defined]


def test_numbers_may_share_a_value_add_up_and_leave_the_rest() -> None:
    text = """[composition]
over_mm = [{ free = [1, 3], start = 2, name = "h1" }, { sum_of = ["h1", "h2"] }]
second = { same_as = "h1" }
h2 = { free = [1, 4], start = 1.5, name = "h2" }
of = { "316L" = { free = [0, 1], start = 0.3 }, "WC-12Co" = { rest = true } }
[[composition.blend]]
weight = { free = [0, 1], start = 0.25 }
[[composition.blend]]
weight = { rest = true }
"""
    found = resolve_free_numbers(parse_tables(text, name="t"), {"h2": 4.0})
    assert not found.findings
    of = found.data["composition"]
    assert of["over_mm"] == [2.0, 6.0]
    assert of["second"] == 2.0
    assert of["of"] == {"316L": 0.3, "WC-12Co": 0.7}
    assert [part["weight"] for part in of["blend"]] == [0.25, 0.75]


def test_free_levels_are_points_between_two_mixtures() -> None:
    text = HEAD + """[composition]
feature = { kind = "coordinate", along = "x" }
[composition.profile]
kind = "table"
points = { free_levels = 3, over_mm = [0, 10], near = { "316L" = 1 }, far = { "WC-12Co" = 1 } }
"""
    points = profile_of(parse_part_file(text, name="p")).points  # type: ignore[attr-defined]
    assert [point.at_mm for point in points] == [0, 5, 10]
    assert points[1].of == {"316L": 0.5, "WC-12Co": 0.5}
    numbers = resolve_free_numbers(parse_tables(text, name="t")).free
    assert [(n.low, n.high, n.start) for n in numbers] == [(0, 1, 0), (0, 1, 0.5), (0, 1, 1)]


@pytest.mark.parametrize(("marker", "told"), [
    ("{ free = 3, start = 1 }", "needs bounds"),
    ("{ free = [0.2], start = 1 }", "needs bounds"),
    ("{ free = [5, 0.2], start = 1 }", "the bounds contradict"),
    ("{ free = [0.2, 5] }", "needs a start"),
    ("{ free = [0.2, 5], start = 9 }", "start must lie between"),
    ("{ free = [0.2, 5], start = 1, step = 2 }", "k.step: there is no such key"),
    ("{ free = [0.2, 5], start = 1, nme = 'k' }", "did you mean 'name'?"),
    ('{ same_as = "m" }', "there is no free number 'm'"),
])
def test_free_values_without_sound_bounds_are_refused(marker: str, told: str) -> None:
    text = HEAD + GRADED.replace('{ free = [0.2, 5], start = 1, name = "k" }', marker)
    assert told in mistakes(text)


def test_the_shape_of_a_part_is_not_free() -> None:
    text = HEAD.replace("[10, 10, 10]", "[10, 10, { free = [5, 20], start = 10 }]") + GRADED
    assert "cannot be free" in mistakes(text)


def test_a_face_that_is_nowhere_lists_those_there_are() -> None:
    text = HEAD + GRADED + """
[[face]]
name = "foot"
feature = { kind = "plane", point_mm = [0, 0, 0], normal = [0, 0, 1] }
[[load]]
on = "fot"
pressure_MPa = 1
[[support]]
on = "attic"
fix = ["x"]
"""
    told = mistakes(text)
    assert "load[1].on: there is no face 'fot': did you mean 'foot'?" in told
    assert "support[1].on: there is no face 'attic'" in told
    assert "foot, block, surface" in told


def test_impossible_properties_loads_and_limits_are_all_named_at_once() -> None:
    text = HEAD.replace('name = "316L"', 'name = "316L"\nelastic_modulus_GPa = -3\n'
                        "poisson_ratio = 0.5") + GRADED + """
[[load]]
on = "surface"
[[support]]
on = "surface"
fix = ["r"]
[[heat]]
on = "surface"
film_W_mm2_K = 1
[simulation]
section_mm = 3
matrix = "316"
[optimise]
limit = [{ quantity = "mass", at_most = 3 }, { quantity = "mass", at_least = 4 },
         { quantity = "fraction", at_most = 0.5 }]
"""
    told = mistakes(text)
    for line in ("material[1].elastic_modulus_GPa: must be above 0",
                 "material[1].poisson_ratio: must be below 0.5",
                 "give one of pressure_MPa", "a solid model has no r", "ambient_C go together",
                 "simulation.section_mm: is of plane models only", "did you mean '316L'?",
                 "limits contradict: mass at least 4 and at most 3", "give material"):
        assert line in told
