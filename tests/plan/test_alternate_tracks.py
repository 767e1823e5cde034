"""Every other track first, on a plate of another alloy: rounds, strips, order."""

from __future__ import annotations

import numpy as np
import pytest

from lmctl.config.dilution import DilutionSettings
from lmctl.config.part_file import ProcessSettings
from lmctl.config.substrate import SubstrateSettings
from lmctl.plan.dilution import with_known_dilution
from lmctl.plan.geometry import LayerFigures, LayerGeometry, layer_geometry
from lmctl.plan.geometry.alternate_tracks import alternate_tracks, lies_on_other_alloy
from lmctl.plan.geometry.beside_tracks import left_of_tracks
from lmctl.plan.sequence.track_order import order_tracks
from lmctl.preflight.placement import place_part

BEAD, PITCH = 2.0, 4 / 3


def layer_of(lines, strip=PITCH, mixture=(0.5, 0.5)):
    points = np.vstack(lines)
    strips = np.concatenate([np.full(len(line), one) for line, one in zip(
        lines, np.broadcast_to(strip, len(lines)), strict=True)])
    return LayerGeometry(
        layer=0, z_mm=0.4, points_mm=points, starts=np.cumsum([0, *map(len, lines)]),
        strip_width_mm=strips, fractions=np.tile(np.array(mixture, float), (len(points), 1)),
        is_closed=np.array([bool((line[0] == line[-1]).all()) for line in lines]),
        island=np.zeros(len(lines), dtype=np.intp), outline_mm=np.empty((0, 2)),
        outline_starts=np.zeros(1, dtype=np.intp), figures=LayerFigures(1, 1, 0, 0, 1))


def row(y, low=0.0, high=20.0):
    x = np.arange(low, high + 1e-9, 0.2)
    return np.column_stack([x, np.full(len(x), y)])


def circle(radius):
    angle = np.linspace(0, 2 * np.pi, max(8, int(2 * np.pi * radius / 0.2)) + 1)
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    ring[-1] = ring[0]
    return ring


def volumes(layer):
    """Of each track, in strip width times length."""
    step = np.linalg.norm(np.diff(layer.points_mm, axis=0), axis=1)
    strip = (layer.strip_width_mm[1:] + layer.strip_width_mm[:-1]) / 2
    return [float((step * strip)[a:b - 1].sum())
            for a, b in zip(layer.starts[:-1], layer.starts[1:], strict=True)]


