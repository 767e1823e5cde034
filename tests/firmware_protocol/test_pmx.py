import pytest

from firmware_protocol import pmx, pmx_alarms
from firmware_protocol.registers import (
    MAX_READ_REGISTERS,
    MAX_WRITE_REGISTERS,
    RegisterError,
    RegisterSpace,
)


# docs/explanation/powder-delivery.md, Feeders, every documented address of the system block and
# the control registers
@pytest.mark.parametrize(
    ("name", "kind", "address"),
    [
        ("DEVICE_ID", RegisterSpace.INPUT, 0), ("MAP_VERSION", RegisterSpace.INPUT, 1),
        ("N_HOPPERS", RegisterSpace.INPUT, 3),
        ("SERIAL", RegisterSpace.INPUT, 4), ("STATUS", RegisterSpace.INPUT, 6),
        ("ALARM", RegisterSpace.INPUT, 7),
        ("WARNING", RegisterSpace.INPUT, 8), ("FIRST_ALARM_CODE", RegisterSpace.INPUT, 9),
        ("ALARM_COUNT", RegisterSpace.INPUT, 10), ("HEARTBEAT_ECHO", RegisterSpace.INPUT, 11),
        ("HEARTBEAT_AGE", RegisterSpace.INPUT, 12), ("UPTIME", RegisterSpace.INPUT, 13),
        ("MODE", RegisterSpace.INPUT, 15),
        ("STATE", RegisterSpace.INPUT, 16), ("TOTAL_FLOW", RegisterSpace.INPUT, 17),
        ("MIXER_PRESSURE", RegisterSpace.INPUT, 18), ("SEQ_APPLIED", RegisterSpace.INPUT, 21),
        ("LAST_REFUSAL", RegisterSpace.INPUT, 22), ("TICK", RegisterSpace.INPUT, 23),
        ("H1.STATUS", RegisterSpace.INPUT, 100), ("H1.WEIGHT", RegisterSpace.INPUT, 106),
        ("H4.LEVEL", RegisterSpace.INPUT, 408), ("H2.RUN_HOURS", RegisterSpace.INPUT, 219),
        ("COMMAND", RegisterSpace.HOLDING, 0), ("HEARTBEAT", RegisterSpace.HOLDING, 1),
        ("WD_TIMEOUT", RegisterSpace.HOLDING, 2), ("WD_RESET", RegisterSpace.HOLDING, 4),
        ("SEQ", RegisterSpace.HOLDING, 6),
        ("AT_SPEED_TOL", RegisterSpace.HOLDING, 11), ("H1.DISC_SP", RegisterSpace.HOLDING, 20),
        ("H1.FLOW_SP", RegisterSpace.HOLDING, 23), ("H4.FLOW_SP", RegisterSpace.HOLDING, 35),
        ("H1.FEED_FACTOR", RegisterSpace.HOLDING, 1100), ("H3.LOT", RegisterSpace.HOLDING, 1310),
    ],
)
def test_addresses(name, kind, address):
    row = pmx.PMX_MAP[name]
    assert (row.space, pmx.PMX_MAP.wire_address(name)) == (kind, address)
    assert row.writable == (kind is RegisterSpace.HOLDING)


def test_flows_are_in_hundredths():
    assert pmx.PMX_MAP.encode("H1.FLOW_SP", 2.45) == (245,)
    assert pmx.PMX_MAP.decode("H1.FLOW_EST", [245]) == 2.45
    assert pmx.PMX_MAP.decode("H1.WEIGHT", [0, 199_990 & 0xFFFF]) == pytest.approx(338.2)


def test_the_status_block_is_one_gapless_read():
    assert (pmx.SYSTEM_BLOCK.address, pmx.SYSTEM_BLOCK.count) == (0, 24)


@pytest.mark.parametrize("channel", [1, 2, 3, 4])
def test_a_hopper_is_one_gapless_read(channel):
    (block,) = pmx.PMX_MAP.plan_reads(pmx.hopper_input_names(channel))
    assert (block.address, block.count) == (100 * channel, 20)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_a_recipe_is_one_gapless_write_from_heartbeat_to_the_last_shadow_register(n):
    table = pmx.register_map(n)
    (block,) = table.plan_reads(pmx.recipe_register_names(n))
    assert block.address == 1
    assert block.address + block.count == 20 + 4 * n
    assert block.count <= MAX_WRITE_REGISTERS
    assert all(row.writable for row in block.rows)


