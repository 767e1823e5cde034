"""What the designer shows: the numbers of a file, and pictures that agree with the part itself."""

from __future__ import annotations

import base64
import io

import numpy as np
import pytest
from PIL import Image

from lmctl.designer.part_preview import SectionView
from lmctl.errors import ConfigError, UsageError
from lmctl.part.load import load_part
from lmctl.report.composition_colours import composition_colours

FIRST_WEIGHT = ("composition", "blend", 0, "weight")
ACROSS_Z = SectionView(2, 2.0)


def picture(session, view=ACROSS_Z):
    found = session.section(view)
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(found["png"]))))
    return found, pixels


def colour_at(session, u_mm, v_mm, view=ACROSS_Z):
    found, pixels = picture(session, view)
    rows, columns = pixels.shape[:2]
    low, high = found["low_mm"], found["high_mm"]
    column = round((u_mm - low[0]) / (high[0] - low[0]) * (columns - 1))
    row = round((high[1] - v_mm) / (high[1] - low[1]) * (rows - 1))
    return pixels[row, column].astype(float) / 255.0


def test_bodies_features_profiles_weights_and_shares_are_offered(session):
    numbers = {tuple(one["path"]): one for one in session.state()["numbers"]}
    assert numbers["body", 0, "high_mm", 1]["label"] == "high_mm y"
    assert numbers["body", 0, "high_mm", 1]["unit"] == "mm"
    assert numbers[FIRST_WEIGHT]["value"] == 0.25
    assert numbers["composition", "blend", 0, "feature", "at_mm", 2]["value"] == 0.0
    point = ("composition", "blend", 1, "profile", "points", 1)
    assert numbers[*point, "at_mm"]["value"] == 10.0
    assert numbers[*point, "of", "WC-12Co"]["value"] == 0.0  # not written, and may be given
    for one in numbers.values():
        assert one["low"] <= one["value"] <= one["high"]
        assert one["low"] < one["high"]


def test_a_section_has_the_colours_of_the_part(session, part_path):
    part = load_part(part_path)
    for u, v in ((2.0, 2.0), (10.0, 6.0), (18.0, 11.0)):
        expected = composition_colours(part.composition(np.array([[u, v, 2.0]])))[0]
        assert colour_at(session, u, v) == pytest.approx(expected, abs=0.02)
    assert colour_at(session, -0.5, 6.0) == pytest.approx(np.ones(3), abs=0.01)


def test_sections_across_each_axis_show_the_other_two(session):
    for axis, axes, high in ((0, "yz", (12, 4)), (1, "xz", (20, 4)), (2, "xy", (20, 12))):
        found, pixels = picture(session, SectionView(axis, 1.0))
        assert found["axes"] == axes
        assert pixels.shape[1] == pytest.approx(220, abs=6)
        assert found["high_mm"][0] == pytest.approx(1.04 * high[0], rel=0.05)


def test_moving_a_number_recolours_and_is_what_the_saved_file_says(session, part_path):
    before = colour_at(session, 18.0, 6.0)
    assert session.adjust(FIRST_WEIGHT, 1.0, continuing=False) is False  # the solid stays
    after = colour_at(session, 18.0, 6.0)
    assert np.abs(after - before).max() > 0.05
    session.save()
    part = load_part(part_path)
    expected = composition_colours(part.composition(np.array([[18.0, 6.0, 2.0]])))[0]
    assert after == pytest.approx(expected, abs=0.02)


def test_the_surface_lies_on_the_part_and_has_its_colours(session, part_path):
    found = session.surface()
    vertices = np.frombuffer(base64.b64decode(found["vertices_mm"]), "<f4").reshape(-1, 3)
    colours = np.frombuffer(base64.b64decode(found["colours"]), np.uint8).reshape(-1, 3)
    part = load_part(part_path)
    depth = part.body.distance_at(vertices.astype(np.float64))
    assert np.abs(depth).max() < 0.2  # edges are cut by a fraction of the lattice
    expected = composition_colours(part.composition(vertices.astype(np.float64)))
    assert np.abs(colours / 255.0 - expected).max() < 0.005


def test_a_body_that_changes_changes_the_surface(session):
    before = session.surface()["vertices_mm"]
    assert session.adjust(("body", 0, "high_mm", 0), 30.0, continuing=False) is True
    assert session.surface()["vertices_mm"] != before
    assert session.state()["high_mm"][0] == 30.0
    assert session.undo() is True
    assert session.surface()["vertices_mm"] == before


def test_a_part_that_would_be_none_changes_nothing(session):
    before = session.state()
    with pytest.raises(ConfigError) as refused:
        session.adjust(("body", 0, "high_mm", 0), -1.0, continuing=False)
    assert "low_mm is not below high_mm" in refused.value.render()
    assert session.state() == before


def test_a_refused_step_of_a_movement_leaves_the_steps_before(session):
    session.adjust(("body", 0, "high_mm", 0), 15.0, continuing=False)
    with pytest.raises(ConfigError):
        session.adjust(("body", 0, "high_mm", 0), -1.0, continuing=True)
    assert session.state()["high_mm"][0] == 15.0
    session.undo()
    assert session.state()["high_mm"][0] == 20.0


def test_the_verdict_of_a_layer_is_the_plans(session):
    found = session.verdict(2)
    assert (found["layer"], found["layers"]) == (2, 5)
    assert found["built_fraction"] > 0.98
    assert any("within ±0.02" in one["text"] for one in found["findings"])
    assert Image.open(io.BytesIO(base64.b64decode(found["picture"]))).width > 500
    with pytest.raises(UsageError, match="no layer 9"):
        session.verdict(9)
