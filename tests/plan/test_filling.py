"""How much of a part its beads hold: a lone bead is round, and a person is told what that costs."""

import pytest

from lmctl.plan.planner import plan_job


def planned(make_part, profile, path, outline):
    manifest = plan_job(make_part(outline, lambda p: 0.5), profile, path / "a.lmj")
    (found,) = [f for f in manifest.verdict if f["text"].startswith("beads hold")]
    return manifest.totals, found


@pytest.mark.parametrize(("name", "wide_mm"), [("wall 1.0", 2.0), ("wall 1.7", 3.4)])
def test_a_wall_of_few_beads_is_short_of_powder_and_says_so(
        tmp_path, make_part, shapes, profile, name, wide_mm):
    totals, found = planned(make_part, profile, tmp_path, shapes[name])
    assert totals["slice_volume_mm3"] == pytest.approx(40 * wide_mm * 1.6, rel=1e-6)
    share = totals["deposited_volume_mm3"] / totals["slice_volume_mm3"]
    assert share < 0.85
    assert totals["filling"] == pytest.approx(share, abs=1e-4)
    assert found["level"] == "warning"
    assert f"{share:.0%} of the slices' volume" in found["text"]
    assert "thinner or lower" in found["text"]
    assert found["text"] in totals["warnings"]


def test_a_lone_bead_holds_what_a_parabola_of_its_width_and_height_does(
        tmp_path, make_part, shapes, profile):
    """A = 2/3 a h, which is pitch times height at the overlap of a third."""
    totals, _ = planned(make_part, profile, tmp_path, shapes["wall 1.0"])
    assert totals["deposited_volume_mm3"] / totals["path_length_mm"] == pytest.approx(
        2 / 3 * 2.0 * 0.8, rel=0.01)


def test_what_is_wide_is_filled(tmp_path, make_part, shapes, profile):
    totals, found = planned(make_part, profile, tmp_path, shapes["gear"])
    assert found["level"] == "ok"
    assert 0.9 < totals["filling"] < 1


def test_one_thin_layer_is_named_though_the_part_is_full(tmp_path, make_part, shapes, profile):
    """A plate with a rib on it: the rib is two layers of three."""
    def outline(z_mm):
        return shapes["rectangle"] if z_mm < 0.8 else shapes["wall 1.0"]

    manifest = plan_job(
        make_part(outline, lambda p: 0.5, height_mm=2.4), profile, tmp_path / "a.lmj")
    (found,) = [f for f in manifest.verdict if f["text"].startswith("beads hold")]
    assert found["level"] == "warning"
    assert "of layer 2" in found["text"]
