"""Dilution made up for: δ of energy, the mixtures to feed, and what is said where it cannot be."""

from __future__ import annotations

import numpy as np
import pytest

from lmctl.config.dilution import DilutionSettings
from lmctl.config.part_file import ProcessSettings
from lmctl.config.substrate import SubstrateSettings
from lmctl.job.schema import LineKind
from lmctl.part.materials.powders import MaterialSpec
from lmctl.plan.dilution import DilutionCompensation, dilution_law
from lmctl.plan.dilution.fed_mixtures import projected_to_mixtures
from lmctl.plan.geometry import LayerFigures, LayerGeometry
from lmctl.plan.planner import PlanOptions, plan_job
from lmctl.plan.recipe import make_recipe
from tests.plan.planned_jobs import layers_of

THREE = tuple(MaterialSpec(name, density, None, catch, power, 10.0, ()) for name, density, catch,
              power in (("316L", 0.008, 0.7, 1500.0), ("Ni", 0.0089, 0.7, 1600.0),
                        ("WC", 0.0156, 0.5, 1800.0)))
PLACES = np.column_stack([np.arange(5.0), np.zeros(5)])


def stated(share, energy=None, half=None, material=None):
    ends = {} if half is None else {"low": share - half, "high": share + half}
    return DilutionSettings(share=share, energy_J_mm=energy, material=material, **ends)


def law_of(share, names=("316L", "WC-12Co")):
    law = dilution_law([stated(share)], names)
    assert law is not None
    return law


def column(layers, below=None, materials=2):
    """Geometry of layers one above the other, of mixtures (layers, 5, materials)."""
    for number, fractions in enumerate(layers):
        yield LayerGeometry(
            layer=number, z_mm=0.8 * number + 0.4, points_mm=PLACES, starts=np.array([0, 5]),
            strip_width_mm=np.full(5, 1.334), fractions=np.asarray(fractions, dtype=float),
            is_closed=np.zeros(1, dtype=bool), island=np.zeros(1, dtype=np.intp),
            outline_mm=np.empty((0, 2)), outline_starts=np.zeros(1, dtype=np.intp),
            figures=LayerFigures(1, 1, 0, 0, 1),
            fractions_below=None if number == 0 else np.asarray(layers[number - 1], dtype=float))


def fed_and_laid(compensation, layers):
    """The mixtures fed, and those laid by the recursion itself with δ as the law has it."""
    fed, laid = [], []
    for number, geometry in enumerate(column(layers)):
        found = compensation.compensated(geometry, number)
        fed.append(found.geometry.fractions)
        laid.append(found.deviation + np.column_stack([geometry.fractions, np.zeros(5)]))
    return np.array(fed), np.array(laid)


def test_a_line_through_measurements_is_found_with_its_interval():
    energies = np.array([100.0, 150.0, 200.0])
    law = dilution_law([stated(0.1 + 0.001 * e, e, 0.02, "316L") for e in energies], ["316L"])
    at = np.array([100.0, 150.0, 180.0, 260.0])
    found = law.along(np.ones((4, 1)), at)
    assert found.share == pytest.approx([0.2, 0.25, 0.28, 0.3])  # not carried on
    assert found.outside.tolist() == [False, False, False, True]
    # oracle: variance of a fitted line of three points of equal error
    for place, width in zip(at[:3], (found.high - found.low)[:3], strict=True):
        expected = 0.02 * np.sqrt(1 / 3 + (place - 150) ** 2 / 5000)
        assert width / 2 == pytest.approx(expected, rel=1e-6)


def test_a_mixture_lies_between_its_powders_and_an_untested_one_takes_their_mean():
    law = dilution_law([stated(0.1, 150, material="A"), stated(0.3, 150, material="B")], "ABC")
    shares = law.along(np.vstack([np.eye(3), [0.5, 0.5, 0]]), np.full(4, 150.0)).share
    assert shares == pytest.approx([0.1, 0.3, 0.2, 0.2])
    assert dilution_law([], "AB") is None
    assert dilution_law([stated(0.1, material="D")], "AB") is None


def test_a_ramp_is_deposited_as_designed_up_to_where_powder_is_pure(profile, materials):
    """Ten layers from 0.1 to 1 at 20 %: the last would need 1.025 of the second powder."""
    recipe = make_recipe(materials, ProcessSettings(), profile)
    ramp = [np.tile([1 - c, c], (5, 1)) for c in np.arange(1, 11) / 10]
    fed, laid = fed_and_laid(
        DilutionCompensation(law_of(0.2), recipe, np.array([1.0, 0, 0])), ramp)
    assert fed[:, 0, 1] == pytest.approx([0.125, *np.arange(0.225, 1.0, 0.1), 1.0])
    assert laid[:, 0, 1] == pytest.approx([*np.arange(0.1, 1.0, 0.1), 0.98])


