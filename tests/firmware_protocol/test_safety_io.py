import pytest

from firmware_protocol import safety_io
from firmware_protocol.registers import RegisterError, RegisterSpace, RegisterType
from firmware_protocol.safety_io import (
    CYCLIC_BLOCK,
    FULL_BLOCK,
    SIO_MAP,
    SafetyInputBits,
    SafetyStatusBits,
)

I, H = RegisterSpace.INPUT, RegisterSpace.HOLDING  # noqa: E741

# every row: name, kind, address, type, counts per unit, may be "not available"
ROWS = [
    ("DEVICE_ID", I, 0, RegisterType.U16, 1, False),
    ("MAP_VERSION", I, 1, RegisterType.U16, 1, False),
    ("FW_VERSION", I, 2, RegisterType.U16, 1, False),
    ("RESERVED_3", I, 3, RegisterType.U16, 1, False),
    ("SERIAL", I, 4, RegisterType.U32, 1, False), ("INPUTS", I, 6, RegisterType.BITS, 1, False),
    ("STATUS", I, 7, RegisterType.BITS, 1, False), ("FIRST_OUT", I, 8, RegisterType.U16, 1, False),
    ("TRIP_COUNT", I, 9, RegisterType.U16, 1, False),
    ("HEARTBEAT_ECHO", I, 10, RegisterType.U16, 1, False),
    ("HEARTBEAT_AGE", I, 11, RegisterType.U16, 1, False),
    ("UPTIME", I, 12, RegisterType.U32, 1, False),
    ("TICK", I, 14, RegisterType.U16, 1, False), ("SHIELD_GAS", I, 15, RegisterType.U16, 100, True),
    ("CHILLER_TEMP", I, 16, RegisterType.I16, 10, True),
    ("CHILLER_FLOW", I, 17, RegisterType.U16, 100, True),
    ("OXYGEN", I, 18, RegisterType.U32, 10, True),
    ("EXTRACTION_DP", I, 20, RegisterType.I16, 1, True),
    ("HEARTBEAT", H, 0, RegisterType.U16, 1, False),
    ("RELAY_TIMEOUT", H, 1, RegisterType.U16, 1, False),
    ("RELAY_RESET", H, 2, RegisterType.U16, 1, False),
    ("LASER_ENABLE", H, 3, RegisterType.U16, 1, False),
]


@pytest.mark.parametrize(("name", "kind", "address", "type_", "per_unit", "missing"), ROWS)
def test_every_row(name, kind, address, type_, per_unit, missing):
    row = SIO_MAP[name]
    assert (row.space, SIO_MAP.wire_address(name), row.type) == (kind, address, type_)
    assert (row.counts_per_unit, row.may_be_unavailable) == (per_unit, missing)
    assert row.writable == (kind is H)


def test_there_are_no_other_rows():
    assert [row.name for row in SIO_MAP.rows] == [name for name, *_ in ROWS]


def test_all_inputs_are_one_gapless_read():
    for block, first in ((FULL_BLOCK, 0), (CYCLIC_BLOCK, 6)):
        (planned,) = SIO_MAP.plan_reads(row.name for row in block.rows)
        assert (block.address, block.count) == (planned.address, planned.count)
        assert (block.address, block.address + block.count) == (first, 21)


def test_the_mirror_collides_with_nothing():
    holding = {row.address for row in SIO_MAP.rows if row.space is H}
    mirrored = {safety_io.MIRROR_ADDRESS + a for a in range(FULL_BLOCK.count)}
    assert not holding & mirrored


def test_zeros_read_as_everything_open():
    values = CYCLIC_BLOCK.decode([0] * CYCLIC_BLOCK.count)
    assert SafetyInputBits(values["INPUTS"]) == SafetyInputBits(0)
    assert SafetyStatusBits(values["STATUS"]) == SafetyStatusBits(0)
    assert all(one & safety_io.ALL_INPUTS_OK for one in SafetyInputBits)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("SHIELD_GAS", 15.25, (1525,)), ("SHIELD_GAS", None, (0xFFFF,)),
        ("CHILLER_TEMP", -2.5, (0xFFE7,)), ("CHILLER_TEMP", None, (0x8000,)),
        ("CHILLER_FLOW", 10.0, (1000,)), ("CHILLER_FLOW", None, (0xFFFF,)),
        ("OXYGEN", 209_000.0, (31, 58_384)), ("OXYGEN", None, (0xFFFF, 0xFFFF)),
        ("EXTRACTION_DP", -12, (0xFFF4,)), ("EXTRACTION_DP", None, (0x8000,)),
    ],
)
def test_values_and_what_is_not_available(name, value, words):
    assert SIO_MAP.encode(name, value) == words
    assert SIO_MAP.decode(name, words) == value


@pytest.mark.parametrize("milliseconds", [0, 49, 60_001])
def test_limits_of_the_relays_time(milliseconds):
    with pytest.raises(RegisterError, match="between 50 and 60000 ms"):
        SIO_MAP.encode("RELAY_TIMEOUT", milliseconds)


@pytest.mark.parametrize(
    ("one", "code", "words"),
    [
        (SafetyInputBits.ESTOP_CLOSED, 101, "emergency-stop chain is open"),
        (SafetyInputBits.DOOR_CLOSED, 102, "door is open"),
        (SafetyInputBits.LASER_READY, 103, "laser is not ready"),
        (SafetyInputBits.LASER_HEALTHY, 104, "laser reports a fault"),
        (SafetyInputBits.NO_BACK_REFLECTION, 105, "light coming back"),
        (SafetyInputBits.CHILLER_OK, 106, "chiller reports a fault"),
        (SafetyInputBits.SHIELD_GAS_OK, 107, "too little shield gas"),
        (SafetyInputBits.EXTRACTION_OK, 108, "extraction does not draw"),
        (SafetyInputBits.OXYGEN_VALID, 109, "analyser gives no valid reading"),
        (SafetyInputBits.KEY_ON, 110, "key switch is off"),
    ],
)
def test_first_outs_in_words(one, code, words):
    assert safety_io.first_out_code_of_input(one) == code
    found = safety_io.describe_first_out(code)
    assert found.code == code
    assert words in found.text
    assert found.remedy


def test_the_relays_code_and_codes_no_one_knows():
    assert "heartbeat stopped" in safety_io.describe_first_out(safety_io.RELAY_FIRST_OUT_CODE).text
    assert "does not list" in safety_io.describe_first_out(0).text
    assert "safety code 65535" in safety_io.describe_first_out(0xFFFF).text
