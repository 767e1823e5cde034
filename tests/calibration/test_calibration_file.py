"""`calibration.json`: written whole, refused where altered, and judged by age and conditions."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from importlib.resources import files
from pathlib import Path

import pytest

from lmctl.calibration import (
    Calibration,
    CatchCalibration,
    DilutionCalibration,
    HopperCalibration,
    MeasuredValue,
    MeasurementConditions,
    calibrated_profile,
    calibration_findings,
    load_calibration,
    save_calibration,
)
from lmctl.calibration.validity import refuse_invalid
from lmctl.config.dilution import DilutionSettings
from lmctl.config.machine import MachineProfile, load_profile
from lmctl.config.measuring import CalibrationSettings
from lmctl.errors import ConfigError, MissingFileError

NOW = datetime(2026, 11, 30, 12, 0, tzinfo=UTC)


def value(at: float, half: float) -> MeasuredValue:
    return MeasuredValue(value=at, low=at - half, high=at + half)


def conditions(days_ago: float = 1.0, **changes) -> MeasurementConditions:
    when = (NOW - timedelta(days=days_ago)).isoformat()
    return MeasurementConditions(**{"measured": when, "by": "Ada", "carrier_L_min": 4.0} | changes)


def hopper(**changes) -> HopperCalibration:
    return HopperCalibration(**{
        "name": "A", "material": "316L", "conditions": conditions(),
        "dead_time_s": value(3.4, 0.03), "lag_s": value(1.3, 0.05), "response_s": value(4.7, 0.02),
        "slope": value(1.05, 0.004), "offset_g_min": value(0.0, 0.01),
        "scale_lag_s": value(0.3, 0.01), "noise_rsd": 0.03, "noise_correlation_s": 1.0,
        "levels_g_min": (1.0, 10.0), "duration_s": 560.0,
    } | changes)


def cell(**changes) -> MachineProfile:
    profile = load_profile(Path(str(files("lmctl.examples") / "cell.toml")))
    return profile.model_copy(update=changes)


def calibration(*hoppers: HopperCalibration, **changes) -> Calibration:
    return Calibration(machine="bench cell", hopper=hoppers or (hopper(),), **changes)


def test_a_calibration_comes_back_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    caught = CatchCalibration(mass_shares={"316L": 1.0}, conditions=conditions(),
                              efficiency=value(0.7, 0.02), fed_g=40.0, deposited_g=28.0)
    written = calibration().with_catch(caught)
    save_calibration(written, path)
    assert load_calibration(path) == written
    assert json.loads(path.read_text())["digest"] == written.digest
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_altered_by_hand_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    save_calibration(calibration(), path)
    path.write_text(path.read_text().replace('"value": 3.4', '"value": 3.41'))
    with pytest.raises(ConfigError, match="altered"):
        load_calibration(path)


def test_all_mistakes_are_reported_at_once(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    save_calibration(calibration(), path)
    data = json.loads(path.read_text())
    data["hopper"][0]["slope"]["low"] = 2.0
    data["hopper"][0]["conditions"]["measured"] = "yesterday"
    data["hopper"][0]["noise_rsd"] = -1.0
    data["speed"] = 3
    path.write_text(json.dumps(data))
    with pytest.raises(ConfigError) as caught:
        load_calibration(path)
    told = caught.value.render()
    for key in ("hopper[1].slope", "hopper[1].conditions.measured", "hopper[1].noise_rsd", "speed"):
        assert key in told


def test_coupons_that_no_powder_makes_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    caught = CatchCalibration(mass_shares={"316L": 1.0}, conditions=conditions(),
                              efficiency=value(0.7, 0.02), fed_g=40.0, deposited_g=28.0)
    melted = DilutionCalibration(material="316L", substrate="S355", conditions=conditions(),
                                 energy_J_mm=100.0, dilution=value(0.3, 0.02))
    save_calibration(calibration(catch=(caught,), dilution=(melted,)), path)
    data = json.loads(path.read_text())
    data["catch"][0]["mass_shares"]["316L"] = 0.6
    data["catch"][0]["efficiency"] = {"value": 1.2, "low": 1.1, "high": 1.3}
    data["dilution"][0]["dilution"] = {"value": 1.2, "low": 1.1, "high": 1.3}
    path.write_text(json.dumps(data))
    with pytest.raises(ConfigError) as refused:
        load_calibration(path)
    told = refused.value.render()
    assert "catch[1]: mass_shares do not add up to 1; an efficiency of 1.2 is not within" in told
    assert "dilution[1]: a dilution of 1.2 is not within 0 and 1" in told


def test_a_hopper_has_one_calibration(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    save_calibration(calibration(), path)
    data = json.loads(path.read_text())
    data["hopper"] *= 2
    path.write_text(json.dumps(data))
    with pytest.raises(ConfigError, match="mistake") as refused:
        load_calibration(path)
    assert "two calibrations of hopper A" in refused.value.render()


@pytest.mark.parametrize(("text", "words"), [
    ("{", "valid JSON"), ("[]", "no table"), ("{}", "known format"),
])
def test_files_that_are_none(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "calibration.json"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_calibration(path)
    assert words in caught.value.render()


def test_a_missing_file_is_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError):
        load_calibration(tmp_path / "calibration.json")


def told(found: Calibration, profile: MachineProfile) -> list[tuple[str, bool]]:
    return [(f.text, f.refuses) for f in calibration_findings(found, profile, NOW)
            if f.what != "hopper B"]


def test_a_fresh_calibration_of_this_cell_has_no_doubts() -> None:
    assert told(calibration(), cell()) == []


@pytest.mark.parametrize(("days", "refuses"), [(29.0, None), (31.0, False), (91.0, True)])
def test_age_warns_and_then_refuses(days: float, refuses: bool | None) -> None:
    found = told(calibration(hopper(conditions=conditions(days))), cell())
    assert [how for _, how in found] == ([] if refuses is None else [refuses])


def test_other_conditions_are_named_and_refused_where_the_profile_says_so() -> None:
    profile = cell(calibration=CalibrationSettings(
        other_conditions="refuse", nozzle="ring 2", standoff_mm=12.0))
    profile = profile.model_copy(update={"hopper": tuple(
        h.model_copy(update={"powder_lot": "L7", "carrier_L_min": 6.0}) for h in profile.hopper)})
    found = told(calibration(hopper(conditions=conditions(
        powder_lot="L6", nozzle="ring 1", standoff_mm=10.0))), profile)
    assert [refuses for _, refuses in found] == [True] * 4
    text = " ".join(words for words, _ in found)
    for word in ("L6", "L7", "ring 1", "4 L/min", "6", "10 mm"):
        assert word in text
    with pytest.raises(ConfigError, match="does not hold"):
        refuse_invalid(list(calibration_findings(calibration(hopper(conditions=conditions(
            powder_lot="L6"))), profile, NOW)), "calibration.json")


def test_another_powder_or_machine_is_refused() -> None:
    assert told(calibration(hopper(material="Ni625")), cell())[0][1]
    assert told(calibration(), cell(name="other cell"))[0][1]


def test_measured_values_stand_in_for_typed_ones() -> None:
    caught = CatchCalibration(mass_shares={"316L": 1.0}, conditions=conditions(),
                              efficiency=value(0.68, 0.02), fed_g=40.0, deposited_g=27.2)
    profile = calibrated_profile(cell(), calibration().with_catch(caught))
    a, b = profile.hopper
    assert (a.dead_time_s, a.lag_s, a.slope, a.catch_efficiency) == (3.4, 1.3, 1.05, 0.68)
    assert b == cell().hopper[1]
    use = profile.calibration_use
    assert use is not None
    assert set(use.measured) == {"hopper A", "catch of 316L"}
    assert profile.planning_digest() != cell().planning_digest()
    assert profile.dilution == ()
    only_hopper = calibrated_profile(cell(), calibration())
    assert only_hopper.planning_digest() == cell().planning_digest()


def test_measured_dilution_stands_in_for_what_was_typed_of_the_same_powder() -> None:
    typed = (DilutionSettings(share=0.1, material="316L"),
             DilutionSettings(share=0.3, material="WC-12Co"), DilutionSettings(share=0.25))
    measured = DilutionCalibration(material="316L", substrate="S235", conditions=conditions(),
                                   energy_J_mm=150.0, dilution=value(0.01, 0.02))
    profile = calibrated_profile(cell(dilution=typed), calibration().with_dilution(measured))
    first, second = profile.dilution
    assert (first.share, first.low, first.high) == (0.01, 0.0, 0.03)
    assert (first.energy_J_mm, first.material) == (150.0, "316L")
    assert second == typed[1]
    use = profile.calibration_use
    assert use is not None
    assert "dilution of 316L" in use.measured
    assert profile.planning_digest() != cell(dilution=typed).planning_digest()
    assert cell().planning_digest() != cell(dilution=typed).planning_digest()