def test_the_mirror_collides_with_nothing():
    holding = {
        a
        for row in pmx.PMX_MAP.rows if row.space is RegisterSpace.HOLDING
        for a in range(row.address, row.address + row.word_count)
    }
    size = pmx.mirror_offset(pmx.MAX_HOPPERS + 1)
    assert not holding & set(range(pmx.MIRROR_ADDRESS, pmx.MIRROR_ADDRESS + size))
    assert size <= MAX_READ_REGISTERS


def test_the_mirror_has_every_block_once_and_no_gap():
    at = pmx.SYSTEM_BLOCK.count
    for channel in range(1, pmx.MAX_HOPPERS + 1):
        assert pmx.mirror_offset(channel) == at
        at += pmx.PMX_MAP.contiguous_block(pmx.hopper_input_names(channel)).count
    assert at == pmx.mirror_offset(pmx.MAX_HOPPERS + 1)


def test_limits():
    with pytest.raises(RegisterError, match="between 0 and 2"):
        pmx.PMX_MAP.encode("WD_ACTION", 3)
    with pytest.raises(RegisterError, match=r"between 0 and 655\.35 g/min"):
        pmx.PMX_MAP.encode("H1.FLOW_SP", 700)


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (101, "the emergency-stop chain is open"),
        (104, "the host's heartbeat stopped, and its watchdog tripped"),
        (201, "hopper 1: drive fault"),
        (207, "hopper 1: it is empty"),
        (510, "hopper 4: it is too hot"),
        (355, "hopper 2: the set-point was clipped"),
        (999, "alarm 999, which its register map does not list"),
        (611, "alarm 611, which its register map does not list"),
    ],
)
def test_alarms_in_words(code, text):
    found = pmx_alarms.describe_alarm(code)
    assert (found.code, found.text) == (code, text)
    assert found.remedy


def test_hoppers_may_have_names():
    assert pmx_alarms.describe_alarm(307, {2: "B"}).text == "hopper B: it is empty"


def test_every_code_of_the_map_has_words_and_advice():
    codes = [*pmx_alarms.SYSTEM_CODES]
    codes += [
        pmx_alarms.hopper_alarm_code(h, n)
        for h in range(1, 5) for n in (*range(1, 11), *range(51, 56))
    ]
    assert all("does not list" not in pmx_alarms.describe_alarm(code).text for code in codes)


@pytest.mark.parametrize(("code", "bits", "text"), [
    (103, 1 << 2, "the mixer pressure is too high"),
    (103, 0, "the mixer pressure is too high"),  # a device that leaves the word alone
    (103, 1 << 2 | 1 << 1, "the mixer pressure is too high (and 1 more: the gas supply pressure is "
                           "low)"),
    (207, 1 << 8, "hopper A: it is empty"),
    (207, 1 << 8 | 1 << 9 | 1 << 3,
     "hopper A: it is empty (and 2 more: the host's heartbeat stopped, and its watchdog tripped; "
     "hopper 2 has one)"),
])
def test_the_first_alarm_names_the_others_that_are_active(code, bits, text):
    found = pmx_alarms.describe_first_out_alarm(code, bits, {1: "A"})
    assert (found.code, found.text) == (code, text)
    assert found.remedy == pmx_alarms.describe_alarm(code).remedy


def test_every_warning_bit_has_words_and_unknown_ones_say_so():
    every = pmx_alarms.describe_warnings(0xFFFF)
    assert [one.code for one in every] == list(range(51, 67))
    assert all(one.text and one.remedy for one in every)
    assert ["does not list" in one.text for one in every] == [False] * 5 + [True] * 11
    assert pmx_alarms.describe_warnings(0) == []


def test_refusals_in_words():
    for reason in pmx.WriteRefusalCode:
        assert "does not list" not in pmx_alarms.describe_refusal(reason)
    assert "does not list" in pmx_alarms.describe_refusal(77)
