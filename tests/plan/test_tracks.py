"""Where tracks lie: at half a bead, a pitch apart, meeting without void and without pile-up."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from lmctl.plan import spacing
from lmctl.plan.coverage import covered_area_mm2, overhang_area_mm2
from lmctl.plan.plane_values import plane_values
from lmctl.plan.polyline import arc_lengths
from lmctl.plan.tracks import in_plane_tracks, iso_3d_tracks

BEAD = 2.0
PITCH = BEAD * (1 - 0.333)

#: Corners of an outline are rounded by the bead: that much of the slice is out of reach.
FULLY_COVERED = ["disc", "annulus", "rectangle", "square", "gear", "wall 1.0", "wall 1.7",
                 "wall 2.2", "islands"]


def radii(tracks):
    return sorted((float(np.hypot(*t.points.T).mean()) for t in tracks), reverse=True)


def test_rings_of_a_disc(section, shapes):
    tracks = in_plane_tracks(section(shapes["disc"]), BEAD, PITCH)
    rings = radii(tracks)
    assert all(track.closed for track in tracks)
    assert rings[0] == pytest.approx(9.0, abs=0.005)
    gaps = -np.diff(rings)
    assert gaps == pytest.approx(np.full(len(gaps), gaps[0]), abs=0.01)
    assert gaps[0] == pytest.approx(PITCH, rel=spacing.PITCH_TOLERANCE)
    assert rings[-1] == pytest.approx(gaps[0] / 2, abs=0.05)  # no void inside, no pile-up
    for track in tracks:
        assert np.ptp(np.hypot(*track.points.T)) < 0.03


def test_a_disc_of_ten_rings(section):
    turn = np.linspace(0, 2 * np.pi, 2001)
    loop = 10.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    loop[-1] = loop[0]
    tracks = in_plane_tracks(section([loop], 0.125), 1.0, 1.0)
    assert radii(tracks) == pytest.approx(np.arange(9.5, 0, -1), abs=0.01)


@pytest.mark.parametrize("radius", np.linspace(14.8, 15.6, 9))
def test_a_disc_has_the_rings_that_stretch_the_pitch_least(radius):
    """Rings at a/2 + n d end half a pitch from the middle: their number decides the pitch."""
    pitch = spacing.fitting_pitch_mm(np.empty(0), np.empty(0), radius, BEAD, PITCH)
    rings = np.arange(2, 30)
    fitting = (radius - BEAD / 2) / (rings - 0.5)
    best = fitting[np.argmin(np.abs(fitting / PITCH - 1))]
    assert pitch == pytest.approx(best, rel=0.002)


@pytest.mark.parametrize("name", FULLY_COVERED)
def test_tracks_cover_the_slice(section, shapes, name):
    cut = section(shapes[name])
    covered, area = covered_area_mm2(cut, in_plane_tracks(cut, BEAD, PITCH), BEAD)
    assert covered / area >= 0.99


@pytest.mark.parametrize("raster", [0.1, 0.25, 0.7])
def test_the_area_of_a_slice_is_its_outline_s_whatever_the_raster(section, raster):
    """A plate of 30 × 2 with a hole of 1 × 1: nodes would count 15 % too little, or too much."""
    outer = np.array([[0, 0], [30, 0], [30, 2], [0, 2], [0, 0.0]])
    hole = np.array([[20, 0.5], [20, 1.5], [21, 1.5], [21, 0.5], [20, 0.5]])
    cut = section([outer, hole], raster)
    assert covered_area_mm2(cut, [], BEAD) == (0.0, pytest.approx(59.0, rel=1e-12))
    covered, area = covered_area_mm2(cut, in_plane_tracks(cut, BEAD, PITCH), BEAD)
    assert 0 < covered <= area == pytest.approx(59.0, rel=1e-12)


@pytest.mark.parametrize("name", ["small disc", "wall 1.05", "wall 1.3", "wedge"])
def test_what_is_nearly_too_thin_is_covered_as_far_as_a_bead_reaches(section, shapes, name):
    cut = section(shapes[name])
    tracks = in_plane_tracks(cut, BEAD, PITCH)
    covered, _ = covered_area_mm2(cut, tracks, BEAD)
    wide_enough = covered_area_mm2(cut, tracks, BEAD)[1]
    if name == "wedge":  # its tip is thinner than a bead from 7.2 mm inwards
        wide_enough -= 0.5 * 7.2 * 1.8
    assert covered / wide_enough >= 0.975


@pytest.mark.parametrize("name", ["disc", "annulus", "rectangle", "gear", "islands", "wedge",
                                  "wall 1.0", "wall 1.05", "wall 1.3"])
def test_no_track_leaves_the_inset(section, shapes, name):
    cut = section(shapes[name])
    for track in in_plane_tracks(cut, BEAD, PITCH):
        depth = plane_values(cut.distance, cut.grid, track.points)
        assert depth.min() >= BEAD / 2 - 0.05 * BEAD


@pytest.mark.parametrize("name", ["gear", "wedge", "rectangle", "wall 2.2", "annulus"])
def test_tracks_do_not_pile_up(section, shapes, name):
    """Strips share the slice: where two tracks come near, each has the less to fill."""
    cut = section(shapes[name])
    tracks = in_plane_tracks(cut, BEAD, PITCH)
    for index, track in enumerate(tracks):
        others = [t.points for i, t in enumerate(tracks) if i != index]
        if not others:
            continue
        gap, _ = cKDTree(np.vstack(others)).query(track.points)
        middle = gap[len(gap) // 10 : -len(gap) // 10 or None]
        assert np.quantile(middle, 0.1) >= PITCH * 0.4


@pytest.mark.parametrize(
    ("width", "tracks_across"),
    [(2.0, 1), (2.02, 1), (2.6, 2), (3.4, 2), (4.4, 3), (6.0, 4), (7.4, 5)],
)
def test_tracks_across_a_wall(section, width, tracks_across):
    """Counted along the line across its middle."""
    x, y = 20.0, width / 2
    cut = section([np.array([[-x, -y], [x, -y], [x, y], [-x, y], [-x, -y]])], 0.125)
    tracks = in_plane_tracks(cut, BEAD, PITCH)
    crossings = 0
    for track in tracks:
        side = np.sign(track.points[:, 0] - 0.03)
        crossings += int(np.count_nonzero(np.diff(side)))
    assert crossings == tracks_across


@pytest.mark.parametrize("width", [3.4, 4.4, 5.1, 6.0, 7.4, 9.0, 20.0])
def test_the_strips_of_a_wall_add_up_to_its_width(section, width):
    """But for the rim outside the outermost tracks, which no bead fills to the brim."""
    x, y = 20.0, width / 2
    cut = section([np.array([[-x, -y], [x, -y], [x, y], [-x, y], [-x, -y]])], 0.125)
    strips = 0.0
    pitch = 0.0
    for track in in_plane_tracks(cut, BEAD, PITCH):
        crossing = np.flatnonzero(np.diff(np.sign(track.points[:, 0] - 0.03)))
        strips += float(track.share_mm[crossing].sum())
        pitch = max(pitch, float(track.share_mm.max()))
    rim = BEAD - PITCH
    assert strips + rim == pytest.approx(width, abs=0.15 * PITCH + 0.05)


def test_a_wedge_has_single_tracks_where_it_is_thin(section, shapes):
    tracks = in_plane_tracks(section(shapes["wedge"]), BEAD, PITCH)
    assert any(not track.closed for track in tracks)
    centrelines = [t for t in tracks if np.abs(t.points[:, 1]).max() < 0.05]
    assert centrelines


def test_islands_are_told_apart(section, shapes):
    tracks = in_plane_tracks(section(shapes["islands"]), BEAD, PITCH)
    assert {track.island for track in tracks} == {0, 1, 2}


def test_what_is_thinner_than_a_bead_has_no_track(section):
    thin = np.array([[-20, -0.8], [20, -0.8], [20, 0.8], [-20, 0.8], [-20, -0.8]])
    assert in_plane_tracks(section([thin], 0.1), BEAD, PITCH) == []


def test_no_outline_no_tracks(section, shapes):
    cut = section(shapes["disc"])
    empty = type(cut)(0.0, cut.grid, [], np.full_like(cut.distance, -np.inf), cut.distance)
    assert in_plane_tracks(empty, BEAD, PITCH) == []


def test_the_papers_reading_takes_levels_of_the_3d_distance(section, shapes):
    """A ball cut at z = 8: its 3D distance is R − √(x² + y² + 64)."""
    cut = section(shapes["disc"])
    grid = cut.grid
    x, y = np.meshgrid(grid.x_mm, grid.y_mm)
    ball = (10.05 - np.sqrt(x**2 + y**2 + 64)).astype(np.float32)
    cut = type(cut)(8.0, grid, cut.loops, cut.distance, ball)
    tracks = iso_3d_tracks(cut, BEAD, PITCH)
    assert radii(tracks) == pytest.approx([np.sqrt(9.05**2 - 64)][: len(tracks)], abs=0.02)


def test_overhang_is_what_lies_beyond_the_lean(section, shapes):
    below, above = section(shapes["disc"]), section([shapes["disc"][0] * 1.1])
    lean = 0.5
    area = overhang_area_mm2(above, below, lean)
    assert area == pytest.approx(np.pi * (11**2 - 10.5**2), rel=0.03)
    assert overhang_area_mm2(above, None, lean) == 0
    assert overhang_area_mm2(below, above, lean) == 0
    assert overhang_area_mm2(above, below, 1.1) == 0


def test_every_share_is_within_reason(section, shapes):
    for name in shapes:
        for track in in_plane_tracks(section(shapes[name]), BEAD, PITCH):
            assert track.share_mm.min() >= 0.4 * PITCH
            assert track.share_mm.max() <= 1.5 * PITCH
            assert len(track.share_mm) == len(track.points)
            assert np.diff(arc_lengths(track.points)).max() <= BEAD / 10 + 1e-9
