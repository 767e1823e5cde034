"""Plans under alloy rules: nothing forbidden is laid, and what is changed is said."""

import numpy as np
import pytest

from lmctl.config.dilution import DilutionSettings
from lmctl.errors import PlanError
from lmctl.part.load import part_from_text
from lmctl.plan.planner import PlanOptions, plan_job
from lmctl.plan.sequence.alloy_cuts import cut_ordered_tracks
from lmctl.plan.sequence.track_order import OrderedTracks
from tests.benchmarks.mixture_rows.alloy_cell import alloy_profile, materials_text
from tests.benchmarks.mixture_rows.alloy_rows import laid_by_job
from tests.plan.planned_jobs import layers_of

POWDERS = ("Fe", "V", "Ti")
BLEND = """
[[body]]
kind = "box"
low_mm = [0, 0, 0]
high_mm = [40, 10, 1.6]
[composition]
feature = { kind = "coordinate", along = "x" }
profile = { kind = "linear", near = { "Fe" = 1.0 }, far = { "Ti" = 1.0 }, over_mm = [4, 36] }
"""
HALVES = """
[[body]]
name = "left"
kind = "box"
low_mm = [0, 0, 0]
high_mm = [20, 10, 1.6]
composition.profile = { kind = "constant", of = { "Fe" = 1.0 } }
[[body]]
name = "right"
kind = "box"
low_mm = [20, 0, 0]
high_mm = [40, 10, 1.6]
composition.profile = { kind = "constant", of = { "Ti" = 1.0 } }
[[body]]
kind = "union"
of = ["left", "right"]
"""


def part_of(folder, shape, *, rule="", process="", powders=POWDERS):
    text = f"""
name = "part"
{materials_text(powders)}{shape}
[process]
{process}
"""
    if rule is not None:
        text += f"""
[[alloy_rule]]
name = "Ti-Fe"
powders = ["Ti", "Fe"]
forbidden = [{{ "Ti" = [0.1, 1.0], "Fe" = [0.1, 1.0] }}]
reason = "FeTi"
source = "phase diagram"
{rule}
"""
    return part_from_text(text, folder, "part")


def is_forbidden(mixtures):
    return (mixtures[:, 0] >= 0.1) & (mixtures[:, 2] >= 0.1)


@pytest.mark.parametrize("shape", [BLEND, HALVES], ids=["blend", "halves"])
@pytest.mark.parametrize("way", ["jump", "around"])
@pytest.mark.parametrize("strategy", ["offset", "iso-composition"])
def test_nothing_forbidden_is_laid(tmp_path, shape, way, strategy):
    part = part_of(tmp_path, shape, rule=f'way = "{way}"', process=f'strategy = "{strategy}"')
    manifest = plan_job(part, alloy_profile(), tmp_path / "a.lmj",
                        options=PlanOptions(allow_incomplete=True))
    laid = laid_by_job(tmp_path / "a.lmj")
    assert len(laid) > 10_000
    assert not is_forbidden(laid).any()
    assert manifest.totals["forbidden_places"] == 0
    assert manifest.totals["alloy_checked_places"] > 500
    if way == "around" and shape is BLEND:
        assert (laid[:, 1] > 0.7).any()  # through vanadium
    if way == "jump":
        assert (laid[:, 1] < 1e-9).all()


def test_tracks_of_one_mixture_are_cut_and_lie_outside_too(tmp_path):
    """The mean of a track that goes round a region may lie inside it."""
    part = part_of(tmp_path, BLEND.replace("1.6]", "4.8]"), process='strategy = "iso-3d"')
    plan_job(part, alloy_profile(), tmp_path / "a.lmj", options=PlanOptions(allow_incomplete=True))
    assert not is_forbidden(laid_by_job(tmp_path / "a.lmj")).any()


def test_without_the_rule_forbidden_mixtures_are_laid(tmp_path):
    plan_job(part_of(tmp_path, BLEND, rule=None), alloy_profile(), tmp_path / "a.lmj")
    assert is_forbidden(laid_by_job(tmp_path / "a.lmj")).mean() > 0.3


def test_a_rule_that_concerns_nothing_changes_no_line(tmp_path):
    plain = part_of(tmp_path, BLEND, rule=None)
    ruled = part_of(tmp_path, BLEND).text.replace(
        '"Ti" = [0.1, 1.0]', '"V" = [0.1, 1.0]').replace('["Ti", "Fe"]', '["V", "Fe"]')
    ruled = part_from_text(ruled, tmp_path, "part")
    plan_job(plain, alloy_profile(), tmp_path / "a.lmj")
    plan_job(ruled, alloy_profile(), tmp_path / "b.lmj")
    for one, other in zip(layers_of(tmp_path / "a.lmj")[1], layers_of(tmp_path / "b.lmj")[1],
                          strict=True):
        assert one.program == other.program


