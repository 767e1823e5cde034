"""Whole jobs of small prisms: text, times, places and powder agree with each other."""

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

LINE = re.compile(
    r"N(?P<n>\d+) G1 X(?P<x>[-.\d]+) Y(?P<y>[-.\d]+)(?: Z(?P<z>[-.\d]+))?(?: F(?P<f>[.\d]+))?"
    r"(?: S(?P<s>[.\d]+))?")


def layers_of(path):
    with JobReader(path) as job:
        return job.manifest, list(job.iterate_layers())


@pytest.fixture
def planned(tmp_path, make_part, shapes, profile):
    """A graded rectangle, two layers."""
    part = make_part(shapes["rectangle"], lambda p: 0.2 + 0.6 * (p[:, 0] + 15) / 30)
    manifest = plan_job(part, profile, tmp_path / "a.lmj")
    return manifest, layers_of(tmp_path / "a.lmj")[1], part


def walk(layers):
    """Every line with what the controller makes of it: text, table row, modal z, feed, power."""
    z = feed = power = None
    for layer in layers:
        for text, row in zip(layer.program, layer.lines, strict=True):
            words = LINE.fullmatch(text)
            if words:
                z = words["z"] or z
                feed = words["f"] or feed
                power = words["s"] or power
            yield text, row, words, z, feed, power


def test_text_and_table_say_the_same(planned):
    manifest, layers, _ = planned
    for text, row, words, z, feed, power in walk(layers):
        kind = LineKind(row["kind"])
        if kind in (LineKind.SETUP, LineKind.DWELL):
            assert words is None
            continue
        assert (float(words["x"]), float(words["y"]), float(z)) == pytest.approx(
            (row["x_mm"], row["y_mm"], row["z_mm"]), abs=1e-9), text
        assert float(feed) / 60 == pytest.approx(row["speed_mm_s"], abs=1e-3)
        assert float(power) * manifest.max_power_W / manifest.s_max == pytest.approx(
            row["power_W"], abs=0.2)
        assert (float(power) > 0) == (kind == LineKind.BEAD)
        if kind != LineKind.BEAD:
            assert text.endswith(" S0")


def test_the_program_begins_and_ends_as_it_must(planned, profile):
    _, layers, _ = planned
    assert layers[0].program[:2] == ("N0 G21 G90 G94", "N1 M4 S0")
    last = layers[-1]
    assert last.program[-1].endswith(" M5")
    end = last.lines[-1]
    assert (end["x_mm"], end["y_mm"], end["z_mm"]) == profile.motion.purge_mm


def test_every_motion_moves_and_no_line_is_long(planned, profile):
    _, layers, _ = planned
    at = np.array(profile.motion.purge_mm)
    for layer in layers:
        duration = np.diff(layer.lines["end_s"], prepend=layer.flow_s[0])
        assert duration.max() <= profile.motion.send_horizon_s / 4 + 1e-9
        for row in layer.lines:
            to = np.array([row["x_mm"], row["y_mm"], row["z_mm"]])
            if row["kind"] not in (LineKind.SETUP, LineKind.DWELL):
                assert np.abs(to - at).max() >= 0.0005
            at = to


def test_totals_are_sums_of_what_is_in_the_job(planned):
    manifest, layers, _ = planned
    lines = np.concatenate([layer.lines for layer in layers])
    end = np.concatenate([[0.0], lines["end_s"]])
    bead = lines["kind"] == LineKind.BEAD
    places = np.column_stack([lines["x_mm"], lines["y_mm"], lines["z_mm"]])
    way = np.linalg.norm(np.diff(places, axis=0, prepend=places[:1]), axis=1)
    totals = manifest.totals
    assert totals["layers"] == len(layers) == 2
    assert totals["contours"] == lines["path"].max() + 1
    assert totals["lines"] == len(lines)
    assert totals["duration_s"] == pytest.approx(end[-1], abs=1e-3)
    assert totals["laser_on_s"] == pytest.approx(np.diff(end)[bead].sum(), abs=1e-2)
    assert totals["path_length_mm"] == pytest.approx(way[bead].sum(), rel=1e-3)
    grams = sum(
        np.trapezoid(layer.flow_g_s, layer.flow_s, axis=0) for layer in layers)
    assert list(totals["powder_g"].values()) == pytest.approx(grams, rel=1e-4)


def test_each_layer_states_its_mixture_as_designed_planned_and_predicted(planned):
    manifest, layers, _ = planned
    assert [one.layer for one in manifest.mixtures] == [0, 1]
    for one, layer in zip(manifest.mixtures, layers, strict=True):
        lines, bead = layer.lines, layer.lines["kind"] == LineKind.BEAD
        way = np.hypot(*(np.diff(lines[axis], prepend=lines[axis][0]) for axis in ("x_mm", "y_mm")))
        middle = (lines["fractions"][1:] + lines["fractions"][:-1])[bead[1:]] / 2
        mean = np.average(middle, axis=0, weights=way[bead])
        assert one.planned == pytest.approx(mean, abs=2e-3)
        assert one.designed == pytest.approx(one.planned, abs=0.01)
        assert one.predicted == pytest.approx(one.planned, abs=0.01)
        assert sum(one.designed) == pytest.approx(1.0, abs=1e-3)


