"""Straight lines and spirals: direction, order, what they fill, and where they give way."""

import numpy as np
import pytest

from lmctl.config.part_file import ProcessSettings
from lmctl.plan.geometry import layer_geometry
from lmctl.plan.sequence.track_order import order_tracks
from lmctl.preflight.placement import place_part
from tests.plan.conftest import circle, gear, rectangle

SLICES = {
    "square": [rectangle(24.0, 24.0)],
    "disc": [circle(13.0)],
    "annulus": [circle(15.0), circle(7.0, clockwise=True)],
    "gear": gear(),
    "dumbbell": [np.array([[0, 0], [14, 0], [14, 6], [24, 6], [24, 0], [38, 0], [38, 14], [24, 14],
                           [24, 8.5], [14, 8.5], [14, 14], [0, 14], [0, 0.0]])],
}


def even(points):
    return np.full(len(points), 0.3)


def made(make_part, profile, loops, layer=0, mixture=even, **process):
    part = make_part(loops, mixture, process=ProcessSettings(**process))
    return layer_geometry(part, place_part(part, profile), layer)


def directions(geometry, least_mm=3.0):
    """Angles of long straight pieces, in [0, 180)."""
    way = np.diff(geometry.points_mm, axis=0)
    way[geometry.starts[1:-1] - 1] = 0
    turn = np.degrees(np.arctan2(way[:, 1], way[:, 0])) % 180
    return turn, np.hypot(*way.T)


@pytest.mark.parametrize("name", SLICES)
@pytest.mark.parametrize("layer", [0, 1])
@pytest.mark.parametrize("process", [
    {"strategy": "hatch"}, {"strategy": "hatch", "hatch": "one-way", "outline_tracks": 0},
    {"strategy": "hatch", "hatch_blocks": "islands", "hatch_block_mm": 8},
    {"strategy": "hatch", "hatch_blocks": "stripes", "hatch_block_mm": 10}, {"strategy": "spiral"},
], ids=str)
def test_the_slice_is_filled_once(make_part, profile, name, layer, process):
    figures = made(make_part, profile, SLICES[name], layer, **process).figures
    assert figures.inside_mm2 / figures.slice_mm2 > 0.965
    assert figures.double_mm2 / figures.slice_mm2 < 0.04
    assert figures.outside_mm2 / figures.slice_mm2 < 0.03  # lines that no outline track ends
    assert figures.lost == ()


def test_lines_turn_from_layer_to_layer(make_part, profile):
    for layer, angle in ((0, 30.0), (1, 97.0), (2, 164.0)):
        geometry = made(make_part, profile, SLICES["square"], layer, strategy="hatch",
                        hatch_angle_deg=30.0, hatch_turn_deg=67.0, outline_tracks=0)
        turn, length = directions(geometry)
        along = np.abs((turn - angle + 90) % 180 - 90) < 0.5
        assert length[along].sum() > 0.85 * length.sum()


def test_one_way_lines_all_run_in_one_direction_and_stay_so(make_part, profile):
    geometry = made(make_part, profile, SLICES["square"], strategy="hatch", hatch="one-way",
                    hatch_angle_deg=0.0, outline_tracks=1)
    assert geometry.is_directed.sum() == geometry.n_tracks - 1
    ordered = order_tracks(geometry, 1, np.zeros(2), None, 0.02, lambda a, b: 0.0)
    runs = [ordered.points_mm[ordered.starts[k + 1] - 1] - ordered.points_mm[ordered.starts[k]]
            for k in range(ordered.n_tracks)]
    lines = np.array([run for run in runs if np.hypot(*run) > 1])
    assert (lines[:, 0] > 0).all()
    assert np.abs(lines[:, 1]).max() < 1e-6


def test_a_zigzag_of_a_square_is_one_track_beside_its_outline(make_part, profile):
    geometry = made(make_part, profile, SLICES["square"], strategy="hatch", hatch_angle_deg=0.0)
    assert geometry.n_tracks == 2
    assert geometry.is_closed.sum() == 1


def test_lines_end_at_a_jump_of_the_material(make_part, profile):
    geometry = made(make_part, profile, [rectangle(36.0, 18.0)], strategy="hatch",
                    mixture=lambda p: np.where(p[:, 0] < 3, 0.1, 0.7))
    for number in range(geometry.n_tracks):
        assert np.ptp(geometry.fractions[geometry.track(number)], axis=0).max() < 1e-9


@pytest.mark.parametrize("name", ["disc", "annulus", "square"])
def test_a_ring_is_one_spiral(make_part, profile, name):
    geometry = made(make_part, profile, SLICES[name], strategy="spiral")
    assert geometry.n_tracks == 1
    assert not geometry.is_closed[0]
    radius = np.hypot(*geometry.points_mm.T)
    angle = np.unwrap(np.arctan2(*geometry.points_mm.T[::-1]))
    assert (np.abs(np.diff(angle)) < 0.3).all()
    assert radius[0] > radius[-1]


def test_what_is_no_ring_gets_offset_tracks(make_part, profile):
    spiral = made(make_part, profile, SLICES["dumbbell"], strategy="spiral")
    offset = made(make_part, profile, SLICES["dumbbell"], strategy="offset")
    np.testing.assert_allclose(
        np.sort(spiral.points_mm, axis=0), np.sort(offset.points_mm, axis=0), atol=0.3)
