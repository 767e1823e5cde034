"""Margins of a plan: shares within intervals against arithmetic by hand, volumes against beads that
lie side by side."""

import re
from dataclasses import replace

import numpy as np
import pytest

from lmctl.config.machine import HopperSettings
from lmctl.config.measuring import CalibrationUse, HopperIntervals
from lmctl.job.margins_text import margins_text
from lmctl.plan.margins.bead_volume import LayerVolume, resolvable_per_mm
from lmctl.plan.margins.cell_parameters import cell_parameters, cell_values
from lmctl.plan.margins.path_shares import PathShares
from lmctl.plan.margins.poured_beads import HEIGHTS, poured_beads
from lmctl.plan.margins.worst_case import worst_case
from lmctl.plan.melted_below import MeltedBelow
from lmctl.plan.mixture_catch import MixtureCatch
from lmctl.plan.planner import plan_job
from lmctl.plan.sequence.bead_pieces import BeadPieces
from lmctl.plan.sequence.held_setpoints import SetpointChanges
from lmctl.plan.sequence.mixture_prediction import MixturePrediction
from lmctl.plan.sequence.nozzle_flow import CellValues, nozzle_flow_g_s
from lmctl.plan.sequence.sampled_layers import SampledLayers

HOPPERS = tuple(
    HopperSettings(name=name, feeder="F", material=name, dead_time_s=dead, lag_s=lag,
                   max_flow_g_min=60)
    for name, dead, lag in (("A", 3.0, 1.0), ("B", 2.6, 0.8)))
DENSITY = np.array([0.008, 0.008])
CATCH = np.array([0.7, 0.7])
BELIEVED = CellValues.believed(HOPPERS, CATCH)


def path_of(at_s, designed, place_mm=None, direction=None):
    """Pieces of a millimetre each."""
    q = len(at_s)
    across = np.zeros((q, 2)) if place_mm is None else place_mm
    along = np.tile([1.0, 0.0], (q, 1)) if direction is None else direction
    return BeadPieces(0, 0.4, at_s, np.full(q, 0.1), across, along, np.ones(q), np.full(q, 2.0),
                      designed, designed, designed)


def steady_half_and_half(q=100):
    changes = SetpointChanges(np.array([-60.0]), np.array([[6.0, 6.0]]))
    return MixturePrediction(path_of(np.arange(q) * 0.1, np.full((q, 2), 0.5)),
                             np.full((q, 2), 0.5), changes)


def range_within(prediction, intervals, tolerance=0.02):
    parameters = cell_parameters(HOPPERS, CATCH, intervals)
    known = [intervals.get(hopper.name) for hopper in HOPPERS]
    return worst_case(
        PathShares([prediction], DENSITY, tolerance), parameters,
        lambda levels: cell_values(
            BELIEVED, parameters, [one.at(k) for one, k in zip(parameters, levels, strict=True)],
            known))


def test_catches_that_are_both_off_are_worse_than_each_alone():
    """0.7·1.042 against 0.7·0.958 makes 0.521; one of them alone 0.5104 at most."""
    off = HopperIntervals(catch_efficiency=(0.7 * 0.958, 0.7 * 1.042))
    found = range_within(steady_half_and_half(), {"A": off, "B": off})
    assert found.planned == 1.0
    assert found.worst == 0.0
    assert set(found.at_worst) == {-1, 1}
    assert [one.share for one in found.alone] == [1.0, 1.0]
    assert [one.share for one in found.without] == [1.0, 1.0]


def test_slopes_and_catches_that_make_up_for_each_other_are_no_worst_case():
    """Both slopes higher by the same changes no mixture: the worst is one up and one down."""
    off = HopperIntervals(slope=(0.97, 1.03))
    found = range_within(steady_half_and_half(), {"A": off, "B": off}, tolerance=0.014)
    assert found.worst == 0.0
    assert sorted(found.at_worst) == [-1, 1]


