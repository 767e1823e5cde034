"""Register maps as files: those that ship, and every mistake of a map at once."""

from importlib.resources import files
from pathlib import Path

import pytest

from firmware_protocol import pmx, safety_io
from firmware_protocol.map_file import SHIPPED_MAPS, MapFileError, load_map, parse_map, shipped_map
from firmware_protocol.registers import (
    Register,
    RegisterMap,
    RegisterSpace,
    RegisterType,
    WordOrder,
)

EXAMPLES = Path(str(files("lmctl.examples")))
SCREW = (EXAMPLES / "feeder-rtu.toml").read_text()
COILS = (EXAMPLES / "feeder-coils.toml").read_text()

#: A feeder with as little as a map may say.
LEAST = """
name = "least"
device = "feeder"
register = [
  { name = "OUT", address = 0, type = "bits", writable = true },
]
hopper_register = [
  { name = "SET", address = 10, step = 1, unit = "g/min", counts_per_unit = 100, writable = true },
]
[hopper_values]
flow_setpoint_g_min = "SET"
[commands]
gas = [{ register = "OUT", bit = 0 }]
feed = [{ register = "OUT", bit = 1 }]
[missing]
identity = "none"
atomic_recipe = "ordered_writes"
watchdog = "interlock"
remote = "always"
gas_ok = "timed"
feeding = "commanded"
stable = "timed"
post_flow = "timed"
flow = "none"
alarm = "none"
clock = "none"
"""


def mistakes(text: str) -> tuple[str, ...]:
    with pytest.raises(MapFileError) as refused:
        parse_map(text)
    return refused.value.mistakes


@pytest.mark.parametrize("name", SHIPPED_MAPS)
def test_maps_that_ship_are_whole(name):
    assert shipped_map(name).registers_of_unit(None).rows


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("feeder-*.toml")), ids=lambda p: p.stem)
def test_example_maps_are_whole(path):
    found = load_map(path)
    assert found.feeder is not None
    for unit in found.unit_ids():
        found.registers_of_unit(unit)


def test_the_least_map_is_one():
    assert parse_map(LEAST).name == "least"


@pytest.mark.parametrize(
    ("meanings", "numbers"),
    [
        (shipped_map("pmx").bits["STATUS"], pmx.FeederStatusBits),
        (shipped_map("pmx").bits["STATUS_H"], pmx.HopperStatusBits),
        (shipped_map("pmx").bits["COMMAND"], pmx.FeederCommandBits),
        (shipped_map("pmx").codes["STATE"], pmx.FeederStateCode),
        (shipped_map("pmx").codes["MODE"], pmx.FeederMode),
        (shipped_map("pmx").codes["LAST_REFUSAL"], pmx.WriteRefusalCode),
        (shipped_map("sio").bits["INPUTS"], safety_io.SafetyInputBits),
        (shipped_map("sio").bits["STATUS"], safety_io.SafetyStatusBits),
    ],
)
def test_files_and_programs_give_bits_and_codes_the_same_names(meanings, numbers):
    known = {one.name: int(one) for one in numbers}
    if issubclass(numbers, int) and "Bits" in numbers.__name__:
        known = {name: value.bit_length() - 1 for name, value in known.items()}
    assert dict(meanings) == known


