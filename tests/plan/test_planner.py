"""What planning accepts, refuses and warns of: placement, layers, overhang, horizons, hoppers."""

import os
import re
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from lmctl.config.part_file import ProcessSettings
from lmctl.errors import JobError, PlanError
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind
from lmctl.plan.planner import PlanOptions, plan_job
from lmctl.plan.recipe import recipe_of
from lmctl.preflight.job_check import check_job
from lmctl.preflight.program_check import check_program
from tests.plan.planned_jobs import layers_of


@pytest.mark.parametrize("height_mm", [0.37, 0.61])
@pytest.mark.parametrize("fraction", [0.123, 0.4567, 0.71])
def test_no_digit_of_a_plan_is_one_that_its_run_refuses(
        tmp_path, make_part, shapes, profile, fraction, height_mm):
    """Totals are rounded, for people; what is held against them is not."""
    process = ProcessSettings(layer_height_mm=height_mm, bead_width_mm=1.37, speed_mm_s=8.3,
                              min_built_fraction=0.95)
    part = make_part(shapes["small disc"], lambda p: fraction + 0.007 * p[:, 0],
                     height_mm=2 * height_mm, process=process)
    plan_job(part, profile, tmp_path / "a.lmj")
    with JobReader(tmp_path / "a.lmj") as job:
        check_program(job, profile)


def test_a_part_is_put_where_its_file_says(tmp_path, make_part, shapes, profile):
    part = make_part(shapes["annulus"], lambda p: 0.5, placement_mm=(80.0, 90.0, 5.0))
    manifest = plan_job(part, profile, tmp_path / "a.lmj")
    _, layers = layers_of(tmp_path / "a.lmj")
    row = layers[0].lines[layers[0].lines["kind"] == LineKind.BEAD]
    assert (row["x_mm"].min() + row["x_mm"].max()) / 2 == pytest.approx(80, abs=0.02)
    assert layers[0].z_mm == pytest.approx(5.8)
    assert manifest.bounds_mm[1][2] >= 5 + 1.6 + profile.motion.clearance_mm


def test_equal_input_is_an_equal_job(tmp_path, make_part, shapes, profile):
    part = make_part(shapes["islands"], lambda p: 0.5 + 0.01 * p[:, 0])
    for name in ("a.lmj", "b.lmj"):
        plan_job(part, profile, tmp_path / name)
    assert (tmp_path / "a.lmj").read_bytes() == (tmp_path / "b.lmj").read_bytes()