def test_a_dilution_that_is_off_shifts_the_mixture_by_what_lies_below():
    """A bead of half and half on pure A: 0.05 more of A moves both shares by 0.05 · 0.625."""
    plain = steady_half_and_half()
    q = len(plain.pieces)
    below = np.tile([1.0, 0.0, 0.0], (q, 1))
    fed = np.tile([0.375, 0.625], (q, 1))  # of which 0.2 of A make half and half
    designed = np.tile([0.5, 0.5, 0.0], (q, 1))
    melted = MeltedBelow(designed, below, np.full(q, 0.2))
    pieces = replace(plain.pieces, fed=fed, designed=designed, melted=melted)
    changes = SetpointChanges(np.array([-60.0]), np.array([[4.5, 7.5]]))
    shares = PathShares([MixturePrediction(pieces, designed, changes)], DENSITY, 0.02)
    assert shares.errors(BELIEVED) == pytest.approx(0.0, abs=1e-9)
    off = shares.errors(replace(BELIEVED, dilution_off=0.05))
    assert off == pytest.approx(0.05 * 0.625, rel=1e-6)
    (parameter,) = cell_parameters((), CATCH, {}, 0.05)
    assert parameter.name == "dilution"
    assert parameter.deviation_text(1) == "0.050 higher"


def test_powders_that_change_each_others_catch_are_as_the_recipe_has_them():
    catch = MixtureCatch(CATCH, np.array([[0.0, 0.3], [0.3, 0.0]]))
    prediction = ramp()
    shares = PathShares([prediction], DENSITY, 0.02, mixture_catch=catch)
    flow = nozzle_flow_g_s(prediction.changes, BELIEVED, prediction.pieces.at_s)
    assert shares.volume_mm3_s(BELIEVED) == pytest.approx(
        flow * catch.efficiency(flow) / DENSITY, rel=1e-6)


def ramp(late_s=0.0):
    """A mixture that rises by 0.02 a second for 10 s; the powder of B comes so much late."""
    at_s = np.arange(0.05, 10.0, 0.1)
    ticks = np.arange(-40.0, 11.0, 0.1)
    b = np.clip(0.4 + 0.02 * (ticks + BELIEVED.dead_time_s[1] - late_s), 0.4, 0.6)
    a = np.clip(0.6 - 0.02 * (ticks + BELIEVED.dead_time_s[0]), 0.4, 0.6)
    designed = np.column_stack([0.6 - 0.02 * at_s, 0.4 + 0.02 * at_s])
    return MixturePrediction(path_of(at_s, designed), designed,
                             SetpointChanges(ticks, 20.0 * np.column_stack([a, b])))


def test_powder_that_comes_late_is_off_by_the_gradient_in_time():
    """Both hoppers 0.5 s late on a ramp of 0.02 a second: 0.01 off."""
    shares = PathShares([ramp()], DENSITY, 0.02)
    values = replace(BELIEVED, lag_s=np.zeros(2))
    late = replace(values, dead_time_s=values.dead_time_s + 0.5)
    middle = slice(20, 80)
    assert shares.errors(values)[middle] == pytest.approx(0.0, abs=2e-3)
    assert shares.errors(late)[middle] == pytest.approx(0.01, abs=2e-3)


def test_slope_offset_and_catch_are_as_in_the_nozzles_flow():
    """The shortcut by linearity against the flow computed with these very values."""
    prediction = ramp()
    changes = replace(prediction.changes, setpoint_g_min=np.where(
        (prediction.changes.time_s > 4.0)[:, None] & [True, False], 0.0,
        prediction.changes.setpoint_g_min))
    prediction = replace(prediction, changes=changes)
    values = CellValues(np.array([3.1, 2.4]), np.array([0.9, 0.7]), np.array([0.0, 0.2]),
                          np.array([1.03, 0.98]), np.array([0.1, -0.2]), np.array([0.75, 0.6]))
    flow = nozzle_flow_g_s(changes, values, prediction.pieces.at_s)
    volume = flow * values.catch_efficiency / DENSITY
    shares = PathShares([prediction], DENSITY, 0.02)
    assert shares.volume_mm3_s(values) == pytest.approx(volume, rel=1e-6, abs=1e-9)
    every_third = PathShares([prediction], DENSITY, 0.02, 3)
    assert every_third.errors(values) == pytest.approx(shares.errors(values)[::3], abs=1e-9)


def test_dead_time_and_lag_together_stay_within_the_response():
    known = HopperIntervals(dead_time_s=(2.8, 3.2), lag_s=(0.8, 1.2), response_s=(3.95, 4.05))
    parameters = cell_parameters(HOPPERS[:1], CATCH[:1], {"A": known})
    for values in ((3.2, 1.2), (2.8, 0.8), (3.2, 0.8)):
        found = cell_values(CellValues.believed(HOPPERS[:1], CATCH[:1]), parameters, values,
                              [known])
        whole = found.dead_time_s[0] + found.lag_s[0]
        assert 3.95 - 1e-9 <= whole <= 4.05 + 1e-9
        assert found.lag_s[0] == values[1]


