"""A build against its design: what is known to be wrong with it is found, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from lmctl.as_built.comparison import compare_with_design, composition_error
from lmctl.config.substrate import SubstrateSettings
from lmctl.errors import InputError


def test_a_perfect_build_has_no_error(bar, job, perfect):
    found = compare_with_design(perfect, bar, job).summary
    assert found.design_mm3 == pytest.approx(1600.0, rel=1e-3)
    assert found.built_over_design == pytest.approx(1.0, rel=1e-3)
    assert found.missing_mm3 == pytest.approx(0.0, abs=2.0)
    assert found.surplus_mm3 == pytest.approx(0.0, abs=2.0)
    assert found.core_mm3 == pytest.approx(16 * 6 * 4, rel=0.01)
    assert found.core_void == 0.0
    assert found.height_mm == found.planned_height_mm == pytest.approx(8.0)
    for error in (found.by_volume, found.by_path):
        assert error.p99 == pytest.approx(0.0, abs=1e-6)
        assert error.within == {0.02: 1.0, 0.03: 1.0, 0.05: 1.0}
    assert [round(one.built_mm, 3) for one in found.layers] == pytest.approx(
        [round(one.planned_mm, 3) for one in found.layers])


def test_a_mixture_that_is_off_everywhere(bar, job, changed):
    def more_b(volumes):
        moved = np.minimum(0.04 * (volumes[0] + volumes[1]), volumes[0])
        volumes[0] -= moved
        volumes[1] += moved

    found = compare_with_design(changed(more_b), bar, job).summary.by_volume
    # 0.04 wherever there was so much of A: all but the last 0.8 mm of 20
    assert found.within[0.05] == 1.0
    assert found.within[0.03] == pytest.approx(0.03, abs=0.03)
    assert found.mean == pytest.approx(0.04 * 19.2 / 20 + 0.02 * 0.8 / 20, abs=1e-3)
    assert found.p95 == pytest.approx(0.04, abs=1e-6)


def test_substrate_in_the_first_layers_is_an_error(bar, job, changed):
    def diluted(volumes):
        volumes[2, 2:42, 2:22, 2:4] = 0.2 * volumes[:2, 2:42, 2:22, 2:4].sum(axis=0)
        volumes[:2, 2:42, 2:22, 2:4] *= 0.8

    found = compare_with_design(changed(diluted), bar, job).summary
    assert found.by_volume.within[0.05] == pytest.approx(1 - 1 / 8, abs=1e-3)
    assert found.built_over_design == pytest.approx(1.0, rel=1e-3)


def test_a_plate_of_a_powders_material_counts_as_it(bar, job, changed):
    def with_plate(volumes):  # 0.2 of plate where A should be 0.2 more
        taken = np.minimum(0.2 * volumes[:2, :, :, 2:].sum(axis=0), volumes[0, :, :, 2:])
        volumes[0, :, :, 2:] -= taken
        volumes[2, :, :, 2:] += taken

    built = changed(with_plate)
    assert compare_with_design(built, bar, job).summary.by_volume.within[0.05] < 0.1
    of_a = replace(built, plate_material="A")
    assert compare_with_design(of_a, bar, job).summary.by_volume.p99 == pytest.approx(0, abs=1e-6)


def test_missing_and_surplus_volume(bar, job, changed):
    def lower_and_wider(volumes):
        volumes[:, :, :, 16:18] = 0.0       # the last millimetre of height
        volumes[0, 2:42, 22:24, 2:16] = 0.125  # a millimetre beside it

    found = compare_with_design(changed(lower_and_wider), bar, job).summary
    assert found.missing_mm3 == pytest.approx(20 * 10 * 1, rel=0.02)
    assert found.surplus_mm3 == pytest.approx(20 * 1 * 7, rel=0.02)
    assert found.height_mm == pytest.approx(7.0)
    assert found.built_mm3 == pytest.approx(1600 - 200 + 140, rel=1e-3)


def test_a_void_in_the_core_and_one_at_the_surface(bar, job, changed):
    def hollow(volumes):
        volumes[:, 20:24, 10:14, 8:12] = 0.0  # 8 mm³, deeper than a bead

    def scratched(volumes):
        volumes[:, 2:6, 10:14, 8:12] = 0.0

    assert compare_with_design(changed(hollow), bar, job).summary.core_void == pytest.approx(
        8 / (16 * 6 * 4), rel=0.02)
    assert compare_with_design(changed(scratched), bar, job).summary.core_void == 0.0


def test_half_a_build_misses_the_other_half(bar, job, perfect):
    half = replace(perfect, deposited_mm3=perfect.deposited_mm3[:, :22].copy())
    found = compare_with_design(half, bar, job).summary
    assert found.missing_mm3 == pytest.approx(800.0, rel=0.01)
    assert found.built_over_design == pytest.approx(0.5, rel=0.01)


def test_a_work_offset_is_found_from_the_path(bar, job, perfect):
    offset = np.array([7.5, -3.25, 12.0])
    moved = replace(perfect, origin_mm=perfect.origin_mm + offset, plate_z_mm=12.0,
                    path=replace(perfect.path, place_mm=perfect.path.place_mm + offset))
    found = compare_with_design(moved, bar, job).summary
    assert found.missing_mm3 == pytest.approx(0.0, abs=2.0)
    assert found.by_path.within[0.02] == 1.0


def test_the_path_counts_by_its_length_and_what_got_nothing_is_wrong(bar, job, perfect):
    path = perfect.path
    delivered = path.delivered.copy()
    delivered[:60] += [0.025, -0.025, 0.0]
    delivered[60:90] = np.nan
    length = np.where(np.arange(600) < 60, 3.0, 1.0)
    found = compare_with_design(
        replace(perfect, path=replace(path, delivered=delivered, beam_on_mm=length)), bar,
        job).summary.by_path
    assert found.within[0.02] == pytest.approx((600 - 90) / (600 + 120))
    assert found.within[0.03] == pytest.approx((600 - 30 + 120) / (600 + 120))


def test_powder_that_makes_up_for_dilution_is_compared_with_what_it_melts(bar, job, perfect):
    """On a plate of A, 0.2 of which is melted: beyond 0.82 of B powder cannot make up for it."""
    path = perfect.path
    plate = replace(bar, substrate=SubstrateSettings(material="A"))
    delivered = path.delivered.copy()
    first = path.line < 10
    delivered[first, 1] = np.minimum(delivered[first, 1] / 0.8, 1.0)
    delivered[first, 0] = 1.0 - delivered[first, 1]
    built = replace(perfect, path=replace(path, delivered=delivered))
    plain = compare_with_design(built, plate, job).summary.by_path
    assert plain.within[0.02] < 0.92
    job.manifest.totals["dilution"] = {"share": 0.2, "compensated_fraction": 1.0}
    found = compare_with_design(built, plate, job).summary.by_path
    assert found.within[0.02] == pytest.approx(1 - 0.1 * 4 / 20)
    unknown = compare_with_design(perfect, bar, job).summary.by_path  # first layer as designed
    assert unknown.within[0.02] == 1.0


def test_powder_closes(bar, job, perfect):
    one, other = compare_with_design(perfect, bar, job).summary.balance
    assert (one.material, other.material) == ("A", "B")
    assert one.deposited_g == pytest.approx(800 * 0.008, rel=1e-3)
    assert one.overspray_g == pytest.approx(10 - 6.4, rel=1e-3)
    assert (one.unaccounted_g, one.closure) == (0.0, 0.0)


def test_a_powder_that_the_part_does_not_know_is_foreign(bar, job, perfect):
    other = replace(perfect, materials=("A", "C", "S355"))
    found = compare_with_design(other, bar, job)
    assert found.materials == ("A", "B", "C", "S355")
    assert found.summary.by_volume.within[0.05] == pytest.approx(0.05, abs=0.02)


def test_voxels_larger_than_the_part(bar, job, perfect):
    coarse = replace(perfect, voxel_mm=np.full(3, 400.0))
    with pytest.raises(InputError, match="no voxel lies in the part") as refused:
        compare_with_design(coarse, bar, job)
    assert "voxel_mm" in refused.value.hint


def test_a_build_far_from_its_part(bar, job, perfect):
    far = replace(perfect, origin_mm=perfect.origin_mm + 1e5)
    with pytest.raises(InputError, match="too far apart"):
        compare_with_design(far, bar, job)


def test_weighted_figures_are_those_of_repeated_values():
    rng = np.random.default_rng(3)
    error, weight = rng.uniform(0, 0.1, 200), rng.integers(1, 6, 200)
    every = np.repeat(error, weight)
    found = composition_error(error, weight.astype(float))
    assert found.mean == pytest.approx(every.mean())
    assert found.rms == pytest.approx(np.sqrt((every**2).mean()))
    assert found.p95 == pytest.approx(np.quantile(every, 0.95, method="inverted_cdf"))
    assert found.p99 == pytest.approx(np.quantile(every, 0.99, method="inverted_cdf"))
    assert found.within[0.03] == pytest.approx((every <= 0.03).mean())
    assert composition_error(error, np.zeros(200)) is None
    assert composition_error(np.array([np.inf]), np.ones(1)).within[0.05] == 0.0