def test_the_job_says_what_a_rule_changed(tmp_path):
    manifest = plan_job(part_of(tmp_path, BLEND, rule='way = "jump"'), alloy_profile(),
                        tmp_path / "a.lmj")
    rule = manifest.totals["alloy_rules"][0]
    assert rule["reason"] == "FeTi"
    assert rule["source"] == "phase diagram"
    # the region and its margins are 88 % of the blend; what lies in its middle moves by most
    assert rule["changed_by"] == pytest.approx(0.45, abs=0.04)
    assert rule["changed_mm"] == pytest.approx(
        0.88 * 32 / 40 * manifest.totals["path_length_mm"], rel=0.1)
    assert [blend["way"] for blend in rule["blends"]] == ["jump"]
    said = [found["text"] for found in manifest.verdict
            if "alloy rule Ti-Fe: FeTi" in found["text"]]
    assert len(said) == 1
    assert "jumps between" in said[0]
    kept, _ = layers_of(tmp_path / "a.lmj")
    assert kept.totals["alloy_rules"] == manifest.totals["alloy_rules"]
    designed = np.array([layer.designed for layer in manifest.mixtures])
    assert designed[:, 0] == pytest.approx(0.5, abs=0.02)  # the part file's, not the rule's


def test_powder_that_comes_late_is_refused_with_the_place_and_the_reason(tmp_path):
    part = part_of(tmp_path, HALVES, process='powder = "none"')
    with pytest.raises(PlanError) as caught:
        plan_job(part, alloy_profile(), tmp_path / "a.lmj")
    text = caught.value.render()
    assert "a forbidden mixture would be deposited" in text
    assert "Ti-Fe: FeTi (phase diagram)" in text
    assert 'plan with powder = "lead"' in text
    assert not (tmp_path / "a.lmj").exists()


def test_a_mixture_no_hopper_meters_is_moved_out_of_the_region_not_into_it(tmp_path):
    """Least flows round a mixture to none or to the least, which may lie inside."""
    shape = BLEND.replace('near = { "Fe" = 1.0 }', 'near = { "Fe" = 0.96, "Ti" = 0.04 }')
    part = part_of(tmp_path, shape, process="speed_mm_s = 4").text.replace(
        '"Ti" = [0.1, 1.0]', '"Ti" = [0.07, 1.0]').replace("speed_mm_s = 10\n", "")
    plan_job(part_from_text(part, tmp_path, "part"), alloy_profile(), tmp_path / "a.lmj")
    laid = laid_by_job(tmp_path / "a.lmj")
    assert not ((laid[:, 0] >= 0.1) & (laid[:, 2] >= 0.07)).any()


def test_cut_tracks_keep_their_length_and_have_their_mixture_on_both_sides():
    x = np.linspace(0, 10, 11)
    tracks = OrderedTracks(
        np.column_stack([np.append(x, x), np.repeat([0.0, 1.0], 11)]), np.ones(22),
        np.column_stack([np.append(x, x) / 10, 1 - np.append(x, x) / 10]), np.array([0, 11, 22]),
        np.append(x, x + 11), None)
    cut = cut_ordered_tracks(tracks, np.array([3.5, 15.25, 18.5]))
    assert cut.starts.tolist() == [0, 5, 13, 19, 24, 28]
    assert cut.lengths_mm.tolist() == [3.5, 6.5, 4.25, 3.25, 2.5]
    assert (np.diff(cut.along_mm) > 0).all()
    np.testing.assert_allclose(cut.fractions[:, 0], cut.points_mm[:, 0] / 10)
    np.testing.assert_allclose(cut.points_mm[cut.starts[1:4] - 1], cut.points_mm[cut.starts[1:4]]
                               * [[1, 1], [0, 0], [1, 1]] + [[0, 0], [10, 0], [0, 0]])


def diluting(share):
    return alloy_profile().model_copy(update={"dilution": (DilutionSettings(share=share),)})


def test_dilution_counts_in_what_is_laid(tmp_path):
    """A blend that goes round is planned; the same material on a plate of the other is not."""
    part = part_of(tmp_path, BLEND, rule='way = "around"\nmargin = 0.04')
    manifest = plan_job(part, diluting(0.15), tmp_path / "a.lmj")
    assert manifest.totals["forbidden_places"] == 0
    titanium = BLEND.replace('near = { "Fe" = 1.0 }', 'near = { "V" = 1.0 }')
    on_steel = part_of(tmp_path, titanium + '[substrate]\nmaterial = "Fe"\n')
    with pytest.raises(PlanError) as caught:
        plan_job(on_steel, diluting(0.15), tmp_path / "b.lmj")
    assert "melted from the layer below, or from the substrate" in caught.value.render()
    assert "Ti-Fe: FeTi" in caught.value.render()
    plan_job(on_steel, diluting(0.05), tmp_path / "b.lmj")
