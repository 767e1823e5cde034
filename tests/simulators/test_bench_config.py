"""The bench file: what it says is what stands, and every mistake is told at once."""

from importlib.resources import files

import pytest

from simulators.bench_config import Address, BenchConfig, BenchConfigError

SHIPPED = (files("lmctl.examples") / "bench.toml").read_text(encoding="utf-8")
LEAST = """
[motion]
[[feeder]]
name = "F1"
[[feeder.hopper]]
material = "316L"
density_g_mm3 = 0.008
catch_efficiency = 0.7
feed_factor_g_rev = 2
n_max_rpm = 25
fill_g = 1000
"""


def mistakes(text: str) -> tuple[str, ...]:
    with pytest.raises(BenchConfigError) as caught:
        BenchConfig.parse(text)
    assert str(caught.value).splitlines() == list(caught.value.mistakes)
    return caught.value.mistakes


def test_the_bench_that_ships():
    config = BenchConfig.parse(SHIPPED)
    assert [f.name for f in config.feeders] == ["F1", "F2"]
    assert config.addresses["motion"] == Address("127.0.0.1", 2323)
    assert config.motion.settings[32] == 1
    assert config.feeders[1].hoppers[0].density_g_mm3 == 0.0143


def test_little_is_needed():
    config = BenchConfig.parse(LEAST)
    assert config.motion.dialect == "grblhal"
    assert (config.motion.rx_bytes, config.motion.planner_blocks) == (1024, 100)
    (hopper,) = config.feeders[0].hoppers
    assert (hopper.channel, hopper.dead_time_s, hopper.lag_s) == (1, 3.0, 1.0)
    assert hopper.calibrated_g_rev == 2.0
    assert config.addresses["F1"] == Address("127.0.0.1", 0)


def test_ptys_and_old_maps():
    config = BenchConfig.parse(
        LEAST.replace("[motion]", '[motion]\nendpoint = "pty"\ndialect = "grbl"')
        .replace('name = "F1"', 'name = "F1"\nendpoint = "pty"\nmap_version = "1.0"')
    )
    assert config.addresses == {"motion": Address(pty=True), "F1": Address(pty=True)}
    assert config.feeders[0].map_minor == 0
    assert (config.motion.rx_bytes, config.motion.planner_blocks) == (128, 15)


def test_every_key_of_the_shipped_bench_is_checked():
    """A wrong type in any one place is found there, and there only."""
    lines = SHIPPED.splitlines()
    checked = 0
    for i, line in enumerate(lines):
        key, equals, _ = line.partition(" = ")
        if not equals or line.startswith(("#", "[")):
            continue
        broken = "\n".join([*lines[:i], f"{key} = []", *lines[i + 1 :]])
        found = [m for m in mistakes(broken) if not m.startswith("feeder") or "channels" not in m]
        assert len(found) == 1, found
        assert key in found[0].split(":")[0]
        checked += 1
    assert checked > 30