def test_the_identities_are_those_of_the_programs():
    assert shipped_map("pmx").identity.value == pmx.DEVICE_ID
    assert shipped_map("sio").identity.value == safety_io.DEVICE_ID


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"LOSS", space = "input", address = 103', '"LOSS", space = "input", address = 102',
         "register 'H1.LOSS': overlaps 'H1.RATE' at input register 102"),
        ("step = 20", "step = 1", "overlaps"),
        ("maximum = 15,", "maximum = 700,",
         "register 'GAS_SET': maximum 700 L/min takes 70000 counts at 100 counts per unit, and u16 "
         "holds 0 to 65535"),
        ('type = "u32", unit = "s"', 'type = "u33", unit = "s"', "register[5].type: must be 'u16'"),
        ('"STATE", space = "input", address = 2', '"STATE", space = "input", address = 0',
         "register 'STATE': address 0 is wire address -1 with base 1"),
        ("function_codes = [3, 4, 16]", "function_codes = [3, 16]",
         "register 'TYPE': it is an input register, and function_codes lacks 4"),
        ("function_codes = [3, 4, 16]", "function_codes = [3, 4]",
         "function_codes: no device can be driven without 16"),
        ("max_registers = 16", "max_registers = 1",
         "register 'RATE': it takes 2 registers, and max_registers is 1"),
        ('feed = [{ register = "CONTROL", bit = "RUN" }]\n', "", "commands.feed: is missing"),
        ('flow_setpoint_g_min = "RATE_SET"\n', "",
         "hopper_values.flow_setpoint_g_min: is missing"),
        ('bit = "STEADY"', 'bit = "STAEDY"', "register 'FLAGS' has no 'STAEDY'; it has HOST, GAS"),
        ('heartbeat = "ALIVE"', 'heartbeat = "ALIFE"', "did you mean 'ALIVE'?"),
        ('heartbeat = "ALIVE"\n', "", "watchdog.timeout: means nothing without"),
        ('heartbeat = "ALIVE"\ntimeout = "ALIVE_TIME"\n', "",
         'watchdog.heartbeat: is missing; if the device has none, write watchdog = "interlock"'),
        ('[missing]\n', '[missing]\nwatchdog = "interlock"\n',
         "missing.watchdog: the map has registers for it, too"),
        ('[missing]\n', '[missing]\nwatchdog = "hope"\n', "missing.watchdog: must be 'interlock'"),
        ('[missing]\n', '[missing]\nwatchdogs = "interlock"\n',
         "missing.watchdogs: there is no such key"),
        ('unit = "g/min", maximum = 90', 'unit = "lb/h", maximum = 90',
         "register 'RATE_SET' is in lb/h; g/min can be made of g/min, g/s"),
        ('weight_g = "NET_WEIGHT"', 'weight_g = "STATE"',
         "must be a register that each hopper has"),
        ('on = 1 }', 'on = 70000 }', "commands.alarm_reset[1].on: must be at most 65535"),
        ("code = 12", "code = 11", "alarm: two alarms have code 11"),
        ('"ACKNOWLEDGE", address = 2', '"ALIVE", address = 2', "2 registers have this name"),
        ("minimum = 100, maximum = 60000", "minimum = 70, maximum = 60",
         "register 'ALIVE_TIME': minimum 70 is above maximum 60"),
        ('alarm_code = "FAULT"\n', "", "values.alarm_code: is missing: alarms are listed by code"),
        ('name = "KR-2 screw feeder"', "name = 3", "name: must be text"),
        ('device = "feeder"', 'device = "fedeer"', "device: must be 'feeder' or 'safety'"),
        ("order = [", 'order = ["colour", ', "recipe.order: 'colour' is no set-point"),
        ("register = [", "register = [[", "not valid TOML"),
        ("[3, 4, 16]", "[3, 4, 16, 6]", "function_codes: 6 is not used here"),
        ("[3, 4, 16]", "[3, 4, 99]", "function_codes: must be whole numbers from 1 to 23"),
        ('type = "u32", unit = "s"', 'type = "ascii", unit = "s"',
         "register[5].length: is missing"),
        ('word_order = "CDAB"', 'word_order = "CDAB"\nhopper_unit = 11',
         "hopper_register[1].step: must be 0"),
        ('uptime_s = "RUN_TIME"', 'uptime_s = "FLAGS"', "values.uptime_s: register 'FLAGS' holds"),
        ('{ register = "FLAGS", bit = "HOST" }', '{ register = "FLAGS" }',
         "conditions.remote: needs either `bit` or `is`"),
        ('{ register = "FLAGS", bit = "HOST" }', '{ register = "RUN_TIME", bit = 0 }',
         "register 'RUN_TIME' is no word of bits"),
        ('{ register = "FLAGS", bit = "HOST" }', '{ register = "FLAGS", bit = -1 }',
         "must be names or whole numbers of at least 0"),
        ('heartbeat = "ALIVE"', 'heartbeat = "RATE_SET"',
         "watchdog.heartbeat: must be a register that the device has"),
        ('[{ register = "CONTROL", bit = "GAS" }]', "[]", "commands.gas: has no writes"),
        ('[{ register = "CONTROL", bit = "GAS" }]', '[{ register = "CONTROL" }]',
         "needs either `bit`, or `on`"),
        ('[{ register = "CONTROL", bit = "GAS" }]', '[{ register = "STATE", on = 1, off = 0 }]',
         "register 'STATE' is not writable"),
        ('[{ register = "CONTROL", bit = "GAS" }]', '{ register = "CONTROL" }',
         "commands.gas: must be an array of tables"),
        ('flow_setpoint_g_min = "RATE_SET"',
         'flow_setpoint_g_min = { register = "LOSS", full_scale = 9 }',
         "full_scale needs `maximum` of register 'LOSS'"),
        ("order = [", "order = 3 #", "recipe.order: must be a list of texts"),
        ("[missing]\n", "[[setting]]\nregister = \"STATE\"\nvalue = 1\n[missing]\n",
         "setting[1].register: register 'STATE' is not writable"),
        ("counts_per_unit = 10,", "counts_per_unit = inf,", "counts_per_unit: must be finite"),
        ('"TYPE", space = "input"', '"TYPE", space = "input", writable = true',
         "register 'TYPE': an input register cannot be written"),
        ('address = 3, type = "bits"', 'address = 3, type = "bits", counts_per_unit = 10',
         "register 'FLAGS': a value of type bits has no counts_per_unit"),
        ('stabilise_s = "SETTLE_TIME"', 'stabilise_s = "RUN_TIME"',
         "values.stabilise_s: register 'RUN_TIME' is not writable"),
        ('heartbeat = "ALIVE"', 'heartbeat = "TYPE"',
         "watchdog.heartbeat: register 'TYPE' is not writable"),
        ('timeout = "ALIVE_TIME"', 'timeout = "ACKNOWLEDGE"',
         "watchdog.timeout: register 'ACKNOWLEDGE' must be in ms or s"),
        ("[recipe]\n", '[recipe]\ncommit = "ACKNOWLEDGE"\n',
         "recipe.applied: is missing: the register that shows which recipe runs belongs to commit"),
        ('order = ["carrier_setpoint_L_min", ', "order = [",
         "recipe.order: lacks carrier_setpoint_L_min, which hopper_values has"),
        ('"GAS_TOTAL"\nstabilise', '"GAS_RATE"\nstabilise',
         "values.total_gas_L_min: must be a register that the device has"),
        ('level_low = { register = "HOPPER_FLAGS", bit = "LOW" }',
         'level_low = { register = "FLAGS", bit = 0 }',
         "hopper_conditions.level_low.register: must be a register that each hopper has"),
        ("counts_per_unit = 10,", 'counts_per_unit = "ten",', "counts_per_unit: must be a number"),
        ("counts_per_unit = 10,", "counts_per_unit = 0,", "counts_per_unit: must be above 0"),
        ("writable = true", "writable = 1", "writable: must be true or false"),
        ('[bits.CONTROL]\nHOST = 0\nGAS = 1\nRUN = 2\nWEIGHING_FROZEN = 3\n',
         "[bits]\nCONTROL = 3\n", "bits.CONTROL: must be a table"),
        ("step = 20", "step = -1", "step: must be a whole number from 1 to 65535"),
    ],
)
def test_a_contradiction_is_named_where_it_is(old, new, said):
    assert old in SCREW
    assert any(said in mistake for mistake in mistakes(SCREW.replace(old, new))), mistakes(
        SCREW.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[1, 2, 3, 4, 15, 16]", "[2, 3, 4, 15, 16]",
         "register 'HOST': it is a coil, and function_codes lacks 1: add 1"),
        ("[1, 2, 3, 4, 15, 16]", "[1, 3, 4, 15, 16]",
         "register 'STEADY': it is a discrete input, and function_codes lacks 2: add 2"),
        ("[1, 2, 3, 4, 15, 16]", "[1, 2, 3, 4, 16]",
         "register 'RUN': it is a coil to write, and function_codes lacks 15"),
        ('"STEADY", space = "discrete"', '"STEADY", space = "discrete", writable = true',
         "register 'STEADY': a discrete input cannot be written"),
        ('"RUN", space = "coil"', '"RUN", space = "coil", type = "u16"',
         "register 'RUN': a coil is of type bit, not u16"),
        ('"SERIES", space = "input"', '"SERIES", space = "input", type = "bit"',
         "register 'SERIES': type bit is for space = \"coil\" and \"discrete\""),
        ('"RUN", space = "coil"', '"RUN", space = "coil", unit = "g", maximum = 1',
         "register 'RUN': a coil is one bit: it has no unit"),
        ('"RUN", space = "coil"', '"RUN", space = "coil", unit = "g", maximum = 1',
         "register 'RUN': a coil is one bit: it has no maximum"),
        ('"RUN", space = "coil", address = 3', '"RUN", space = "coil", address = 2',
         "register 'RUN': overlaps 'GAS' at coil 2"),
        ('"RUN", space = "coil", address = 3', '"RUN", space = "coil", address = 0',
         "register 'RUN': address 0 is wire address -1 with base 1"),
        ('address = 11, step = 1', 'address = 5, step = 1', "overlaps 'ALIVE' at coil 5"),
        ('{ register = "STEADY" }', '{ register = "STEADY", bit = 0 }',
         "register 'STEADY' is one bit already: leave it out"),
        ('[{ register = "HOST" }]', '[{ register = "HOST", bit = 0 }]',
         "register 'HOST' is one bit already: leave it out"),
        ('[{ register = "HOST" }]', '[{ register = "STEADY" }]',
         "register 'STEADY' is not writable"),
        ('[{ register = "HOST" }]', '[{ register = "HOST", on = 2, off = 0 }]',
         "commands.remote: HOST must be between 0 and 1, not 2"),
        ('flow_g_min = "RATE"', 'flow_g_min = "LOW"',
         "hopper_values.flow_g_min: register 'LOW' holds no number"),
        ('timeout = "ALIVE_TIME"', 'timeout = "HOST"',
         "watchdog.timeout: register 'HOST' is one bit, and a number is needed"),
        ('[missing]\n', '[recipe]\ncommit = "HOST"\napplied = "STEADY"\n[missing]\n',
         "recipe.commit: register 'HOST' is one bit, and a number is needed"),
        ('[missing]\n', '[recipe]\ncommit = "HOST"\napplied = "STEADY"\n[missing]\n',
         "recipe.applied: register 'STEADY' is one bit, and a number is needed"),
        ('register = "DRIVE_FAULT"\n', "",
         "alarm[1]: needs either `code`, or `register` of a condition that shows it"),
        ('register = "DRIVE_FAULT"\n', 'register = "DRIVE_FAULT"\ncode = 7\n',
         "alarm[1]: needs either `code`, or `register` of a condition that shows it"),
        ('register = "SERIES"', 'register = "STEADY"',
         "identity.register: 'STEADY' is one bit, and tells no device"),
        ('[identity]', '[bits.HOST]\nON = 0\n[identity]',
         "bits.HOST: it is one bit already, and has no bits to name"),
    ],
)
def test_a_contradiction_of_coils_is_named_where_it_is(old, new, said):
    assert old in COILS
    assert any(said in mistake for mistake in mistakes(COILS.replace(old, new))), mistakes(
        COILS.replace(old, new))


