"""Mixtures for the most of a bead, and what lies on top once it is poured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lmctl.config.part_file import ProcessSettings
from lmctl.plan.dilution.fed_mixtures import mixture_to_feed
from lmctl.plan.dilution.fitted_mixtures import fitted_mixtures
from lmctl.plan.dilution.poured_columns import pour
from lmctl.plan.melted_below import MeltedBelow
from lmctl.plan.recipe import make_recipe
from lmctl.plan.sequence.flat_arrays import arc_lengths_mm
from lmctl.plan.sequence.track_order import OrderedTracks

BEAD, PITCH, LAYER, SHARE = 2.0, 4 / 3, 0.8, 0.2
PLATE = np.array([1.0, 0.0, 0.0])
N = 151
X = np.linspace(0.0, 30.0, N)


@pytest.fixture
def recipe(profile, materials):
    return make_recipe(materials, ProcessSettings(overlap=1 / 3), profile)


def rows_of_beads(*at_mm, hard=lambda y: 0.5 + 0 * y, below=PLATE, strip=PITCH, turned=()):
    """Straight tracks of 30 mm in this order; hard : share of the second material at y."""
    points, across = [], []
    for k, y in enumerate(at_mm):
        sign = -1 if k in turned else 1
        points.append(np.column_stack([X[::sign], np.full(N, y)]))
        second = hard(y + sign * np.linspace(-1, 1, 5) * BEAD / 2)
        across.append(np.tile(np.column_stack([1 - second, second]), (N, 1, 1)))
    points, across = np.vstack(points), np.vstack(across)
    middle = across[:, 2]
    designed = np.column_stack([middle, np.zeros(len(points))])
    lies_on = np.tile(below, (len(points), 1))
    share = np.full(len(points), SHARE)
    starts = N * np.arange(len(at_mm) + 1)
    return OrderedTracks(
        points, np.full(len(points), strip), mixture_to_feed(designed, lies_on, share), starts,
        arc_lengths_mm(points, starts, 1.0),
        MeltedBelow(designed, lies_on, share, across))


def middle_of(values):
    return values.reshape(-1, N)[:, N // 2]


def poured(tracks, before=None):
    melted = tracks.melted
    return pour(tracks.points_mm, tracks.starts, BEAD, tracks.strip_width_mm * LAYER, melted.share,
                melted.below, tracks.fractions, None, before)


def test_a_bead_alone_becomes_what_it_is_to_be(recipe):
    tracks = rows_of_beads(0.0)
    assert middle_of(fitted_mixtures(tracks, recipe, None).fractions[:, 1]) == pytest.approx(0.625)
    laid = poured(tracks).laid
    known = laid.mixture[~np.isnan(laid.mixture[:, 0])]
    assert known == pytest.approx(np.tile([0.5, 0.5, 0.0], (len(known), 1)))
    # a bead of 2 mm and 30 mm, in columns of an eighth of a millimetre
    assert len(known) * laid.cell_mm**2 == pytest.approx(60.0, rel=0.1)


def test_a_bead_between_two_others_melts_them_in_place_of_the_plate():
    """Against sections of parabolas."""
    tracks = rows_of_beads(0.0, 2 * PITCH, PITCH)
    found = pour(tracks.points_mm, tracks.starts, BEAD, tracks.strip_width_mm * LAYER,
                 tracks.melted.share, tracks.melted.below, tracks.fractions,
                 tracks.melted.designed_across, None)
    # oracle: parabolas of half-width 1 beside a third raised to fill between them
    across = (np.arange(-1, 1, 1e-3) + 5e-4)
    crown = 1.5 * PITCH * LAYER / BEAD
    beside = sum(np.clip(crown * (1 - (across - y) ** 2), 0, None) for y in (-PITCH, PITCH))
    level = min(np.linspace(-1, 2, 6001), key=lambda one: abs(np.clip(
        one - beside + crown * (1 - across**2), 0, None).mean() - PITCH * LAYER / BEAD))
    gained = np.clip(level - beside + crown * (1 - across**2), 0, None)
    upon = np.minimum(0.25 * gained, beside).sum() / (0.25 * gained).sum()
    assert middle_of(found.melted[:, 1])[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert middle_of(found.melted[:, 1])[2] == pytest.approx(0.5 * upon, abs=0.03)


def test_what_a_bead_melts_on_the_whole_is_made_up_for(recipe):
    """The mixture of a bead is off by half the tolerance of a path at most, whatever it melts."""
    tracks = rows_of_beads(0.0, 2 * PITCH, PITCH)
    found = fitted_mixtures(tracks, recipe, None)
    laid = middle_of(found.melted.laid(found.fractions)[:, 1])
    assert laid[:2] == pytest.approx([0.5, 0.5])
    assert abs(laid[2] - 0.5) <= 0.01
    assert middle_of(found.fractions[:, 1])[2] < 0.625


def test_over_a_layer_of_its_own_mixture_nothing_changes(recipe):
    own = np.array([0.5, 0.5, 0.0])
    tracks = rows_of_beads(0.0, PITCH, below=own)
    found = fitted_mixtures(tracks, recipe, None)
    assert found.fractions == pytest.approx(tracks.fractions)
    assert found.melted.below == pytest.approx(tracks.melted.below)


def test_the_layer_below_is_melted_as_it_was_laid(recipe):
    """A layer that came out too poor is made up for where it lies, and only there."""
    first = rows_of_beads(0.0, 2.5)
    poor = replace(first, fractions=np.where(np.arange(2 * N)[:, None] < N, [0.5, 0.5],
                                             first.fractions))
    second = fitted_mixtures(
        rows_of_beads(0.0, 2.5, below=np.array([0.5, 0.5, 0.0])), recipe, poured(poor).laid)
    # the first bead was fed 0.5 and became 0.4
    assert middle_of(second.fractions[:, 1]) == pytest.approx(
        [(0.5 - SHARE * 0.4) / (1 - SHARE), 0.5], abs=0.004)


def test_where_the_part_has_a_kink_the_most_of_the_bead_decides(recipe):
    """A ramp that begins at the bead's left third: its mean is too rich for the rest."""
    own = np.array([0.9, 0.1, 0.0])
    tracks = rows_of_beads(
        0.0, hard=lambda y: 0.1 + 0.3 * np.clip(y - 0.25, 0.0, None), below=own)
    found = middle_of(fitted_mixtures(tracks, recipe, None).fractions[:, 1])
    across = np.linspace(-1, 1, 2001)
    wanted = np.interp(across, np.linspace(-1, 1, 5), tracks.melted.designed_across[0, :, 1])
    mean = np.average(wanted, weights=1 - across**2)
    assert 0.1 < found < (mean - SHARE * 0.1) / (1 - SHARE) - 0.005


