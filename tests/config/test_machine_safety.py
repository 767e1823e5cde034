"""The profile's [safety] table, and that it is no part of what a job is planned for."""

from importlib.resources import files

import pytest

from lmctl.config import toml_file
from lmctl.config.machine import SAFETY_INPUTS, MachineProfile
from lmctl.errors import ConfigError

EXAMPLES = files("lmctl.examples")
PLAIN = (EXAMPLES / "cell.toml").read_text(encoding="utf-8")
SAFE = (EXAMPLES / "cell-safe.toml").read_text(encoding="utf-8")


def profile(table: str) -> MachineProfile:
    text = f"{PLAIN}\n[safety]\nendpoint = 'modbus-tcp://127.0.0.1:5023'\n{table}\n"
    return toml_file.parse_toml(text, MachineProfile, name="cell.toml")


def test_without_the_table_there_is_no_device():
    assert toml_file.parse_toml(PLAIN, MachineProfile, name="cell.toml").safety is None


def test_defaults():
    safety = profile("").safety
    assert (safety.device_id, safety.period_s, safety.relay_timeout_s) == (1, 0.1, None)
    assert safety.laser_enable is False
    assert safety.fitted == SAFETY_INPUTS
    assert len(SAFETY_INPUTS) == 10
    assert safety.shield_gas_min_L_min is None
    assert safety.oxygen_trip_ppm is None


def test_the_shipped_cell_with_it():
    safety = toml_file.parse_toml(SAFE, MachineProfile, name="cell-safe.toml").safety
    assert (safety.relay_timeout_s, safety.laser_enable) == (0.3, True)
    assert safety.fitted == SAFETY_INPUTS
    assert (safety.chiller_max_C, safety.shield_gas_min_L_min) == (25.0, 12.0)


def test_a_job_is_planned_for_the_cell_with_and_without_it():
    plain = toml_file.parse_toml(PLAIN, MachineProfile, name="cell.toml")
    assert profile("relay_timeout_s = 1").planning_digest() == plain.planning_digest()
    shipped = toml_file.parse_toml(SAFE, MachineProfile, name="cell-safe.toml")
    assert shipped.planning_digest() == plain.planning_digest()


def test_a_cell_has_what_it_has():
    assert profile('fitted = ["door"]').safety.fitted == ("door",)
    assert profile("fitted = []").safety.fitted == ()


@pytest.mark.parametrize(
    ("table", "key", "words"),
    [
        ("period_s = 0.019", "safety.period_s", "at least 0.02"),
        ("period_s = 1.1", "safety.period_s", "at most 1"),
        ("device_id = 0", "safety.device_id", "at least 1"),
        ("relay_timeout_s = 0.05", "safety.relay_timeout_s", "at least 0.06"),
        ("relay_timeout_s = 61", "safety.relay_timeout_s", "at most 60"),
        ("relay_timeout_s = 0.25", "safety", "at least 3 times period_s, 0.3 s"),
        ("laser_enable = true", "safety", "laser_enable needs relay_timeout_s"),
        ("laser_enable = 'yes'", "safety.laser_enable", "true or false"),
        ('fitted = ["door", "dor"]', "safety.fitted[2]", "'estop', 'door'"),
        ('fitted = ["door", "door"]', "safety", "'door' is fitted twice"),
        ("shield_gas_min_L_min = 0", "safety.shield_gas_min_L_min", "above 0"),
        ("chiller_max_C = 101", "safety.chiller_max_C", "at most 100"),
        ("oxygen_warn_ppm = nan", "safety.oxygen_warn_ppm", "finite"),
        ("oxygen_warn_ppm = 100\noxygen_trip_ppm = 50", "safety", "is above oxygen_trip_ppm"),
        ('fitted = ["door"]\noxygen_trip_ppm = 50', "safety", '"oxygen" is not among fitted'),
        ("limits = 1", "safety.limits", "there is no such key"),
    ],
)
def test_mistakes(table, key, words):
    with pytest.raises(ConfigError) as caught:
        profile(table)
    (finding,) = caught.value.findings
    assert finding.path == key
    assert words in finding.reason


def test_all_mistakes_at_once():
    with pytest.raises(ConfigError) as caught:
        profile("period_s = 0\nchiller_max_C = 'warm'\ndevice_id = 300")
    assert {f.path for f in caught.value.findings} == {
        "safety.period_s", "safety.chiller_max_C", "safety.device_id"
    }
    with pytest.raises(ConfigError) as caught:
        profile('fitted = ["key", "key"]\nrelay_timeout_s = 0.1\noxygen_warn_ppm = 9')
    (finding,) = caught.value.findings
    for words in ("fitted twice", "3 times period_s", "not among fitted"):
        assert words in finding.reason