def test_all_mistakes_of_a_map_come_at_once():
    text = SCREW.replace('"LOSS", space = "input", address = 103',
                         '"LOSS", space = "input", address = 102')
    text = text.replace("maximum = 15,", "maximum = 700,").replace("code = 12", "code = 11")
    text = text.replace('feed = [{ register = "CONTROL", bit = "RUN" }]\n', "")
    text = text.replace('atomic_recipe = "ordered_writes"\n', "")
    found = "\n".join(mistakes(text))
    for part in ("overlaps", "takes 70000 counts", "two alarms", "commands.feed", "recipe.commit"):
        assert part in found


def test_a_map_without_registers_is_none():
    assert "register: there is none: a map lists the device's registers" in mistakes(
        'name = "x"\ndevice = "safety"\n')


def test_a_file_that_is_no_text_or_too_large_is_refused(tmp_path):
    (tmp_path / "a.toml").write_bytes(b"name = '\xff'")
    (tmp_path / "b.toml").write_bytes(b"#" * 1_000_001)
    for name, said in (("a.toml", "not text: byte 8"), ("b.toml", "larger than 1,000,000 bytes")):
        with pytest.raises(MapFileError, match=said):
            load_map(tmp_path / name)


def test_an_analog_output_turns_flow_into_counts():
    """27648 counts are 10 V, and 10 V are 75 g/min: 30 g/min are 11059.2 counts."""
    analog = load_map(EXAMPLES / "feeder-analog.toml")
    quantity = analog.feeder.hopper_quantities["flow_setpoint_g_min"]
    table = analog.registers_of_unit(None)
    assert table.encode("H2.SPEED_V", quantity.to_register(30.0)) == (11059,)
    volts = table.decode("H2.SPEED_V", [11059])
    assert quantity.from_register(volts) == pytest.approx(30.0, abs=75 / 27648)
    assert table.wire_address("H2.SPEED_V") == 521