def test_progress_and_an_interruption(tmp_path, make_part, shapes, profile):
    part = make_part(shapes["annulus"], lambda p: 0.5, height_mm=3.2)
    seen = []
    plan_job(part, profile, tmp_path / "a.lmj", lambda done, total: seen.append((done, total)))
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]
    before = (tmp_path / "a.lmj").read_bytes()

    def stop(done, total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        plan_job(part, profile, tmp_path / "a.lmj", stop)
    assert os.listdir(tmp_path) == ["a.lmj"]
    assert (tmp_path / "a.lmj").read_bytes() == before


def test_layers_without_anything_to_lay_below_and_above_are_left_out(
        tmp_path, make_part, shapes, profile):
    """A spindle whose ends are thinner than a bead is set down on its first real layer."""
    def outline(z):
        radius = 0.5 if z < 1.7 or z > 6.3 else 6.0
        return [shapes["disc"][0] * radius / 10]

    part = make_part(outline, lambda p: 0.5, height_mm=8.0)
    with pytest.raises(PlanError, match="not the whole part"):
        plan_job(part, profile, tmp_path / "a.lmj")
    manifest = plan_job(part, profile, tmp_path / "a.lmj", options=PlanOptions(
        allow_incomplete=True, allow_overhang=True))
    assert not manifest.totals["complete"]
    assert any("planned with --allow-incomplete" in text for text in manifest.totals["warnings"])
    _, layers = layers_of(tmp_path / "a.lmj")
    assert [layer.z_mm for layer in layers] == pytest.approx(0.8 * np.arange(1, 7))
    assert any("lowest 1.6 mm" in text for text in manifest.totals["warnings"])


def leaning(make_part, shapes, degrees):
    """A disc that grows with height, its wall leaning out by so much."""
    lean = np.tan(np.radians(degrees))
    return make_part(
        lambda z: [shapes["disc"][0] * (0.6 + 0.1 * lean * z)], lambda p: 0.5, height_mm=4.0)


def test_overhang_is_warned_of_and_beyond_the_limit_refused(
        tmp_path, make_part, shapes, profile):
    job = tmp_path / "a.lmj"
    manifest = plan_job(leaning(make_part, shapes, 38), profile, job)
    assert any("overhang" in text for text in manifest.totals["warnings"])
    assert not any("overhang" in text for text in plan_job(
        leaning(make_part, shapes, 10), profile, job).totals["warnings"])
    steep = leaning(make_part, shapes, 55)
    with pytest.raises(PlanError, match="lean out by more than 45°"):
        plan_job(steep, profile, job)
    manifest = plan_job(steep, profile, job, options=PlanOptions(allow_overhang=True))
    assert any("planned with --allow-overhang" in text for text in manifest.totals["warnings"])
    assert any("overhang" in text for text in manifest.totals["warnings"])


def test_layers_can_be_planned_alone_for_looking(tmp_path, make_part, shapes, profile):
    """At their own height and with their own seams; no machine takes such a job."""
    part = make_part(shapes["disc"], lambda p: 0.5, height_mm=8.0)
    plan_job(part, profile, tmp_path / "all.lmj")
    seen = []
    excerpt = plan_job(part, profile, tmp_path / "some.lmj", lambda *n: seen.append(n),
                       PlanOptions(layers=(3, 5)))
    assert excerpt.excerpt == (3, 5)
    assert seen == [(1, 3), (2, 3), (3, 3)]
    _, every = layers_of(tmp_path / "all.lmj")
    _, some = layers_of(tmp_path / "some.lmj")
    for one, same in zip(some, every[2:5], strict=True):
        assert one.z_mm == same.z_mm
        beads, others = (layer.lines[layer.lines["kind"] == LineKind.BEAD] for layer in (one, same))
        # In another order perhaps: the nozzle comes from elsewhere.
        assert np.sort(beads["x_mm"]) == pytest.approx(np.sort(others["x_mm"]), abs=2e-3)
    with pytest.raises(JobError, match="layers 3 to 5 of the part only"):
        check_job(excerpt, profile)
    with pytest.raises(PlanError, match="no layer 99"):
        plan_job(part, profile, tmp_path / "none.lmj", options=PlanOptions(layers=(99, 99)))


def test_layers_without_tracks_in_the_middle(tmp_path, make_part, shapes, profile):
    """Two discs with nothing between them: said, and each layer has its place in the job."""
    part = make_part(
        lambda z: [shapes["disc"][0] * (0.005 if 3.2 < z < 4.8 else 1.0)], lambda p: 0.5,
        height_mm=8.0)
    manifest = plan_job(part, profile, tmp_path / "a.lmj", options=PlanOptions(
        allow_incomplete=True, allow_overhang=True))
    assert [entry.n_paths > 0 for entry in manifest.layers] == [True] * 4 + [False] * 2 + [True] * 4
    assert any("2 layers have no tracks" in text for text in manifest.totals["warnings"])
    with JobReader(tmp_path / "a.lmj") as job:
        check_program(job, profile)


@pytest.mark.parametrize(("process", "message"), [
    (ProcessSettings(layer_height_mm=12.0), "all hoppers together"),
    (ProcessSettings(layer_height_mm=0.01), "least flow is more than any mixture"),
])
def test_what_no_geometry_can_change_is_found_before_any(
        tmp_path, make_part, shapes, profile, process, message, monkeypatch):
    part = make_part(shapes["disc"], lambda p: 0.5, height_mm=2 * process.layer_height_mm,
                     process=process)
    monkeypatch.setattr(type(part), "section", lambda self, z_mm: pytest.fail("geometry was made"))
    with pytest.raises(PlanError, match=message) as caught:
        plan_job(part, profile, tmp_path / "a.lmj")
    said = re.search(r"speed_mm_s to at (?:most|least) ([\d.]+),", caught.value.hint)
    reported = tuple(replace(m, speed_mm_s=float(said[1])) for m in part.materials)
    recipe_of(replace(part, materials=reported), profile, process.layer_height_mm)


def test_less_powder_than_a_hopper_meters_is_warned_of(tmp_path, make_part, shapes, profile):
    part = make_part(shapes["annulus"], lambda p: 0.02)
    manifest = plan_job(part, profile, tmp_path / "a.lmj")
    assert any("less of a powder" in text for text in manifest.totals["warnings"])


def test_the_papers_strategy_gives_each_contour_one_mixture(tmp_path, make_part, shapes, profile):
    part = make_part(shapes["rectangle"], lambda p: 0.5 + 0.02 * p[:, 0],
                     process=ProcessSettings(strategy="iso-3d"))
    plan_job(part, profile, tmp_path / "a.lmj", options=PlanOptions(allow_incomplete=True))
    _, layers = layers_of(tmp_path / "a.lmj")
    row = layers[0].lines[layers[0].lines["kind"] == LineKind.BEAD]
    for path in np.unique(row["path"]):
        assert np.ptp(row["fractions"][row["path"] == path], axis=0).max() == 0


def test_a_mixture_that_changes_faster_than_powder_can_is_slowed_down(
        tmp_path, make_part, shapes, profile):
    """From 20 % to 80 % and back within 19 mm: half the pace helps, and is said."""
    def steep(points):
        return 0.5 + 0.3 * np.sin(points[:, 0] / 6)

    part = make_part(shapes["rectangle"], steep)
    slow = plan_job(part, profile, tmp_path / "a.lmj")
    text = " ".join(finding["text"] for finding in slow.verdict)
    assert "slowed to" in text
    fixed = plan_job(make_part(shapes["rectangle"], steep, process=ProcessSettings(powder="none")),
                     profile, tmp_path / "b.lmj")
    assert fixed.totals["mixture_share"] < 0.5
    assert slow.totals["mixture_share"] > 0.9
    assert slow.totals["laser_on_s"] > 1.1 * fixed.totals["laser_on_s"]


def test_lead_in_puts_the_bead_at_full_speed(tmp_path, make_part, shapes, profile):
    """On round tracks: of different mixtures, so that no bridges with corners link them."""
    part = make_part(shapes["annulus"], lambda p: (np.hypot(p[:, 0], p[:, 1]) - 9) / 6)
    plan_job(part, profile, tmp_path / "a.lmj")
    _, layers = layers_of(tmp_path / "a.lmj")
    row = layers[0].lines
    duration = np.diff(row["end_s"], prepend=0)
    place = np.column_stack([row["x_mm"], row["y_mm"], row["z_mm"]])
    way = np.linalg.norm(np.diff(place, axis=0, prepend=place[:1]), axis=1)
    bead = row["kind"] == LineKind.BEAD
    assert (way / np.maximum(duration, 1e-9))[bead] == pytest.approx(
        row["speed_mm_s"][bead], rel=0.01)


def test_without_lead_in_it_still_plans(tmp_path, make_part, shapes, profile):
    part = make_part(shapes["annulus"], lambda p: 0.5, process=ProcessSettings(lead_in_mm=0))
    manifest = plan_job(part, profile, tmp_path / "a.lmj")
    assert manifest.totals["contours"] > 0


def test_other_horizons(tmp_path, make_part, shapes, profile):
    short = profile.model_copy(
        update={"motion": profile.motion.model_copy(update={"send_horizon_s": 0.2})})
    part = make_part(shapes["annulus"], lambda p: 0.5)
    manifest = plan_job(part, short, tmp_path / "a.lmj")
    assert manifest.totals["longest_line_s"] <= 0.05 + 1e-9


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"outline": "thin"}, "nothing as wide as half a bead"),
        ({"height_mm": 0.3}, "not more than half a layer"),
        ({"placement_mm": (290.0, 150.0, 0.0)}, "outside the travel"),
        ({"process": ProcessSettings(layer_height_mm=8.0), "height_mm": 16.0}, "at most 60"),
    ],
)
def test_what_cannot_be_planned_is_refused_whole(
        tmp_path, make_part, shapes, profile, change, reason):
    if change.get("outline") == "thin":
        change = {"outline": [shapes["disc"][0] * 0.05]}
    part = replace(make_part(shapes["annulus"], lambda p: 0.5), **change)
    with pytest.raises(PlanError, match=reason) as caught:
        plan_job(part, profile, tmp_path / "a.lmj")
    assert caught.value.hint
    assert os.listdir(tmp_path) == []


