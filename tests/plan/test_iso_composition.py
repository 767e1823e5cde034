"""Tracks along lines of equal mixture: even spacing, one mixture each, the slice filled."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from lmctl.config.part_file import ProcessSettings
from lmctl.plan.geometry import layer_geometry
from lmctl.preflight.placement import place_part
from tests.plan.conftest import circle, rectangle

PROCESS = ProcessSettings(strategy="iso-composition")
PITCH = PROCESS.bead_width_mm * (1 - PROCESS.overlap)


def geometry_of(make_part, profile, loops, mixture, layer=0, **process):
    part = make_part(loops, mixture, process=PROCESS.model_copy(update=process))
    return layer_geometry(part, place_part(part, profile), layer)


def spans(geometry):
    """Range of mixture along each track, and the track's length."""
    steps = np.linalg.norm(np.diff(geometry.points_mm, axis=0), axis=1)
    tracks = [geometry.track(number) for number in range(geometry.n_tracks)]
    return (np.array([np.ptp(geometry.fractions[t], axis=0).max() for t in tracks]),
            np.array([steps[t.start : t.stop - 1].sum() for t in tracks]))


def filled(geometry):
    return geometry.figures.inside_mm2 / geometry.figures.slice_mm2


@pytest.mark.parametrize("layer", [0, 1])
@pytest.mark.parametrize(("name", "loops", "mixture"), [
    ("along x", [rectangle(40.0, 20.0)], lambda p: 0.45 + p[:, 0] / 57),
    ("slanting", [rectangle(40.0, 20.0)], lambda p: 0.45 + p[:, 0] / 80 + p[:, 1] / 90),
    ("around a point beside", [rectangle(30.0, 16.0)],
     lambda p: np.hypot(p[:, 0] + 25, p[:, 1]) / 60),
    ("ring", [circle(18.0), circle(6.0, clockwise=True)], lambda p: np.hypot(*p[:, :2].T) / 20),
])
def test_each_track_has_one_mixture_and_the_slice_is_filled(
    make_part, profile, layer, name, loops, mixture
):
    geometry = geometry_of(make_part, profile, loops, mixture, layer)
    span, length = spans(geometry)
    assert length[span <= 0.04].sum() >= 0.9 * length.sum(), name
    assert filled(geometry) > 0.98, name
    assert geometry.figures.double_mm2 / geometry.figures.slice_mm2 < 0.03, name
    assert geometry.figures.lost == ()


def test_tracks_lie_a_pitch_apart_though_the_field_is_not_even(make_part, profile):
    """The mixture follows x², four times steeper at one end than at the other."""
    geometry = geometry_of(
        make_part, profile, [rectangle(40.0, 20.0)], lambda p: 0.1 + ((p[:, 0] + 40) / 70) ** 2)
    inner = np.abs(geometry.points_mm[:, 1]) < 6
    track = np.searchsorted(geometry.starts, np.arange(len(geometry.points_mm)), side="right")
    gaps = []
    for number in np.unique(track[inner]):
        own, others = inner & (track == number), inner & (track != number)
        gaps += cKDTree(geometry.points_mm[others]).query(geometry.points_mm[own])[0].tolist()
    assert np.percentile(gaps, 5) > 0.7 * PITCH
    assert np.percentile(gaps, 95) < 1.3 * PITCH


@pytest.mark.parametrize("length", [40.0, 40.7, 41.2])
def test_tracks_lie_half_a_pitch_from_those_of_other_layers(make_part, profile, length):
    """Where they lay upon each other, steps of mixture between beads went up through the part."""
    places = []
    for layer in range(4):
        geometry = geometry_of(make_part, profile, [rectangle(length, 20.0)],
                               lambda p: 0.45 + p[:, 0] / 57, layer)
        places.append(np.sort([np.median(geometry.points_mm[geometry.track(k), 0])
                               for k in range(geometry.n_tracks)]))
    assert places[0] == pytest.approx(places[2])
    assert places[1] == pytest.approx(places[3])
    apart = np.abs(places[1][3:-3, None] - places[0]).min(axis=1)
    assert apart.min() >= 0.35 * PITCH


def test_where_lines_come_together_tracks_end_and_none_is_too_narrow(make_part, profile):
    """All lines meet in a point, twice as far from one corner of the slice as from the other."""
    geometry = geometry_of(make_part, profile, [rectangle(30.0, 30.0)], lambda p: np.arctan2(
        p[:, 1] + 60, p[:, 0] + 60) / 1.6)
    assert filled(geometry) > 0.97
    assert geometry.strip_width_mm.min() > 0.6 * PITCH
    span, length = spans(geometry)
    assert length[span <= 0.08].sum() >= 0.8 * length.sum()


def test_a_flat_field_falls_back_to_offset_tracks(make_part, profile):
    """So does one that changes by less than a step of mixture."""
    for mixture in (lambda p: 0.3 + 0 * p[:, 0], lambda p: 0.3 + p[:, 0] / 4000):
        flat = geometry_of(make_part, profile, [rectangle(40.0, 20.0)], mixture)
        offset = geometry_of(
            make_part, profile, [rectangle(40.0, 20.0)], mixture, strategy="offset")
        np.testing.assert_array_equal(flat.points_mm, offset.points_mm)


def test_lines_that_are_points_or_shorter_than_a_bead_leave_no_hole(make_part, profile):
    """A steep hill of 1.5 mm in a plain: no band of it is as wide as a track."""
    geometry = geometry_of(
        make_part, profile, [rectangle(30.0, 20.0)],
        lambda p: 0.2 + 0.6 * np.clip(1 - np.hypot(p[:, 0], p[:, 1]) / 1.5, 0, 1))
    assert filled(geometry) > 0.98
    assert geometry.figures.lost == ()


def test_across_a_wall_graded_along_its_length_tracks_would_be_too_short(make_part, profile):
    def along(points):
        return 0.5 + points[:, 0] / 70

    walls = [rectangle(30.0, 1.8), rectangle(30.0, 20.0, (0.0, 20.0))]
    geometry = geometry_of(make_part, profile, walls, along)
    _, length = spans(geometry)
    middle = np.array([geometry.points_mm[geometry.track(k)].mean(axis=0)
                       for k in range(geometry.n_tracks)])
    on_wall = middle[:, 1] < 2
    assert on_wall.sum() == 1
    assert length[on_wall][0] > 28
    assert (~on_wall).sum() > 15  # the wide piece has its lines of equal mixture
    assert filled(geometry) > 0.98
