"""Compositions as functions of free numbers; those that would change the solid are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lmctl.design.free_design import FreeDesign
from lmctl.errors import ConfigError

HEAD = """name = "p"
[[material]]
name = "316L"
[[material]]
name = "WC-12Co"
[[body]]
name = "ball"
kind = "sphere"
centre_mm = [0, 0, 0]
radius_mm = 10
"""
SKIN = """[[body]]
name = "skin"
kind = "shell"
of = "ball"
to_mm = { free = [1, 4], start = 2, name = "h" }
composition.profile = { kind = "constant", of = { "WC-12Co" = 1 } }
"""
CORE = """[[body]]
name = "core"
kind = "shell"
of = "ball"
from_mm = { same_as = "h" }
composition.profile = { kind = "constant", of = { "316L" = 1 } }
[[body]]
kind = "union"
of = ["skin", "core"]
"""
BLEND = """[composition]
[[composition.blend]]
weight = { free = [0, 1], start = 0.25, name = "w" }
feature = { kind = "coordinate", along = "x" }
profile = { kind = "constant", of = { "316L" = 1 } }
[[composition.blend]]
weight = { rest = true }
feature = { kind = "coordinate", along = "x" }
profile = { kind = "constant", of = { "WC-12Co" = 1 } }
"""
SURFACE = np.array([[10.0, 0, 0], [0, 10, 0], [0, 0, -10]])


def test_the_thickness_of_a_shell_within_a_solid_is_free() -> None:
    design = FreeDesign(HEAD + SKIN + CORE, "p", Path())
    design.refuse_other_shapes(np.array([[0.0, 0, 0], [7.5, 0, 0], [9.5, 0, 0]]), SURFACE)
    places = np.array([[7.0, 0, 0]])  # 3 mm deep
    shares = [design.fractions(np.array([x]), places)[0, 1] for x in (0.0, 1.0)]
    np.testing.assert_allclose(shares, [0, 1])
    assert design.values(np.array([0.5])) == {"h": 2.5}


def test_a_number_that_changes_the_solid_is_refused() -> None:
    design = FreeDesign(HEAD + SKIN, "p", Path())
    with pytest.raises(ConfigError, match="h changes the shape of the part"):
        design.refuse_other_shapes(np.array([[8.5, 0, 0]]), SURFACE)


def test_weights_of_a_blend_are_free() -> None:
    design = FreeDesign(HEAD + BLEND, "p", Path())
    places = np.zeros((2, 3))
    np.testing.assert_allclose(design.fractions(np.array([0.4]), places), [[0.4, 0.6]] * 2)
    np.testing.assert_allclose(design.slope(np.array([0.4]), places, 0), [[1, -1]] * 2, atol=1e-9)