def test_a_drive_lag_is_a_part_of_the_response():
    """Mean delay and spread of the response stay: delays add up, and so do squares of lags."""
    known = HopperIntervals(dead_time_s=(3.0, 3.0), lag_s=(1.0, 1.0), drive_lag_s=(0.4, 0.6))
    parameters = cell_parameters(HOPPERS[:1], CATCH[:1], {"A": known})
    found = cell_values(CellValues.believed(HOPPERS[:1], CATCH[:1]), parameters,
                          [one.planned for one in parameters], [known])
    assert found.drive_lag_s[0] == pytest.approx(0.5)
    assert found.dead_time_s[0] + found.lag_s[0] + found.drive_lag_s[0] == pytest.approx(4.0)
    assert found.lag_s[0] ** 2 + found.drive_lag_s[0] ** 2 == pytest.approx(1.0)


def beads_side_by_side(gradient_per_mm, pitch_mm=1.334):
    """Ten straight beads, each of the mixture at its middle; the design changes across them."""
    step_mm, length_mm = 0.25, 20.0
    x = np.arange(step_mm / 2, length_mm, step_mm)
    y = pitch_mm * np.arange(10)
    place = np.array([(a, b) for b in y for a in x])

    def composition(points):
        second = 0.3 + gradient_per_mm * points[:, 1] / 1.0
        return np.column_stack([1 - second, second])

    pieces = path_of(np.arange(len(place)) * 0.025, composition(np.column_stack(
        [place, np.zeros(len(place))])), place)
    pieces = replace(pieces, length_mm=np.full(len(place), step_mm))
    return LayerVolume(pieces, pitch_mm / 2.0, 0.8, composition)


def within(layer, tolerance=0.03):
    errors, volume = layer.errors(layer.as_designed())
    return float(volume[errors <= tolerance].sum() / volume.sum())


@pytest.mark.parametrize("pitch_mm", [1.334, 1.2])
def test_beads_carry_gentle_gradients_and_no_steep_ones(pitch_mm):
    """Alone up to p − b/2 beside its middle, a bead of one mixture is off by the gradient there."""
    limit = resolvable_per_mm(2.0, pitch_mm, 0.03)
    assert limit == pytest.approx({1.334: 0.0898, 1.2: 0.15}[pitch_mm], rel=1e-3)
    shares = [within(beads_side_by_side(factor * limit, pitch_mm)) for factor in (0.2, 0.5, 1, 2)]
    assert shares == sorted(shares, reverse=True)
    assert shares[0] > 0.99
    assert shares[2] < 0.7


def straight_beads(y_mm, cell_mm=0.125):
    """Beads along x at these places: volume (cells across, beads) of a slice, and mm² per cell."""
    x = np.arange(0.125, 10.0, 0.25)
    place = np.array([(a, b) for b in y_mm for a in x])
    q = len(place)
    pieces = replace(path_of(np.arange(q) * 0.025, np.full((q, 2), 0.5), place),
                     length_mm=np.full(q, 0.25))
    volume = np.full(q, 0.25 * 1.334 * 0.8)
    low = np.array([-2.0, min(y_mm) - 2.0])
    shape = (int(14 / cell_mm), int((max(y_mm) - min(y_mm) + 4) / cell_mm))
    poured, in_strip = poured_beads(pieces, volume, 0.667, 0.8, low, cell_mm, shape)
    assert np.bincount(poured.piece, poured.share) == pytest.approx(np.ones(q))
    bead = np.repeat(np.eye(len(y_mm)), len(x), axis=0)
    by_bead = poured.volume_mm3(volume[:, None] * bead)
    across = by_bead.reshape(*shape, HEIGHTS, -1).sum(axis=(0, 2))
    return low[1] + (np.arange(shape[1]) + 0.5) * cell_mm, across, in_strip


def test_a_bead_alone_is_a_parabola_of_its_width():
    y, across, _ = straight_beads([0.0])
    across = across[:, 0]
    expected = np.clip(1.0 - y**2, 0.0, None)
    assert across / across.sum() == pytest.approx(expected / expected.sum(), abs=0.006)


