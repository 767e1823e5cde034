"""Where the material jumps, tracks end on the jump; the mixture changes with the beam off."""

import numpy as np
import pytest

from lmctl.config.part_file import ProcessSettings
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind
from lmctl.plan.geometry import layer_geometry
from lmctl.plan.planner import plan_job
from lmctl.preflight.placement import place_part
from tests.plan.conftest import circle, rectangle

PITCH = ProcessSettings().bead_width_mm * (1 - ProcessSettings().overlap)
HALVES = [rectangle(40.0, 20.0)]


def right_is_hard(points):
    return np.where(points[:, 0] < 0.0, 0.1, 0.7)


def tracks_of(part, profile, layer=0):
    geometry = layer_geometry(part, place_part(part, profile), layer)
    return geometry, [geometry.track(number) for number in range(geometry.n_tracks)]


def test_no_track_crosses_a_jump(make_part, profile):
    geometry, tracks = tracks_of(make_part(HALVES, right_is_hard), profile)
    for track in tracks:
        assert np.ptp(geometry.fractions[track], axis=0).max() < 1e-9
        x = geometry.points_mm[track][:, 0]
        assert x.max() < 0 or x.min() > 0
    assert {round(float(f), 6) for f in geometry.fractions[:, 1]} == {0.1, 0.7}


def test_both_sides_are_filled_up_to_the_jump(make_part, profile):
    geometry, _ = tracks_of(make_part(HALVES, right_is_hard), profile)
    assert geometry.figures.inside_mm2 / geometry.figures.slice_mm2 > 0.985
    x = geometry.points_mm[:, 0]
    assert x[x < 0].max() == pytest.approx(-PITCH / 2, abs=0.03)
    assert x[x > 0].min() == pytest.approx(PITCH / 2, abs=0.03)


def test_a_jump_lies_where_the_field_has_it_between_nodes(make_part, profile):
    part = make_part(HALVES, lambda p: np.where(p[:, 0] + 0.3 * p[:, 1] < 1.234, 0.1, 0.7))
    geometry, _ = tracks_of(part, profile)
    beyond = (geometry.points_mm @ [1.0, 0.3] - 1.234) / np.hypot(1.0, 0.3)
    assert np.abs(beyond).min() == pytest.approx(PITCH / 2, abs=0.05)


def test_an_island_of_another_material_is_a_region_of_its_own(make_part, profile):
    part = make_part([circle(12.0)], lambda p: np.where(np.hypot(*p[:, :2].T) < 5.0, 0.7, 0.1))
    geometry, tracks = tracks_of(part, profile)
    radius = np.hypot(*geometry.points_mm.T)
    for track in tracks:
        assert radius[track].max() < 5.0 or radius[track].min() > 5.0
    assert geometry.figures.inside_mm2 / geometry.figures.slice_mm2 > 0.98


def test_a_slope_is_no_jump(make_part, profile):
    sloped, _ = tracks_of(make_part(HALVES, lambda p: 0.5 + p[:, 0] / 60), profile)
    plain, _ = tracks_of(make_part(HALVES, lambda p: 0.5 + 0 * p[:, 0]), profile)
    assert sloped.n_tracks >= plain.n_tracks
    assert (sloped.points_mm[:, 0] > 0).any()
    assert any(np.ptp(sloped.points_mm[sloped.track(k)][:, 0]) > 30 for k in range(sloped.n_tracks))


def test_a_stepped_seam_interlocks_from_layer_to_layer(make_part, profile):
    process = ProcessSettings(material_seam="stepped")
    part = make_part(HALVES, right_is_hard, process=process)
    edges = []
    for layer in (0, 1):
        geometry, tracks = tracks_of(part, profile, layer)
        for track in tracks:  # each side keeps its own material beyond the jump
            assert np.ptp(geometry.fractions[track], axis=0).max() < 1e-9
        hard = geometry.fractions[:, 1] > 0.4
        edges.append(float(geometry.points_mm[hard, 0].min()) - PITCH / 2)
        assert geometry.figures.inside_mm2 / geometry.figures.slice_mm2 > 0.98
    assert sorted(edges) == pytest.approx([-PITCH / 2, PITCH / 2], abs=0.05)


def test_the_mixture_changes_once_a_layer_with_the_beam_off(tmp_path, make_part, profile):
    manifest = plan_job(make_part(HALVES, right_is_hard), profile, tmp_path / "halves.lmj")
    assert manifest.totals["mixture_share"] > 0.999
    with JobReader(tmp_path / "halves.lmj") as job:
        for layer in job.iterate_layers():
            bead = layer.lines["kind"] == LineKind.BEAD
            if bead.any():
                changes = np.abs(np.diff(layer.lines["fractions"][bead][:, 1])) > 0.3
                assert changes.sum() == 1