def test_the_powder_that_is_caught_is_the_volume_of_the_part(planned, materials):
    manifest, _, _ = planned
    caught = manifest.totals["powder_in_part_g"]
    volume = sum(caught[m.name] / m.density_g_mm3 for m in materials)
    assert volume == pytest.approx(manifest.totals["deposited_volume_mm3"], rel=0.01)
    assert volume == pytest.approx(30 * 17 * 1.6, rel=0.01)


@pytest.mark.parametrize("name", ["wall 1.0", "wall 1.7", "wall 2.2", "gear"])
def test_what_is_drawn_is_deposited(tmp_path, make_part, shapes, profile, name):
    """Thin walls as well as wide ones: powder is that of the drawing's volume."""
    totals = plan_job(make_part(shapes[name], lambda p: 0.5), profile, tmp_path / "a.lmj").totals
    assert totals["filling"] == pytest.approx(1.0, abs=0.03)
    assert totals["deposited_volume_mm3"] == pytest.approx(
        totals["filling"] * totals["slice_volume_mm3"], rel=1e-4)


def test_the_energy_per_volume_is_the_recipes_at_every_strip_width(
        tmp_path, make_part, profile, recipe):
    """Along a wedge strips differ in width: speed follows, power and powder stay."""
    wedge = np.array([[0, 0], [40, -5], [40, 5], [0, 0.0]])
    plan_job(make_part([wedge], lambda p: 0.5), profile, tmp_path / "a.lmj")
    _, layers = layers_of(tmp_path / "a.lmj")
    speeds = []
    for layer in layers:
        lines = layer.lines
        bead = np.flatnonzero(lines["kind"] == LineKind.BEAD)
        middle_s = (lines["end_s"][bead - 1] + lines["end_s"][bead]) / 2
        flow = np.column_stack([
            np.interp(middle_s, layer.flow_s, layer.flow_g_s[:, m]) for m in (0, 1)])
        volume = (flow * recipe.catch_efficiency / recipe.density_g_mm3).sum(axis=1)
        asked = recipe.power(np.array([0.5, 0.5])) / (1.334 * 0.8 * 10)
        assert lines["power_W"][bead] / volume == pytest.approx(asked, rel=0.05)
        speeds.append(lines["speed_mm_s"][bead])
    assert np.ptp(np.concatenate(speeds)) > 2.0  # so there was something to follow


def test_the_mixture_is_the_fields(planned, profile):
    """Within a quantum at every vertex; and the nozzle is predicted to lay it."""
    manifest, layers, _ = planned
    for layer in layers:
        row = layer.lines[layer.lines["kind"] == LineKind.BEAD]
        local = row["x_mm"] - 150.0
        assert row["fractions"][:, 1] == pytest.approx(0.2 + 0.6 * (local + 15) / 30, abs=0.02)
    assert manifest.totals["mixture_share"] >= 0.99


def test_flow_goes_on_from_layer_to_layer_and_along_each_bead(planned, recipe):
    _, layers, _ = planned
    assert (layers[0].flow_g_s[-1] == layers[1].flow_g_s[0]).all()
    for layer in layers:
        bead = layer.lines["kind"] == LineKind.BEAD
        row = layer.lines[bead]
        flow = np.stack([np.interp(row["end_s"], layer.flow_s, layer.flow_g_s[:, m])
                         for m in (0, 1)], axis=1)
        off = np.abs(recipe.deposited_fractions(flow) - row["fractions"]).max(axis=1)
        assert off.max() < 0.02  # a quantum within a tenth of a millimetre is a jump to a hopper
        assert np.quantile(off, 0.97) < 2e-3


def test_ramps_keep_the_total_volume_even(planned, recipe):
    _, layers, _ = planned
    for layer in layers:
        volume = layer.flow_g_s * recipe.catch_efficiency / recipe.density_g_mm3
        assert volume.sum(axis=1) == pytest.approx(1.334 * 0.8 * 10, rel=1e-6)


def test_beads_lie_half_a_pitch_inside_and_layers_one_height_apart(planned, profile):
    _, layers, _ = planned
    assert [layer.z_mm for layer in layers] == pytest.approx([0.8, 1.6])
    for layer in layers:
        row = layer.lines[layer.lines["kind"] == LineKind.BEAD]
        assert np.unique(row["z_mm"]) == pytest.approx([layer.z_mm])
        assert np.ptp(row["x_mm"]) == pytest.approx(30 - 1.334, abs=0.02)
        assert (row["x_mm"].min() + row["x_mm"].max()) / 2 == pytest.approx(150, abs=0.02)


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
        ({"outline": "thin"}, "nothing as wide as a bead"),
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


def test_the_job_is_one_the_machine_takes(planned, profile):
    check_job(planned[0], profile)


def test_a_tall_part_takes_no_more_memory_than_a_low_one(tmp_path, make_part, shapes, profile):
    def peak(layers):
        part = make_part(shapes["annulus"], lambda p: 0.5 + 0.01 * p[:, 0], height_mm=0.8 * layers)
        tracemalloc.start()
        plan_job(part, profile, tmp_path / "a.lmj")
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    peak(1)  # compiled kernels are loaded once
    assert peak(12) < 1.3 * peak(3)