def test_a_lead_in_beyond_the_bed_is_refused_at_its_layer(tmp_path, make_part, shapes, profile):
    """The wall ends at the bed's edge, and its track points over it."""
    part = make_part(shapes["wall 1.0"], lambda p: 0.5, placement_mm=(20.0, 50.0, 0.0),
                     process=ProcessSettings(lead_in_mm=5), height_mm=8.0)
    done = []
    with pytest.raises(PlanError, match="layer 1 of prism reaches outside") as caught:
        plan_job(part, profile, tmp_path / "a.lmj", lambda layer, _: done.append(layer))
    assert not done
    assert "x: reaches -" in caught.value.where[0]
    assert "lead_in_mm" in caught.value.hint


def test_a_second_hopper_of_a_material_is_said_to_be_idle(tmp_path, make_part, shapes, profile):
    second = profile.hopper[0].model_copy(update={"name": "C", "channel": 2})
    cell = profile.model_copy(update={"hopper": (*profile.hopper, second)})
    part = make_part(shapes["small disc"], lambda p: 0.0)
    reported = [finding["text"] for finding in plan_job(part, cell, tmp_path / "a.lmj").verdict]
    assert any("hopper C holds 316L too, and is not used" in text for text in reported)
    thick = make_part(shapes["annulus"], lambda p: 0.0, height_mm=16.0,
                      process=ProcessSettings(layer_height_mm=8.0))
    with pytest.raises(PlanError, match="at most 60") as caught:
        plan_job(thick, cell, tmp_path / "b.lmj")
    assert "hopper C holds 316L too" in caught.value.render()


def test_a_tall_part_takes_no_more_memory_than_a_low_one(tmp_path, make_part, shapes, profile):
    def peak(layers):
        part = make_part(shapes["annulus"], lambda p: 0.5 + 0.01 * p[:, 0], height_mm=0.8 * layers)
        tracemalloc.start()
        plan_job(part, profile, tmp_path / "a.lmj")
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    peak(1)  # compiled kernels are loaded once
    assert peak(36) < 1.3 * peak(9)  # the margins keep some layers, up to a bound