def test_a_bead_beside_another_fills_the_valley_and_lies_on_the_open_side():
    y, across, _ = straight_beads([0.0, 1.334])
    first, second = across.T
    assert first.sum() == pytest.approx(second.sum())
    assert (first @ y) / first.sum() == pytest.approx(0.0, abs=0.02)
    assert 1.334 + 0.03 < (second @ y) / second.sum() < 1.334 + 0.3
    valley = np.abs(y - 0.667) < 0.2
    height = across.sum(axis=1) / (10.0 * 0.125)
    assert height[valley].min() > 0.52  # the first bead alone leaves 0.24 to 0.6 mm there


def test_beads_that_reach_each_others_middle_have_no_limit():
    assert resolvable_per_mm(2.0, 1.0, 0.03) == np.inf


def test_layers_are_kept_evenly_within_a_bound():
    samples = SampledLayers(max_pieces=1000)
    for number in range(64):
        prediction = steady_half_and_half(100)
        samples.add(replace(prediction, pieces=replace(prediction.pieces, layer=number)))
    kept = [layer.pieces.layer for layer in samples.layers]
    assert 4 <= len(kept) <= 10
    assert len(set(np.diff(kept))) == 1
    assert 0 < kept[0] < kept[1]
    assert samples.seen == 64


INTERVALS = {
    name: HopperIntervals(
        dead_time_s=(dead - 0.1, dead + 0.1), lag_s=(lag - 0.1, lag + 0.1),
        response_s=(dead + lag - 0.06, dead + lag + 0.06), slope=(0.99, 1.01),
        offset_g_min=(-0.05, 0.05), catch_efficiency=(0.97 * catch, 1.03 * catch))
    for name, dead, lag, catch in (("A", 3.0, 1.0, 0.75), ("B", 2.6, 0.8, 0.55))}


def graded(make_part, height_mm=1.6):
    outline = [np.array([[0, 0], [30, 0], [30, 8], [0, 8], [0, 0.0]])]
    return make_part(outline, lambda points: 0.2 + 0.015 * points[:, 0], height_mm=height_mm)


def test_without_a_calibration_nothing_is_made_up(make_part, profile, tmp_path):
    manifest = plan_job(graded(make_part), profile, tmp_path / "part.lmj")
    margins = manifest.totals["margins"]
    assert list(margins["path"]) == list(margins["volume"]) == ["predicted"]
    assert margins["path"]["predicted"] == pytest.approx(manifest.totals["mixture_share"], abs=1e-4)
    assert margins["intervals_not_measured"] == ["A", "B"]
    (text,) = [one["text"] for one in manifest.verdict if "as predicted" in one["text"]]
    assert "intervals not measured of hoppers A, B" in text
    assert margins_text(manifest.totals).endswith("intervals not measured of hopper A, B")


def test_with_a_calibration_the_range_is_stated_and_what_it_hangs_on(
    make_part, profile, tmp_path
):
    use = CalibrationUse("0" * 64, {}, {}, INTERVALS)
    measured = profile.with_measured_values(profile.hopper, (), (), use)
    manifest = plan_job(graded(make_part), measured, tmp_path / "part.lmj")
    margins = manifest.totals["margins"]
    for found in (margins["path"], margins["volume"]):
        assert found["worst"] <= found["predicted"] <= found["best"]
    assert margins["path"]["worst"] < 0.5  # every value at its worst end shifts half of it
    assert margins["path"]["worst"] < margins["path_95_of_100"] <= margins["path"]["predicted"]
    assert margins["intervals_not_measured"] == []
    assert margins["most_sensitive_to"][0]["path"] <= margins["path"]["predicted"]
    assert margins["at_worst"]
    (text,) = [one["text"] for one in manifest.verdict if "as predicted" in one["text"]]
    assert "counts most is hopper" in text


def test_a_mixture_too_steep_for_its_beads_is_named_with_its_place(make_part, profile, tmp_path):
    outline = [np.array([[0, 0], [30, 0], [30, 8], [0, 8], [0, 0.0]])]
    steep = make_part(outline, lambda points: 0.1 + 0.7 * (points[:, 1] > 4.3))
    manifest = plan_job(steep, profile, tmp_path / "part.lmj")
    margins = manifest.totals["margins"]
    assert margins["volume_resolvable"] < 0.98
    (text,) = [one["text"] for one in manifest.verdict if "of the volume is off" in one["text"]]
    assert re.search(r"x [\d.]+, y 4\.?\d*, z", text)
    assert "a strip of 1.33 mm has one mixture across" in text
    assert "such beads carry 0.09 per mm at most" in text
