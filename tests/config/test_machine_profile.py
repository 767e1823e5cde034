"""A machine profile as people write it: what is refused, and in which words."""

import re
from importlib.resources import files

import pytest

from lmctl.config import toml_file
from lmctl.config.machine import MachineProfile
from lmctl.errors import ConfigError

TEXT = (files("lmctl.examples") / "cell.toml").read_text(encoding="utf-8")


def findings(*changes):
    text = TEXT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    with pytest.raises(ConfigError) as caught:
        toml_file.parse_toml(text, MachineProfile, name="cell.toml")
    assert "pydantic" not in str(caught.value)
    return [(finding.path, finding.reason) for finding in caught.value.findings]


@pytest.mark.parametrize(
    ("old", "new", "path", "kind"),
    [
        ("watchdog_s = 4", 'watchdog_s = "4"', "feeder[1].watchdog_s", "a number"),
        ("watchdog_s = 4", "watchdog_s = true", "feeder[1].watchdog_s", "a number"),
        ("s_max = 1000", 's_max = "1000"', "laser.s_max", "a whole number"),
        ("s_max = 1000", "s_max = true", "laser.s_max", "a whole number"),
        ("s_max = 1000", "s_max = 999.5", "laser.s_max", "a whole number"),
        ("lag_s = 1.0", 'lag_s = "1.0"', "hopper[1].lag_s", "a number"),
        ("purge_mm = [10, 10, 20]", 'purge_mm = [10, "10", 20]', "motion.purge_mm[2]", "a number"),
        ("purge_mm = [10, 10, 20]", "purge_mm = [10, true, 20]", "motion.purge_mm[2]", "a number"),
        ('material = "316L"', "material = 316", "hopper[1].material", "text in quotes"),
    ],
)
def test_a_value_of_another_kind_is_refused_not_read_as_a_number(old, new, path, kind):
    assert findings((old, new)) == [(path, f"must be {kind}")]


def test_a_whole_number_is_a_number():
    profile = toml_file.parse_toml(TEXT, MachineProfile, name="cell.toml")
    assert profile.feeder[0].watchdog_s == 4.0
    assert profile.motion.purge_mm == (10.0, 10.0, 20.0)


@pytest.mark.parametrize(
    ("old", "new", "path"),
    [
        ("max_speed_mm_s = [100, 100, 100]", "max_speed_mm_s = [1e300, 1, 1]",
         "motion.max_speed_mm_s[1]"),
        ("acceleration_mm_s2 = [500, 500, 500]", "acceleration_mm_s2 = [5, 1e-300, 5]",
         "motion.acceleration_mm_s2[2]"),
        ("z = [0, 200]", "z = [0, 1e308]", "motion.travel_mm.z[2]"),
        ("junction_deviation_mm = 0.01", "junction_deviation_mm = 1e9",
         "motion.junction_deviation_mm"),
        ("clearance_mm = 5", "clearance_mm = 1e200", "motion.clearance_mm"),
        ("max_power_W = 3000", "max_power_W = 1e300", "laser.max_power_W"),
        ("max_flow_g_min = 60", "max_flow_g_min = 1e200", "hopper[1].max_flow_g_min"),
        ("max_flow_g_min = 60", "max_flow_g_min = 655.4", "hopper[1].max_flow_g_min"),
        ("watchdog_s = 4", "gas_preflow_s = 1e300", "feeder[1].gas_preflow_s"),
        ("watchdog_s = 4", "gas_postflow_s = 7200", "feeder[1].gas_postflow_s"),
        ("mixer_pressure_max_mbar = 200", "mixer_pressure_max_mbar = 1e6",
         "feeder[1].mixer_pressure_max_mbar"),
    ],
)
def test_figures_that_no_machine_has_are_refused(old, new, path):
    ((found, reason),) = findings((old, new))
    assert found == path
    assert re.fullmatch("must be at (least|most) [0-9.]+", reason)


@pytest.mark.parametrize(("horizon_s", "period_s", "most"), [
    (1.0, 0.51, "0.5"), (1.0, 1.0, "0.5"), (0.3, 0.2, "0.15"),
])
def test_reports_that_come_too_seldom_for_the_horizon_are_refused(horizon_s, period_s, most):
    """Motion would run dry between two of them, in the middle of a bead."""
    ((path, reason),) = findings(("send_horizon_s = 1.0", f"send_horizon_s = {horizon_s}\n"
                                                          f"status_period_s = {period_s}"))
    assert path == "motion"
    assert reason == f"status_period_s must be at most half of send_horizon_s, {most} s"


@pytest.mark.parametrize("value", ["0", "-5", "nan", "inf", '"200"', "true"])
def test_a_mixer_pressure_limit_is_a_pressure(value):
    ((path, _),) = findings(
        ("mixer_pressure_max_mbar = 200", f"mixer_pressure_max_mbar = {value}"))
    assert path == "feeder[1].mixer_pressure_max_mbar"


