"""Tracks are cut where powder could not follow, nowhere else, and no piece is too short."""

import numpy as np
import pytest

from lmctl.plan.geometry import layer_geometry
from lmctl.plan.planner import plan_job
from lmctl.plan.sequence import mixture_cuts
from lmctl.plan.sequence.mixture_cuts import LEAST_PIECE_BEADS, cut_tracks
from lmctl.preflight.placement import place_part
from tests.plan.conftest import circle, rectangle

BEAD = 2.0


def slope(at_mm, wide_mm, low=0.2, high=0.8):
    """Carbide that rises along x over so many mm."""
    return lambda p: np.interp(p[:, 0], [at_mm - wide_mm / 2, at_mm + wide_mm / 2], [low, high])


@pytest.fixture
def cut_of(make_part, profile, recipe):
    def cut(loops, mixture):
        part = make_part(loops, mixture)
        geometry = layer_geometry(part, place_part(part, profile), 0)
        return geometry, cut_tracks(geometry, recipe)
    return cut


def lengths(geometry):
    steps = np.linalg.norm(np.diff(geometry.points_mm, axis=0), axis=1)
    return np.array([steps[geometry.starts[k] : geometry.starts[k + 1] - 1].sum()
                     for k in range(geometry.n_tracks)])


@pytest.mark.parametrize("loops", [[rectangle(40.0, 16.0)], [circle(14.0)]], ids=["box", "disc"])
def test_a_slope_too_steep_for_powder_is_cut_at_its_end(cut_of, loops):
    whole, cut = cut_of(loops, slope(1.0, 2.5))
    assert cut.cuts > 4
    inner = cut.geometry.points_mm[cut.geometry.starts[1:-1]]
    new = [p for p in inner if abs(abs(p[0] - 1.0) - 1.25) < 0.4]
    assert len(new) >= cut.cuts / 2
    assert lengths(cut.geometry).sum() == pytest.approx(lengths(whole).sum())


def test_what_powder_can_follow_is_left_as_it_is(cut_of):
    whole, cut = cut_of([rectangle(40.0, 16.0)], slope(0.0, 40.0))
    assert cut.cuts == 0
    assert cut.geometry is whole


def test_no_cut_leaves_a_piece_shorter_than_two_beads(cut_of):
    def waves(points):
        return 0.5 + 0.3 * np.sin(points[:, 0] * 1.9)
    whole, cut = cut_of([rectangle(30.0, 16.0)], waves)
    shortest = lengths(whole).min()
    assert lengths(cut.geometry).min() >= min(LEAST_PIECE_BEADS * BEAD, shortest) - 0.21
    assert cut.too_short > 0


def test_pieces_carry_what_their_track_had(cut_of):
    whole, cut = cut_of([rectangle(40.0, 16.0)], slope(1.0, 2.5))
    known = {tuple(p): (w, *f) for p, w, f in zip(
        whole.points_mm.round(9), whole.strip_width_mm, whole.fractions, strict=True)}
    for point, width, mixture in zip(cut.geometry.points_mm.round(9), cut.geometry.strip_width_mm,
                                     cut.geometry.fractions, strict=True):
        assert known[tuple(point)] == (width, *mixture)
    assert (np.diff(cut.geometry.starts) >= 2).all()


def test_cuts_make_the_mixture_right_that_would_come_late(
    make_part, profile, tmp_path, monkeypatch
):
    """In boxes of several widths: the share of one hangs on where its tracks happen to lie."""
    parts = [make_part([rectangle(40.0, width)], slope(1.0, 2.0)) for width in (15.0, 16.0, 17.0)]
    cut = [plan_job(part, profile, tmp_path / "a.lmj") for part in parts]
    monkeypatch.setattr(mixture_cuts, "LEAST_PIECE_BEADS", 1e9)
    whole = [plan_job(part, profile, tmp_path / "b.lmj") for part in parts]
    missing, without = (np.mean([1 - manifest.totals["mixture_share"] for manifest in found])
                        for found in (cut, whole))
    assert missing < 0.6 * without
    for manifest in cut:
        assert any("tracks are cut in" in f["text"] for f in manifest.verdict)
