"""Chosen numbers go into the text of a part file; nothing else of it changes."""

from __future__ import annotations

import pytest

from lmctl.config.free_numbers_text import text_with_values
from lmctl.config.toml_file import parse_tables
from lmctl.errors import ConfigError

TEXT = """# a block {free = [1, 2]} in a comment
name = "p { rest = true }"
[composition.profile]            # graded
kind = "power"
k = { free = [0.2, 5], start = 1, name = "k" }   # exponent of (4)
over_mm = [{ free = [0, 4], start = 1, name = "h1" }, { sum_of = ["h1", "k"] }]
near = { "316L" = { free = [0, 1], start = 0.5 }, "WC-12Co" = { rest = true } }
far = { "316L" = 1 }
"""
VALUES = {"k": 2.25, "h1": 3.0, "composition.profile.near.316L": 0.125}


def test_numbers_stand_where_markers_stood() -> None:
    found = text_with_values(TEXT, "p.toml", VALUES)
    assert found == """# a block {free = [1, 2]} in a comment
name = "p { rest = true }"
[composition.profile]            # graded
kind = "power"
k = 2.25   # exponent of (4)
over_mm = [3.0, 5.25]
near = { "316L" = 0.125, "WC-12Co" = 0.875 }
far = { "316L" = 1 }
"""


def test_free_levels_become_points() -> None:
    text = ('[composition.profile]\npoints = { free_levels = 2, over_mm = [0, 1], '
            'near = { "316L" = 1 }, far = { B = 1 } }\n')
    values = {f"composition.profile.points level {n}": n / 4 for n in (1, 2)}
    points = parse_tables(text_with_values(text, "p", values), name="p")["composition"]["profile"]
    assert points["points"] == [{"at_mm": 0.0, "of": {"316L": 0.75, "B": 0.25}},
                                {"at_mm": 1.0, "of": {"316L": 0.5, "B": 0.5}}]


def test_a_marker_that_is_no_inline_table_is_refused() -> None:
    text = "[composition.profile.k]\nfree = [0, 1]\nstart = 0.5\n"
    with pytest.raises(ConfigError, match="cannot be written"):
        text_with_values(text, "p", {"composition.profile.k": 0.25})