def test_a_mixer_pressure_limit_may_be_missing_and_changes_no_plan():
    with_limit = toml_file.parse_toml(TEXT, MachineProfile, name="cell.toml")
    text = "\n".join(line for line in TEXT.splitlines() if "mixer_pressure" not in line)
    without = toml_file.parse_toml(text, MachineProfile, name="cell.toml")
    assert [one.mixer_pressure_max_mbar for one in with_limit.feeder] == [200.0, 200.0]
    assert [one.mixer_pressure_max_mbar for one in without.feeder] == [None, None]
    assert with_limit.planning_digest() == without.planning_digest()


def test_two_feeders_that_are_one_device_are_refused():
    ((path, reason),) = findings(("127.0.0.1:5022", "127.0.0.1:5021"))
    assert path == ""
    assert reason == "two feeders are the same device: modbus-tcp://127.0.0.1:5021, device 1"


def test_two_devices_may_share_a_line():
    second = 'endpoint = "modbus-tcp://127.0.0.1:5022"\ndevice_id = 1'
    assert second in TEXT
    text = TEXT.replace(second, 'endpoint = "modbus-tcp://127.0.0.1:5021"\ndevice_id = 2')
    assert len(toml_file.parse_toml(text, MachineProfile, name="cell.toml").feeder) == 2


def test_items_that_are_all_wrong_are_not_called_missing_too():
    found = findings(
        ("dead_time_s = 3.0", "dead_time_s = -3"), ("dead_time_s = 2.6", "dead_time_s = nan")
    )
    assert [path for path, _ in found] == ["hopper[1].dead_time_s", "hopper[2].dead_time_s"]


def test_no_item_at_all_is_said_in_plain_words():
    text = TEXT[: TEXT.index("[[hopper]]")]
    with pytest.raises(ConfigError) as caught:
        toml_file.parse_toml(f"hopper = []\n{text}", MachineProfile, name="cell.toml")
    (finding,) = caught.value.findings
    assert (finding.path, finding.reason) == ("hopper", "at least one is needed")


@pytest.mark.parametrize("name", ["", "A\\u001b[31m", "A\\nB", "x" * 101])
def test_names_fit_on_a_line_and_command_no_terminal(name):
    found = findings(('name = "A"', f'name = "{name}"'))
    assert [path for path, _ in found] == ["hopper[1].name"]


def test_names_may_be_in_any_script():
    text = TEXT.replace('name = "bench cell"', 'name = "Zelle für Grün ☃"')
    assert toml_file.parse_toml(text, MachineProfile, name="cell.toml").name == "Zelle für Grün ☃"


DILUTION = "[[dilution]]\nshare = 0.2\n"


@pytest.mark.parametrize(
    ("more", "path", "reason"),
    [
        ("[[dilution]]\nshare = 20\n", "dilution[1].share", "at most 0.8"),
        ("[[dilution]]\nshare = 0.2\nlow = 0.1\n", "dilution[1]", "one of low and high"),
        ("[[dilution]]\nshare = 0.2\nlow = 0.25\nhigh = 0.3\n", "dilution[1]", "is not within"),
        (DILUTION + DILUTION, "", "two dilutions of all powders: each must state its energy_J_mm"),
        (DILUTION + 'material = "316L"\n' + DILUTION + 'material = "316L"\nenergy_J_mm = 150\n', "",
         "two dilutions of 316L"),
        ('[[mixture_catch]]\nefficiency = 0.6\nmass_shares = { A = 0.5, B = 0.2 }\n',
         "mixture_catch[1]", "do not add up to 1"),
        ('[[mixture_catch]]\nefficiency = 0.6\nmass_shares = { A = 0.5, B = 0.3, C = 0.2 }\n',
         "mixture_catch[1]", "of two powders, not of 3"),
        ('[[mixture_catch]]\nefficiency = 60\nmass_shares = { A = 0.5, B = 0.5 }\n',
         "mixture_catch[1].efficiency", "at most 1"),
    ],
)
def test_dilution_and_catch_of_mixtures_that_cannot_be(more, path, reason):
    ((where, why),) = findings(("[laser]", more + "[laser]"))
    assert where == path
    assert reason in why


def test_dilutions_of_several_energies_and_powders_are_read():
    more = "".join(
        f'[[dilution]]\nshare = {share}\nenergy_J_mm = {energy}\nmaterial = "{name}"\n'
        for name, share, energy in (("316L", 0.2, 150), ("316L", 0.3, 200), ("WC-12Co", 0.2, 150)))
    profile = toml_file.parse_toml(TEXT.replace("[laser]", more + "[laser]"), MachineProfile,
                                   name="cell.toml")
    assert [one.energy_J_mm for one in profile.dilution] == [150.0, 200.0, 150.0]