@pytest.mark.parametrize(
    ("old", "new", "reported"),
    [
        ("fill_g = 1000", "fill_g = 1000\nfil_g = 1", "feeder[1].hopper[1].fil_g: there is no"),
        ("fill_g = 1000", "", "feeder[1].hopper[1].fill_g: is missing"),
        ("fill_g = 1000", "fill_g = nan", "fill_g: must be finite"),
        ("fill_g = 1000", "fill_g = -inf", "fill_g: must be finite"),
        ("fill_g = 1000", f"fill_g = 1{'0' * 400}", "fill_g: must be finite"),
        ("fill_g = 1000", "fill_g = 0", "fill_g: must be above 0"),
        ("fill_g = 1000", "fill_g = true", "fill_g: must be a number"),
        ("catch_efficiency = 0.7", "catch_efficiency = 1.1", "must be at most 1"),
        ("n_max_rpm = 25", "n_max_rpm = 0.3", "n_max_rpm: must be above 0.3"),
        ("n_max_rpm = 25", "n_max_rpm = 400", "more than 655 g/min"),
        ("n_max_rpm = 25", "n_max_rpm = 25\noffset_g_min = -1", "offset_g_min: must be at least"),
        ("n_max_rpm = 25", "n_max_rpm = 25\nchannel = 2", "channels must be 1, 2"),
        ("n_max_rpm = 25", "n_max_rpm = 25\nchannel = 5", "whole number from 1 to 4"),
        ("n_max_rpm = 25", "n_max_rpm = 25\nnoise_rsd = 0.3", "must be at most 0.2"),
        ("n_max_rpm = 25", "n_max_rpm = 25\nslope_factor = 0", "must be at least 0.2"),
        ("n_max_rpm = 25", "n_max_rpm = 140\nslope_factor = 5", "more than 655 g/min"),
        ("n_max_rpm = 25", "n_max_rpm = 25\ncatch_in_mixture = 0.6", "than arrives"),
        ("n_max_rpm = 25", "n_max_rpm = 25\nnoise_time_s = 0", "must be at least 0.05"),
        ('name = "F1"', 'name = "F1"\ndevice_id = 248', "whole number from 1 to 247"),
        ('name = "F1"', 'name = "motion"', "'motion' is taken"),
        ('name = "F1"', 'name = "F1"\nendpoint = "tcp://h:1"', 'must be "modbus-tcp://'),
        ('name = "F1"', 'name = "F1"\nendpoint = "modbus-tcp://h:99999"', "endpoint: must be"),
        ('name = "F1"', 'name = ""', "name: must be text"),
        ('name = "F1"', 'name = "F1"\nmap_version = "2.0"', "must be '1.0' or '1.1'"),
        ("[motion]", "", "motion: is missing"),
        ("[motion]", "motion = 5", "motion: must be a table"),
        ("[motion]", "[motion]\nrx_bytes = 1.5", "rx_bytes: must be a whole number"),
        ("[motion]", "[motion.settings]\n9999 = 1", "motion.settings.9999: the firmware has no"),
        ("[motion]", "[motion.settings]\n30 = 0", "motion.settings.30: the firmware refuses 0"),
        ("[motion]", "[motion.settings]\n20 = 1", "need homing"),
        ("[motion]", "[motion.settings]\nfoo = 1", "must be the number of a setting"),
        ("[[feeder]]", "[feeder]", "feeder: must be an array of tables"),
    ],
)
def test_mistakes_say_where_and_what(old, new, reported):
    assert any(reported in mistake for mistake in mistakes(LEAST.replace(old, new)))


def test_all_mistakes_come_at_once():
    text = LEAST.replace("fill_g = 1000", "fill_g = -1").replace("= 0.7", "= 7") + "what = 1\n"
    assert len(mistakes(text)) == 3


def test_two_devices_cannot_share_a_port():
    text = LEAST.replace('name = "F1"', 'name = "F1"\nendpoint = "modbus-tcp://127.0.0.1:7"')
    text = text.replace("[motion]", '[motion]\nendpoint = "tcp://127.0.0.1:7"')
    assert mistakes(text) == ("two devices answer at port 7",)


@pytest.mark.parametrize("text", ["[motion", "motion = ", "\0", "[" * 5000])
def test_what_is_no_toml(text):
    (mistake,) = mistakes(text)
    assert mistake.startswith("not valid TOML")


def test_files(tmp_path):
    with pytest.raises(OSError, match="No such file"):
        BenchConfig.load(tmp_path / "none.toml")
    (tmp_path / "binary").write_bytes(b"\xff\xfe\0")
    with pytest.raises(BenchConfigError, match="not text"):
        BenchConfig.load(tmp_path / "binary")


def test_homing_with_soft_limits_is_accepted():
    text = LEAST.replace("[motion]", "[motion.settings]\n20 = 1\n22 = 1")
    assert BenchConfig.parse(text).motion.settings == {20: 1.0, 22: 1.0}