def test_what_could_not_be_fed_is_made_up_for_in_the_next_layer(profile):
    """Against the recursion of deposits alone, place by place, for three powders and a substrate
    of none of them."""
    recipe = make_recipe(THREE, ProcessSettings(), profile.model_copy(update={"hopper": tuple(
        profile.hopper[0].model_copy(update={"name": m.name, "material": m.name, "channel": n})
        for n, m in enumerate(THREE, 1))}))
    random = np.random.default_rng(4)
    layers = random.dirichlet(np.ones(3), (6, 5))
    share, alloy = 0.35, np.array([0, 0, 0, 1.0])
    fed, laid = fed_and_laid(
        DilutionCompensation(law_of(share, [m.name for m in THREE]), recipe, alloy), layers)
    below = np.tile(alloy, (5, 1))
    for number in range(6):
        deposit = (1 - share) * np.column_stack([fed[number], np.zeros(5)]) + share * below
        assert laid[number] == pytest.approx(deposit, abs=1e-9)
        wanted = (np.column_stack([layers[number], np.zeros(5)]) - share * below) / (1 - share)
        possible = (wanted[:, :3] >= 0).all(axis=1) & (np.abs(wanted[:, 3]) < 1e-12)
        assert fed[number][possible] == pytest.approx(wanted[possible][:, :3], abs=1e-9)
        assert fed[number].sum(axis=1) == pytest.approx(1.0)
        below = deposit
    assert np.abs(laid[0, :, 3]) == pytest.approx(share)
    assert np.abs(laid[5, :, 3]) == pytest.approx(share**6)


def test_the_nearest_mixture_is_nearer_than_any_other():
    random = np.random.default_rng(1)
    wanted = random.normal(0.33, 0.5, (40, 3))
    found = projected_to_mixtures(wanted)
    others = random.dirichlet(np.ones(3) / 2, 4000)
    assert found.min() >= 0
    assert found.sum(axis=1) == pytest.approx(1.0)
    least = ((others[None] - wanted[:, None]) ** 2).sum(axis=2).min(axis=1)
    assert (((found - wanted) ** 2).sum(axis=1) <= least + 1e-12).all()


def test_a_layer_of_more_power_melts_what_was_measured_at_that_energy(profile, materials):
    recipe = make_recipe(materials, ProcessSettings(), profile)
    energy = float(recipe.power(np.eye(2))[0] / recipe.speed(np.eye(2))[0])
    names = [material.name for material in materials]
    law = dilution_law(
        [stated(0.2 * e, energy * e, material=name) for e in (0.5, 1, 2) for name in names], names)
    layers = [np.tile([0.8, 0.2], (5, 1))] * 3

    def shares(factor):
        compensation = DilutionCompensation(law, recipe, np.array([0, 0, 1.0]), factor)
        return np.array([compensation.compensated(one, number).along.share[0]
                         for number, one in enumerate(column(layers))])

    usual, strong = shares(lambda number: 1.0), shares(lambda number: 1.25 if number == 0 else 0.9)
    assert strong / usual == pytest.approx([1.25, 0.9, 0.9], rel=0.02)


def test_a_first_layer_on_an_unknown_alloy_is_fed_as_designed(profile, materials):
    recipe = make_recipe(materials, ProcessSettings(), profile)
    compensation = DilutionCompensation(law_of(0.2), recipe, None)
    first, second = column([np.tile([0.5, 0.5], (5, 1)), np.tile([0.4, 0.6], (5, 1))])
    assert compensation.compensated(first, 0) is None
    found = compensation.compensated(second, 1)
    assert found is not None
    assert found.geometry.fractions[:, 1] == pytest.approx(0.625)


@pytest.fixture
def planned(tmp_path, make_part, shapes, profile):
    def plan(substrate="316L", mixture=lambda p: 0.5, share=0.2, **process):
        cell = profile if share is None else profile.model_copy(
            update={"dilution": (stated(share, half=0.02),)})
        part = make_part(shapes["rectangle"], mixture, height_mm=2.4,
                         substrate=SubstrateSettings(material=substrate),
                         process=ProcessSettings(**process))
        manifest = plan_job(part, cell, tmp_path / "a.lmj")
        return manifest, layers_of(tmp_path / "a.lmj")[1]
    return plan


def second_powder(layer):
    return layer.lines["fractions"][layer.lines["kind"] == LineKind.BEAD][:, 1]


