"""What a cell has measured of itself stands in the report with its date, and counts."""

from __future__ import annotations

import numpy as np
import pytest

from lmctl.report.job_report.document import FieldList, TableBlock
from lmctl.report.job_report.identity_sections import calibration_section, digest_section
from lmctl.report.part_report import JobOfPart, part_report_of
from lmctl.run.journal.writer import JournalWriter

HOPPER = {"name": "A", "feeder": "F1", "material": "316L", "dead_time_s": 3.1, "lag_s": 0.9}
MEASURED = {"slope": 1.02, "offset_g_min": 0.05, "catch_efficiency": 0.71}
USED = {"digest": "ab" * 32, "measured": {"hopper A": "2026-11-30T02:41:07Z"}}


def report(folder, **header):
    with JournalWriter(folder / "journal.jsonl", header, local={"run": "run-0001"}) as journal:
        journal.seal(1.0, state="stopped")
    return part_report_of(folder / "journal.jsonl")


def values(found):
    table = calibration_section(found).blocks[0]
    assert isinstance(table, TableBlock)
    return {(row[0], row[1]): (row[2], row[5], row[7]) for row in table.rows}


def test_measured_values_carry_their_date_and_the_digest_is_whole(tmp_path):
    found = report(tmp_path, hoppers=[HOPPER | MEASURED], calibration=USED)
    told = values(found)
    assert told["hopper A", "dead time"] == ("3.1", "2026-11-30 02:41:07", "calibration")
    assert told["hopper A", "slope"] == ("1.02", "2026-11-30 02:41:07", "calibration")
    fields = digest_section(found).blocks[0]
    assert isinstance(fields, FieldList)
    assert ("calibration", "ab" * 32) in fields.rows


def test_what_was_typed_in_has_a_blank_for_its_date(tmp_path):
    told = values(report(tmp_path, hoppers=[HOPPER]))
    assert told["hopper A", "dead time"] == ("3.1", None, "machine profile")
    assert ("hopper A", "slope") not in told


def test_a_measured_catch_efficiency_counts_for_the_mixture_inferred(job_with_powder):
    typed = job_with_powder.scales({"hoppers": [HOPPER]}).deposit_mm3_g["316L"]
    measured = job_with_powder.scales({"hoppers": [HOPPER | MEASURED]}).deposit_mm3_g["316L"]
    assert measured / typed == pytest.approx(0.71 / job_with_powder.powders[0].catch_efficiency)


@pytest.fixture
def job_with_powder(tmp_path):
    from lmctl.config.part_rules import parse_part_file
    from lmctl.part.materials.powders import resolve_materials

    part = parse_part_file(
        'name = "p"\n[[material]]\nname = "316L"\n[[body]]\nkind = "box"\n'
        "low_mm = [0, 0, 0]\nhigh_mm = [1, 2, 3]\n", name="part.toml")

    class Manifest:
        max_power_W, s_max, materials = 3000.0, 1000, ("316L",)

    return JobOfPart(tmp_path / "job.lmj", Manifest(), "", resolve_materials(part))


def test_a_mixture_that_is_caught_otherwise_than_its_powders_is_inferred_so(tmp_path):
    """By hand: kappa from the coupon, and what stays of both powders at 3 and 4 g/min."""
    from lmctl.config.part_rules import parse_part_file
    from lmctl.part.materials.powders import resolve_materials
    from lmctl.report.reported_values import nozzle_of

    part = parse_part_file(
        'name = "p"\n[[material]]\nname = "316L"\n[[material]]\nname = "WC-12Co"\n[[body]]\n'
        'kind = "box"\nlow_mm = [0, 0, 0]\nhigh_mm = [1, 2, 3]\n[composition]\n'
        'feature = { kind = "point", at_mm = [0, 0, 0] }\n'
        'profile = { kind = "constant", of = { "316L" = 0.5, "WC-12Co" = 0.5 } }\n', name="p.toml")
    steel, carbide = resolve_materials(part)

    class Manifest:
        max_power_W, s_max, materials = 3000.0, 1000, ("316L", "WC-12Co")

    header = {
        "hoppers": [HOPPER | {"dead_time_s": 0.0, "lag_s": 0.0},
                    HOPPER | {"name": "B", "material": "WC-12Co", "dead_time_s": 0.0,
                              "lag_s": 0.0}],
        "mixture_catch": [{"mass_shares": {"316L": 0.5, "WC-12Co": 0.5}, "efficiency": 0.5}],
    }
    scales = JobOfPart(tmp_path / "a.lmj", Manifest(), "", (steel, carbide)).scales(header)
    nozzle = nozzle_of(header, scales)
    nozzle.order_flows(0.0, {"A": 3.0, "B": 4.0})
    (found,) = nozzle.advance(np.array([5.0]), np.full((1, 2), np.nan))
    e_a, e_b = steel.catch_efficiency, carbide.catch_efficiency
    kappa = (0.5 - (e_a + e_b) / 2) / ((e_a + e_b) / 4)
    volume = np.array([3 * e_a * (1 + kappa * 4 / 7) / steel.density_g_mm3,
                       4 * e_b * (1 + kappa * 3 / 7) / carbide.density_g_mm3])
    assert found == pytest.approx(volume / volume.sum())
    alone = np.array([3 * e_a / steel.density_g_mm3, 4 * e_b / carbide.density_g_mm3])
    assert abs(found[0] - alone[0] / alone.sum()) > 0.01


def test_a_mixture_is_inferred_behind_the_hose_that_a_purge_has_measured(tmp_path):
    """A's powder is set at 10 s; after the purge it comes 4 s later, and not 3 s."""
    from lmctl.report.nozzle_inference import HoseValues, NozzleInference

    nozzle = NozzleInference((HoseValues("A", 0, 3.0, 0.0, 100.0),
                              HoseValues("B", 1, 2.0, 0.0, 100.0)), 2)
    nozzle.order_flows(0.0, {"A": 3.0, "B": 3.0})
    nozzle.advance(np.array([9.0]), np.full((1, 2), np.nan))
    nozzle.take_hose_response({"source": "not measured", "reason": "it is full"})
    nozzle.take_hose_response({"source": "measured", "hopper": "A", "used_dead_time_s": 4.0,
                               "used_lag_s": 0.0})
    nozzle.order_flows(10.0, {"A": 9.0, "B": 3.0})
    found = nozzle.advance(np.array([13.5, 14.5]), np.full((2, 2), np.nan))
    assert found[:, 0] == pytest.approx([0.5, 0.75])