def test_a_live_zero_is_taken_off():
    """4 to 20 mA for 0 to 80 g/min: 12 mA are 40 g/min."""
    text = LEAST.replace('unit = "g/min", counts_per_unit = 100',
                         'unit = "mA", counts_per_unit = 1000, maximum = 20')
    text = text.replace('flow_setpoint_g_min = "SET"',
                        'flow_setpoint_g_min = { register = "SET", zero = 4, full_scale = 80 }')
    found = parse_map(text)
    quantity = found.feeder.hopper_quantities["flow_setpoint_g_min"]
    assert quantity.to_register(40.0) == pytest.approx(12.0)
    assert quantity.from_register(4.0) == 0.0


@pytest.mark.parametrize(
    ("order", "words"),
    [(WordOrder.ABCD, (0x40C8, 0xF5C3)), (WordOrder.CDAB, (0xF5C3, 0x40C8)),
     (WordOrder.BADC, (0xC840, 0xC3F5)), (WordOrder.DCBA, (0xC3F5, 0xC840))],
)
def test_floating_point_registers(order, words):
    """6.28 in single precision is 0x40C8F5C3."""
    table = RegisterMap([Register("F", RegisterSpace.HOLDING, 0, RegisterType.F32,
                                  may_be_unavailable=True, maximum=10.0)], word_order=order)
    assert table.encode("F", 6.28) == words
    assert table.decode("F", words) == pytest.approx(6.28, abs=1e-6)
    assert table.decode("F", table.encode("F", None)) is None
    with pytest.raises(ValueError, match="between"):
        table.encode("F", 10.5)
    with pytest.raises(ValueError, match="number"):
        table.encode("F", "six")


def test_a_scale_below_one_counts_in_steps():
    table = RegisterMap([Register("W", RegisterSpace.INPUT, 0, counts_per_unit=0.1, unit="g")])
    assert table.decode("W", [412]) == 4120.0
    assert table.encode("W", 4118) == (412,)
