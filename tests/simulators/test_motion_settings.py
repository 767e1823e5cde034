import pytest

from firmware_protocol.dialect import GRBL, GRBLHAL
from simulators.motion.settings import FirmwareSettings, SettingError

BOTH = pytest.mark.parametrize("dialect", [GRBL, GRBLHAL], ids=["grbl", "grblhal"])


@BOTH
@pytest.mark.parametrize(
    ("number", "value", "grbl", "grblhal"),
    [
        (1234, 1.0, 3, 3),
        (110, -5.0, 4, 4),
        (110, float("nan"), 4, 4),
        (110, float("inf"), 4, 4),
        (0, 2.0, 6, 6),
        (20, 1.0, 10, 10),
        (120, 0.0, 4, 52),
        (13, 2.0, 4, 52),
        (58, -3.0, 3, None),
        (398, 50.0, 3, None),
    ],
)
def test_what_is_refused(dialect, number, value, grbl, grblhal):
    settings = FirmwareSettings(dialect, {})
    code = grblhal if dialect is GRBLHAL else grbl
    if code is None:
        settings.store(number, value)
        assert settings[number] == value
        return
    before = settings.listing()
    with pytest.raises(SettingError) as refused:
        settings.store(number, value)
    assert refused.value.code == code
    assert settings.listing() == before


@BOTH
def test_soft_limits_go_with_homing(dialect):
    settings = FirmwareSettings(dialect, {20: 1, 22: 1})  # in whatever order they are given
    assert settings[20] == 1
    settings.store(22, 0.0)
    assert settings[20] == 0


@BOTH
def test_whole_numbers_are_cut_and_others_shown_with_their_decimals(dialect):
    settings = FirmwareSettings(dialect, {23: 3.9, 110: 1234.5678})
    listing = dict(settings.listing())
    assert listing[23] == "3"
    assert listing[110] == "1234.568"


@BOTH
def test_restoring_brings_back_what_the_configuration_says(dialect):
    settings = FirmwareSettings(dialect, {110: 777})
    settings.store(110, 1.0)
    settings.store(11, 0.5)
    settings.restore_defaults()
    assert (settings[110], settings[11]) == (777.0, 0.01)


@BOTH
def test_kinematics_are_per_second(dialect):
    kinematics = FirmwareSettings(dialect, {110: 6000, 121: 300, 102: 400, 11: 0.02}).kinematics()
    assert kinematics.max_rate_mm_s[0] == pytest.approx(100.0)
    assert kinematics.acceleration_mm_s2[1] == 300.0
    assert kinematics.steps_per_mm[2] == 400.0
    assert kinematics.junction_deviation_mm == 0.02