def middle_strips(layer):
    return [float(layer.strip_width_mm[(a + b) // 2])
            for a, b in zip(layer.starts[:-1], layer.starts[1:], strict=True)]


def test_the_first_lie_beside_each_other_and_those_between_fill_the_gaps():
    layer = layer_of([row(k * PITCH) for k in range(5)])
    found = alternate_tracks(layer, BEAD, PITCH)
    assert found.rounds.tolist() == [0, 1, 0, 1, 0]
    # beads of 2 mm, 2.667 mm apart, leave 0.667 mm; at the edge there is one gap only
    assert middle_strips(found) == pytest.approx([5 / 3, 2 / 3, 2.0, 2 / 3, 5 / 3], abs=1e-6)
    assert sum(volumes(found)) == pytest.approx(sum(volumes(layer)), rel=1e-3)


def test_rings_alternate_and_keep_their_volume():
    layer = layer_of([circle(r * PITCH) for r in (5, 4, 3, 2, 1)])
    found = alternate_tracks(layer, BEAD, PITCH)
    assert found.rounds.tolist() == [0, 1, 0, 1, 0]  # the longer half comes first
    assert sum(volumes(found)) == pytest.approx(sum(volumes(layer)), rel=2e-3)


def test_tracks_far_apart_or_one_behind_the_other_are_no_neighbours():
    for lines in ([row(0.0), row(2 * BEAD)], [row(0.0), row(0.0, 20.0 + PITCH, 40.0)], [row(0.0)]):
        layer = layer_of(lines)
        assert alternate_tracks(layer, BEAD, PITCH) is layer


def test_a_track_beside_another_for_part_of_its_way_gives_up_only_there():
    layer = layer_of([row(0.0), row(PITCH, 10.0, 20.0)])
    found = alternate_tracks(layer, BEAD, PITCH)
    first, second = found.strip_width_mm[:101], found.strip_width_mm[101:]
    assert found.rounds.tolist() == [0, 1]
    assert first[10] == pytest.approx(PITCH)
    assert first[80] == pytest.approx(5 / 3, rel=0.02)
    assert second[25] == pytest.approx(1.0, rel=0.02)
    assert sum(volumes(found)) == pytest.approx(sum(volumes(layer)), rel=2e-3)


def test_beads_no_wider_than_their_strips_have_nothing_to_give():
    found = alternate_tracks(layer_of([row(k * 2.0) for k in range(3)], 2.0), BEAD, 2.0)
    assert middle_strips(found) == pytest.approx([2.0] * 3)


def test_left_is_left_all_the_way_round():
    ring = layer_of([circle(10.0), row(0.0)])
    left = left_of_tracks(ring)
    assert left[:-101] == pytest.approx(-ring.points_mm[:-101] / 10.0, abs=1e-3)
    assert left[-101:] == pytest.approx(np.tile([0.0, 1.0], (101, 1)))


def test_the_second_round_comes_after_the_first_and_sweeps_back():
    layer = layer_of([row(k * PITCH) for k in range(6)])
    layer.fractions[:, 0] = layer.points_mm[:, 1] / 10
    layer.fractions[:, 1] = 1 - layer.fractions[:, 0]
    found = alternate_tracks(layer, BEAD, PITCH)
    tracks = order_tracks(found, 0, np.zeros(2), None, 0.02, lambda a, b: float(a[0] > b[0]))
    order = np.round(tracks.points_mm[tracks.starts[:-1], 1] / PITCH).astype(int).tolist()
    assert found.rounds[order].tolist() == [0, 0, 0, 1, 1, 1]
    assert order[:3] == sorted(order[:3])
    assert order[3:] == sorted(order[3:], reverse=True)


@pytest.mark.parametrize(("mixture", "substrate", "differs"), [
    ((1.0, 0.0), (1.0, 0.0, 0.0), False),
    ((0.95, 0.05), (1.0, 0.0, 0.0), False),
    ((0.8, 0.2), (1.0, 0.0, 0.0), True),
    ((1.0, 0.0), (0.0, 0.0, 1.0), True),
])
def test_which_plates_are_of_another_alloy(mixture, substrate, differs):
    assert lies_on_other_alloy(np.array([mixture]), np.array(substrate)) is differs


EVERY_OTHER = {"first_layer_order": "every-other"}


@pytest.mark.parametrize(("process", "mixture", "alternates"), [
    (EVERY_OTHER, 0.5, True),
    (EVERY_OTHER, 0.0, False),
    (EVERY_OTHER | {"dilution": "ignore"}, 0.5, False),
    ({"first_layer_order": "in-turn"}, 0.5, False),
])
def test_only_a_first_layer_on_another_alloy_is_laid_so(
    make_part, shapes, profile, process, mixture, alternates
):
    part = make_part(shapes["rectangle"], lambda p: mixture, height_mm=2.4,
                     substrate=SubstrateSettings(material="316L"),
                     process=ProcessSettings(**process))
    placement = place_part(part, profile)
    first, second = layer_geometry(part, placement, 0), layer_geometry(part, placement, 1)
    assert (first.rounds is not None) is alternates
    assert second.rounds is None
    assert first.n_tracks > 1 if alternates else first.n_tracks == second.n_tracks == 1  # linked
    assert first.figures.strip_mm2 == pytest.approx(sum(volumes(first)), rel=0.01)


@pytest.mark.parametrize(("stated", "asked", "order"), [
    ([(0.2, None)], "auto", "in-turn"),
    ([(0.2, 150.0)], "auto", "in-turn"),
    ([(0.15, 75.0), (0.2, 150.0), (0.25, 225.0)], "auto", "every-other"),
    ([(0.15, 75.0), (0.2, 150.0), (0.25, 225.0)], "in-turn", "in-turn"),
    ([(0.2, None)], "every-other", "every-other"),
])
def test_the_order_follows_what_is_known_of_dilution(
    make_part, shapes, profile, stated, asked, order
):
    part = make_part(shapes["rectangle"], lambda p: 0.5, height_mm=2.4,
                     process=ProcessSettings(first_layer_order=asked))
    cell = profile.model_copy(update={"dilution": tuple(
        DilutionSettings(share=share, energy_J_mm=energy) for share, energy in stated)})
    assert with_known_dilution(part, cell).process.first_layer_order == order