def test_left_and_right_stay_when_a_track_is_turned_round(recipe):
    def ramp(y):
        return 0.3 + 0.05 * y + 0.1 * np.clip(y - 1.0, 0.0, None)

    there = fitted_mixtures(rows_of_beads(0.0, PITCH, hard=ramp), recipe, None)
    back = fitted_mixtures(rows_of_beads(0.0, PITCH, hard=ramp, turned=(0, 1)), recipe, None)
    assert middle_of(there.fractions) == pytest.approx(middle_of(back.fractions), abs=1e-4)


def test_vertices_in_another_order_keep_what_is_across():
    melted = rows_of_beads(0.0, hard=lambda y: 0.5 + 0.1 * y).melted
    index = np.arange(N)[::-1]
    turned = melted.at_vertices(index, np.ones(N, dtype=bool))
    assert turned.designed_across[0, :, 1] == pytest.approx(melted.designed_across[-1, ::-1, 1])
    assert melted.at_vertices(index).designed_across[0, :, 1] == pytest.approx(
        melted.designed_across[-1, :, 1])


def test_without_a_field_across_tracks_are_fed_as_they_are(recipe):
    tracks = rows_of_beads(0.0)
    plain = replace(tracks, melted=replace(tracks.melted, designed_across=None))
    assert fitted_mixtures(plain, recipe, None) is plain
    assert fitted_mixtures(replace(tracks, melted=None), recipe, None).melted is None
