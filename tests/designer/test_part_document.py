"""Edits of a part file: what they change, and that nothing else does."""

from __future__ import annotations

import difflib
import tomllib

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lmctl.designer.part_document import PartDocument
from lmctl.errors import ConfigError, UsageError

HIGH_X = ("body", 0, "high_mm", 0)
FAR_CARBIDE = ("composition", "blend", 0, "profile", "far", "WC-12Co")
FIRST_WEIGHT = ("composition", "blend", 0, "weight")


@pytest.fixture
def document(part_path):
    return PartDocument(part_path)


def changed_lines(before, after):
    return [line for line in difflib.ndiff(before.splitlines(), after.splitlines())
            if line[0] in "+-"]


def test_one_number_changes_one_line_and_no_comment(document):
    before = document.text
    document.set_number(HIGH_X, 22.5)
    assert changed_lines(before, document.text) == [
        "- high_mm = [20, 12, 4]", "+ high_mm = [22.5, 12, 4]"]
    document.set_number(("composition", "blend", 1, "profile", "points", 0, "at_mm"), 1.0)
    assert '{ at_mm = 1, of = { "WC-12Co" = 1.0 } },       # the hard face' in document.text


def test_the_other_shares_of_a_mixture_give_way(document):
    document.set_number(FAR_CARBIDE, 0.5)
    far = tomllib.loads(document.text)["composition"]["blend"][0]["profile"]["far"]
    assert far == {"316L": 0.5, "WC-12Co": 0.5}
    document.set_number(FAR_CARBIDE, 1.0)
    document.set_number(FAR_CARBIDE, 0.25)  # from a mixture whose other shares are 0
    far = tomllib.loads(document.text)["composition"]["blend"][0]["profile"]["far"]
    assert far == {"316L": 0.75, "WC-12Co": 0.25}


def test_a_material_that_a_mixture_left_out_is_added_to_it(document):
    document.set_number(("composition", "blend", 1, "profile", "points", 1, "of", "WC-12Co"), 0.3)
    points = tomllib.loads(document.text)["composition"]["blend"][1]["profile"]["points"]
    assert points[1]["of"] == {"316L": 0.7, "WC-12Co": 0.3}


def test_the_other_weights_of_a_blend_give_way(document):
    document.set_number(FIRST_WEIGHT, 0.4)
    blend = tomllib.loads(document.text)["composition"]["blend"]
    assert [part["weight"] for part in blend] == [0.4, 0.6]
    assert "weight = 0.4   # of the first" in document.text


@given(st.lists(st.tuples(st.sampled_from(["316L", "WC-12Co"]), st.floats(0, 1)), max_size=8))
@settings(max_examples=60, deadline=None,
          suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_shares_always_sum_to_one(part_path, moves):
    document = PartDocument(part_path)
    for name, value in moves:
        document.set_number((*FAR_CARBIDE[:-1], name), value)
    far = tomllib.loads(document.text)["composition"]["blend"][0]["profile"]["far"]
    assert sum(far.values()) == pytest.approx(1.0, abs=1e-9)
    assert min(far.values()) >= 0.0


def test_undo_takes_a_whole_movement_back_and_redo_repeats_it(document):
    first = document.text
    for step, value in enumerate((21.0, 22.0, 23.0)):
        document.set_number(HIGH_X, value, continuing=step > 0)
    moved = document.text
    document.set_number(FIRST_WEIGHT, 0.5)
    document.undo()
    assert document.text == moved
    document.undo()
    assert document.text == first
    assert not document.can_undo
    document.redo()
    assert document.text == moved
    document.set_number(FIRST_WEIGHT, 0.1)
    with pytest.raises(UsageError, match="nothing to redo"):
        document.redo()


def test_saving_writes_the_text_and_refuses_what_another_program_changed(document, part_path):
    document.set_number(HIGH_X, 25.0)
    assert not document.is_saved
    document.save()
    assert document.is_saved
    assert part_path.read_text() == document.text
    assert [one.name for one in part_path.parent.iterdir()] == ["part.toml"]
    part_path.write_text(document.text + "# by hand\n")
    document.set_number(HIGH_X, 26.0)
    with pytest.raises(UsageError, match="changed by another program"):
        document.save()
    assert part_path.read_text().endswith("# by hand\n")


@pytest.mark.parametrize("path", [
    ("body", 7, "high_mm", 0), ("body", 0, "kind"), ("nothing",), ("body", "x", "high_mm"),
    ("body", 0, "high_mm"),
])
def test_places_that_hold_no_number_are_refused(document, path):
    before = document.text
    with pytest.raises(UsageError):
        document.set_number(path, 1.0)
    assert document.text == before
    assert not document.can_undo


def test_shares_beyond_one_are_refused(document):
    with pytest.raises(UsageError, match=r"1\.2 is no share"):
        document.set_number(FAR_CARBIDE, 1.2)


def test_a_file_that_is_no_toml_is_refused(tmp_path):
    (tmp_path / "bad.toml").write_text("name = \n")
    with pytest.raises(ConfigError, match="not valid TOML"):
        PartDocument(tmp_path / "bad.toml")