def test_a_job_feeds_more_on_the_plate_and_states_what_the_bead_becomes(planned):
    manifest, layers = planned()
    fed = second_powder(layers[0])
    assert np.median(fed) == pytest.approx(0.62, abs=0.011)  # 0.625 in steps of 0.02
    assert fed.min() > 0.59  # between others, which it melts in place of the plate
    # here and there beads of the first melted each other: the next makes up for that
    assert second_powder(layers[1]) == pytest.approx(0.5, abs=0.025)
    assert np.median(second_powder(layers[1])) == pytest.approx(0.5, abs=0.011)
    beads = layers[0].lines["kind"] == LineKind.BEAD
    assert layers[0].lines["designed"][beads] == pytest.approx(0.5)
    first = manifest.mixtures[0]
    assert first.designed[1] == pytest.approx(0.5)
    assert first.planned[1] == pytest.approx(0.625, abs=0.011)
    assert first.predicted[1] == pytest.approx(0.5, abs=0.011)
    assert manifest.totals["mixture_share"] > 0.999
    said = manifest.totals["dilution"]
    assert (said["share"], said["low"], said["high"]) == (0.2, 0.18, 0.22)
    assert said["compensated_fraction"] == 1.0
    assert said["clipped"] == []
    assert any("dilution of 20.0% (18.0% to 22.0%)" in f["text"] for f in manifest.verdict)


def test_a_plan_says_that_every_other_track_comes_first(planned):
    said = "every other track of the first layer comes first"
    every_other, _ = planned(first_layer_order="every-other")
    in_turn, _ = planned()
    assert any(said in finding["text"] for finding in every_other.verdict)
    assert not any(said in finding["text"] for finding in in_turn.verdict)
    assert every_other.totals["mixture_share"] > 0.99


def test_flow_in_a_compensated_layer_deposits_the_volume_of_the_part(planned, materials):
    manifest, _ = planned()
    caught = manifest.totals["powder_in_part_g"]
    volume = sum(caught[m.name] / m.density_g_mm3 for m in materials)
    assert volume == pytest.approx(30 * 17 * 2.4, rel=0.01)


def test_without_a_known_dilution_or_where_it_is_ignored_nothing_changes(planned):
    plain, layers = planned(share=None)
    ignored, same = planned(dilution="ignore")
    for one, other in zip(layers, same, strict=True):
        assert one.program == other.program
        assert (one.flow_g_s == other.flow_g_s).all()
    assert "dilution" not in plain.totals
    assert "dilution" not in ignored.totals


def test_places_that_cannot_be_made_up_for_are_listed_with_share_and_error(planned):
    """More than 0.8 is wanted from x = -5 on, all of it from x = 5 on: pure powder deposits 0.8."""
    manifest, _ = planned(mixture=lambda p: 0.6 + 0.02 * (p[:, 0] + 15))
    said = manifest.totals["dilution"]
    (first, *rest) = said["clipped"]
    assert first["layer"] == 1
    assert first["material"] in ("316L", "WC-12Co")
    assert first["worst"] == pytest.approx(0.2, abs=0.03)
    assert first["at_mm"][0] > 4.9
    assert first["share"] == pytest.approx(20 / 30, abs=0.05)
    assert said["clipped_worst"] == first["worst"]
    assert any("cannot make up for dilution" in text for text in manifest.totals["warnings"])
    assert all(one["worst"] < first["worst"] for one in rest)


def test_a_plate_of_another_alloy_is_counted_as_what_it_is(planned):
    manifest, layers = planned(substrate="S235")
    assert second_powder(layers[0]) == pytest.approx(0.5, abs=0.011)  # nothing takes it out again
    (first, *_) = manifest.totals["dilution"]["clipped"]
    assert (first["material"], first["surplus"]) == ("substrate", True)
    assert first["worst"] == pytest.approx(0.2, abs=1e-3)
    # of a bead alone 0.8; one between others melts some of them in place of the plate
    assert 0.8 < sum(manifest.mixtures[0].predicted) < 0.82


def test_an_unknown_plate_is_said_to_be_unknown(planned):
    manifest, layers = planned(substrate=None)
    assert second_powder(layers[0]) == pytest.approx(0.5, abs=0.011)
    assert any("[substrate] material" in text for text in manifest.totals["warnings"])


def test_a_layer_without_tracks_between_others_breaks_nothing(tmp_path, make_part, profile):
    """A waist too narrow for a bead: its layer has a slice and no tracks."""
    def outline(z_mm):
        half = 0.3 if 0.8 < z_mm < 1.6 else 8.0
        return [np.array([[-half, -half], [half, -half], [half, half], [-half, half],
                          [-half, -half]])]

    part = make_part(outline, lambda p: 0.5, height_mm=2.4, turning_mm=(0.8, 1.6),
                     substrate=SubstrateSettings(material="316L"),
                     process=ProcessSettings(min_built_fraction=0.0))
    cell = profile.model_copy(update={"dilution": (stated(0.2),)})
    manifest = plan_job(part, cell, tmp_path / "a.lmj",
                        options=PlanOptions(allow_incomplete=True, allow_overhang=True))
    _, layers = layers_of(tmp_path / "a.lmj")
    assert len(layers) == 3
    assert not (layers[1].lines["kind"] == LineKind.BEAD).any()
    assert second_powder(layers[2]) == pytest.approx(0.5, abs=0.011)
    assert manifest.totals["dilution"]["compensated_fraction"] == 1.0
