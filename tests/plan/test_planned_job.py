"""A planned job of a small prism: text, table, places, mixture and powder agree with each other."""


import numpy as np
import pytest

from lmctl.job.schema import LineKind
from lmctl.plan.planner import plan_job
from lmctl.preflight.job_check import check_job
from tests.plan.planned_jobs import layers_of, walk


@pytest.fixture
def planned(tmp_path, make_part, shapes, profile):
    """A graded rectangle, two layers."""
    part = make_part(shapes["rectangle"], lambda p: 0.2 + 0.6 * (p[:, 0] + 15) / 30)
    manifest = plan_job(part, profile, tmp_path / "a.lmj")
    return manifest, layers_of(tmp_path / "a.lmj")[1], part


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
        of_part = 0.2 + 0.6 * (local + 15) / 30
        assert row["fractions"][:, 1] == pytest.approx(of_part, abs=0.02)
        assert row["designed"][:, 1] == pytest.approx(of_part, abs=1e-3)  # of places to 0.01 mm
        assert row["designed"].sum(axis=1) == pytest.approx(1.0, abs=1e-6)
        assert not layer.lines["designed"][layer.lines["kind"] != LineKind.BEAD].any()
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


def test_the_job_is_one_the_machine_takes(planned, profile):
    check_job(planned[0], profile)
