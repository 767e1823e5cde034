"""Strategies of their own for bodies and for ranges of layers."""

import numpy as np
import pytest

from lmctl.config.part_rules import parse_part_file
from lmctl.errors import ConfigError
from lmctl.part.load import load_part
from lmctl.plan.geometry import layer_geometry
from lmctl.preflight.placement import place_part

PART = """
name = "plate with a core"
[[material]]
name = "316L"
[[body]]
name = "plate"
kind = "box"
low_mm = [0, 0, 0]
high_mm = [36, 24, 3.2]
[[body]]
name = "core"
kind = "box"
low_mm = [9, 6, -1]
high_mm = [27, 18, 9]
[[body]]
name = "all of it"
kind = "intersection"
of = ["plate", "around"]
[[body]]
name = "around"
kind = "union"
of = ["plate", "core"]
[process]
outline_tracks = 0
hatch_angle_deg = 0
hatch_turn_deg = 0
"""


@pytest.fixture
def geometry_of(tmp_path, profile):
    def make(regions, layer=0):
        file = tmp_path / "plate.toml"
        file.write_text(PART + regions)
        part = load_part(file)
        return layer_geometry(part, place_part(part, profile), layer)
    return make


def straight_along_x(geometry):
    """Whether each track is a line along x, and the middle of each, (m, 2)."""
    tracks = [geometry.points_mm[geometry.track(k)] for k in range(geometry.n_tracks)]
    return (np.array([np.ptp(t[:, 1]) < 1e-6 for t in tracks]),
            np.array([t.mean(axis=0) for t in tracks]))


def test_a_body_has_its_own_strategy(geometry_of):
    geometry = geometry_of(
        'hatch = "one-way"\n[[process.region]]\nbody = "core"\nstrategy = "hatch"\n')
    lines, middle = straight_along_x(geometry)
    inside = (np.abs(middle - [18, 12]) < [9, 6]).all(axis=1)
    assert lines.sum() >= 8
    assert inside[lines].all()
    assert geometry.figures.inside_mm2 / geometry.figures.slice_mm2 > 0.98
    assert geometry.figures.double_mm2 / geometry.figures.slice_mm2 < 0.02


def test_a_range_of_layers_has_its_own_strategy(geometry_of):
    regions = ('hatch = "one-way"\n'
               '[[process.region]]\nlayers = [2, 3]\nstrategy = "hatch"\n')
    found = [straight_along_x(geometry_of(regions, layer))[0].all() for layer in range(4)]
    assert found == [False, True, True, False]


def test_of_two_that_hold_the_last_one_counts(geometry_of):
    geometry = geometry_of(
        'hatch = "one-way"\nstrategy = "hatch"\n'
        '[[process.region]]\nbody = "core"\nstrategy = "hatch"\n'
        '[[process.region]]\nlayers = [1, 9]\nstrategy = "offset"\n')
    assert not straight_along_x(geometry)[0].any()


def test_mistakes_are_named_all_at_once():
    with pytest.raises(ConfigError) as said:
        parse_part_file(PART + (
            'strategy = "iso-3d"\n'
            '[[process.region]]\nbody = "corr"\nstrategy = "hatch"\n'
            '[[process.region]]\nstrategy = "offset"\n'
            '[[process.region]]\nlayers = [5, 2]\nstrategy = "offset"\n'), name="plate.toml")
    text = said.value.render()
    assert "no body is named 'corr'" in text
    assert "core" in text
    assert "iso-3d" in text
    assert "neither body nor layers" in text
    assert "from the lower number" in text
