"""Register maps that a profile names: read with it, and held against it."""

from importlib.resources import files
from pathlib import Path

import pytest

from lmctl.config.machine import load_profile
from lmctl.errors import ConfigError

EXAMPLES = Path(str(files("lmctl.examples")))
SAFE = (EXAMPLES / "cell-safe.toml").read_text()


@pytest.fixture
def profile(tmp_path):
    """Writes the safe cell with keys for its first feeder; the example maps are beside it."""
    for path in EXAMPLES.glob("feeder-*.toml"):
        (tmp_path / path.name).write_text(path.read_text())

    def write(keys: str, *replacements: tuple[str, str]) -> Path:
        text = SAFE.replace('name = "F1"\n', f'name = "F1"\n{keys}\n')
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "cell.toml").write_text(text)
        return tmp_path / "cell.toml"

    return write


def refused(path: Path) -> str:
    with pytest.raises(ConfigError) as error:
        load_profile(path)
    return error.value.render()


def test_a_profile_without_maps_is_as_it_was():
    profile = load_profile(EXAMPLES / "cell-safe.toml")
    assert [feeder.device_map for feeder in profile.feeder] == [None, None]


def test_a_map_is_read_beside_the_profile_and_changes_no_plan(profile):
    plain = load_profile(EXAMPLES / "cell-safe.toml")
    mapped = load_profile(profile('map = "feeder-rtu.toml"'))
    assert mapped.feeder[0].device_map.name == "KR-2 screw feeder"
    assert mapped.planning_digest() == plain.planning_digest()


def test_a_map_that_ships_is_named(profile):
    assert load_profile(profile('map = "pmx"')).feeder[0].device_map.name == "PMX 1.1"


@pytest.mark.parametrize(
    ("keys", "replacements", "said"),
    [
        ('map = "feeder-tcp.toml"', (), "has no watchdog: powder would go on"),
        ('map = "feeder-rtu.toml"\nword_order = "CDAB"', (), "word_order belongs into the"),
        ('map = "feeder-rtu.toml"',
         (('feeder = "F1"\nchannel = 1', 'feeder = "F1"\nchannel = 3'),),
         "hopper 'A' is on channel 3, and KR-2 screw feeder has 2"),
        ('map = "feeder-analog.toml"\nstopped_by_relay = true',
         (("max_flow_g_min = 60", "max_flow_g_min = 80"),),
         "hopper 'A': analog feeders behind an I/O module cannot be set to 80 g/min"),
        ('map = "sio"', (), "map 'sio' describes a safety device, and no feeder"),
        ('map = "feeder-rut.toml"', (), "there is no file"),
        ('stopped_by_relay = true', (("relay_timeout_s = 0.3", ""), ("laser_enable = true", "")),
         "is stopped_by_relay, and there is no safety.relay_timeout_s"),
        ('stopped_by_relay = 1', (), "must be true or false"),
    ],
)
def test_what_contradicts_the_profile_is_told_before_anything_is_connected(
    keys, replacements, said, profile
):
    assert said in refused(profile(keys, *replacements))


def test_mistakes_of_map_and_profile_come_together(profile, tmp_path):
    text = (tmp_path / "feeder-rtu.toml").read_text()
    (tmp_path / "feeder-rtu.toml").write_text(
        text.replace("maximum = 15,", "maximum = 700,").replace("code = 12", "code = 11"))
    told = refused(profile('map = "feeder-rtu.toml"', (
        'name = "F2"\n', 'name = "F2"\nmap = "feeder-tcp.toml"\n')))
    assert "feeder[1].map: feeder-rtu.toml: register 'GAS_SET': maximum 700" in told
    assert "two alarms have code 11" in told
    assert "feeder[2]: Meridian dosing rack has no watchdog" in told
    assert "3 mistakes" in told
