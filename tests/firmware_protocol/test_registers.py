import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.registers import (
    MAX_READ_REGISTERS,
    Register,
    RegisterError,
    RegisterMap,
    RegisterSpace,
    RegisterType,
    WordOrder,
)


def one(kind: RegisterType, **settings) -> RegisterMap:
    word_order = settings.pop("word_order", WordOrder.ABCD)
    return RegisterMap([Register("R", RegisterSpace.HOLDING, 7, kind, **settings)],
                       word_order=word_order)


@pytest.mark.parametrize(
    ("order", "words"),
    [
        (WordOrder.ABCD, (0x1122, 0x3344)),
        (WordOrder.CDAB, (0x3344, 0x1122)),
        (WordOrder.BADC, (0x2211, 0x4433)),
        (WordOrder.DCBA, (0x4433, 0x2211)),
    ],
)
def test_word_orders(order, words):
    table = one(RegisterType.U32, word_order=order)
    assert table.encode("R", 0x11223344) == words
    assert table.decode("R", words) == 0x11223344


@given(st.integers(-(2**31), 2**31 - 1), st.sampled_from(WordOrder))
def test_signed_32_bit_values_survive_every_order(value, order):
    table = one(RegisterType.I32, word_order=order)
    words = table.encode("R", value)
    assert all(0 <= word <= 0xFFFF for word in words)
    assert table.decode("R", words) == value
    if order is WordOrder.ABCD:
        assert struct.pack(">HH", *words) == struct.pack(">i", value)


@given(st.integers(0, 0xFFFF))
def test_scaled_values_are_the_nearest_decimal(raw):
    table = one(RegisterType.U16, counts_per_unit=100)
    value = table.decode("R", [raw])
    assert value == float(f"{raw // 100}.{raw % 100:02d}")
    assert table.encode("R", value) == (raw,)


def test_values_are_rounded_to_the_nearest_count():
    table = one(RegisterType.U16, counts_per_unit=100)
    assert table.encode("R", 2.4492) == (245,)
    assert table.encode("R", 0.004) == (0,)


@pytest.mark.parametrize(
    ("kind", "code"),
    [(RegisterType.U16, (0xFFFF,)), (RegisterType.I16, (0x8000,)),
     (RegisterType.I32, (0x7FFF, 0xFFFF))],
)
def test_not_available(kind, code):
    table = one(kind, may_be_unavailable=True)
    assert table.encode("R", None) == code
    assert table.decode("R", code) is None
    number = one(kind).decode("R", code)
    assert number in (0xFFFF, -0x8000, 0x7FFF_FFFF)
    with pytest.raises(RegisterError, match="must be between"):
        table.encode("R", number)
    with pytest.raises(RegisterError, match="left out"):
        one(kind).encode("R", None)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf"), "12"])
def test_what_is_no_number_is_refused(value):
    with pytest.raises(RegisterError, match="must be a number"):
        one(RegisterType.U16).encode("R", value)


@pytest.mark.parametrize(
    ("kind", "value"),
    [(RegisterType.U16, -1), (RegisterType.U16, 0x1_0000), (RegisterType.I16, 0x8000),
     (RegisterType.U32, -1),
     (RegisterType.I32, 2**31), (RegisterType.BITS, 0x1_0000)],
)
def test_what_the_words_cannot_hold_is_refused(kind, value):
    with pytest.raises(RegisterError, match="must be between"):
        one(kind).encode("R", value)


def test_limits_are_reported_in_units():
    table = one(RegisterType.U16, counts_per_unit=10, unit="s", minimum=0, maximum=600)
    assert table.encode("R", 600) == (6000,)
    with pytest.raises(RegisterError, match=r"R must be between 0 and 600 s, not 600\.1"):
        table.encode("R", 600.1)


def test_text():
    table = one(RegisterType.ASCII, length=3)
    assert table.encode("R", "LOT7") == (0x4C4F, 0x5437, 0)
    assert table.decode("R", (0x4C4F, 0x5437, 0)) == "LOT7"
    assert table.decode("R", (0x4C4F, 0x0041, 0x4243)) == "LO"
    assert table.decode("R", (0xFF41, 0, 0)) == "�A"
    for bad in ("sevenup", "café", "a\0b", 5):
        with pytest.raises(RegisterError):
            table.encode("R", bad)


def test_manuals_that_count_from_one():
    rows = [Register("A", RegisterSpace.INPUT, 30001), Register("B", RegisterSpace.HOLDING, 40010)]
    table = RegisterMap(rows, input_base=30001, holding_base=40001)
    assert (table.wire_address("A"), table.wire_address("B")) == (0, 9)


@pytest.mark.parametrize(
    "rows",
    [
        [Register("A", RegisterSpace.INPUT, 0, RegisterType.U32),
         Register("B", RegisterSpace.INPUT, 1)],
        [Register("A", RegisterSpace.INPUT, 0), Register("A", RegisterSpace.INPUT, 1)],
        [Register("A", RegisterSpace.INPUT, 0, writable=True)],
        [Register("A", RegisterSpace.INPUT, 65_535, RegisterType.U32)],
        [Register("A", RegisterSpace.INPUT, -1)],
        [Register("A", RegisterSpace.INPUT, 0, RegisterType.ASCII)],
    ],
)
def test_contradictory_maps_are_refused(rows):
    with pytest.raises(RegisterError):
        RegisterMap(rows)


def test_input_and_holding_are_separate_spaces():
    RegisterMap([Register("A", RegisterSpace.INPUT, 0), Register("B", RegisterSpace.HOLDING, 0)])


def test_reads_are_planned_without_gaps():
    rows = [
        Register("A", RegisterSpace.INPUT, 0),
        Register("B", RegisterSpace.INPUT, 1, RegisterType.U32),
        Register("C", RegisterSpace.INPUT, 5),
        Register("D", RegisterSpace.HOLDING, 3),
    ]
    table = RegisterMap(rows)
    plan = table.plan_reads(["C", "D", "B", "A", "A"])
    assert {(b.kind, b.address, b.count) for b in plan} == {
        (RegisterSpace.INPUT, 0, 3), (RegisterSpace.INPUT, 5, 1), (RegisterSpace.HOLDING, 3, 1),
    }


@given(st.sets(st.integers(0, 400), min_size=1), st.integers(2, MAX_READ_REGISTERS))
def test_every_planned_read_fits_a_request_and_covers_its_rows(addresses, most):
    rows = [Register(f"R{a}", RegisterSpace.INPUT, a) for a in sorted(addresses)]
    plan = RegisterMap(rows).plan_reads([row.name for row in rows], most=most)
    covered = [a for block in plan for a in range(block.address, block.address + block.count)]
    assert sorted(covered) == sorted(addresses)
    assert all(block.count <= most for block in plan)


def test_a_block_moves_values_both_ways():
    rows = [
        Register("A", RegisterSpace.HOLDING, 10, counts_per_unit=10),
        Register("B", RegisterSpace.HOLDING, 12, RegisterType.I32),
    ]
    block = RegisterMap(rows).contiguous_block(["B", "A"])
    assert (block.address, block.count) == (10, 4)
    words = block.encode({"A": 1.5, "B": -2})
    assert words == [15, 0, 0xFFFF, 0xFFFE]
    assert block.decode(words) == {"A": 1.5, "B": -2}
    for wrong in (words[:-1], [*words, 0]):
        with pytest.raises(RegisterError, match="words came"):
            block.decode(wrong)


def test_of_a_block_only_some_rows_may_be_looked_at():
    rows = [
        Register("A", RegisterSpace.INPUT, 0, counts_per_unit=10),
        Register("B", RegisterSpace.INPUT, 1, RegisterType.I32),
        Register("C", RegisterSpace.INPUT, 3, RegisterType.I16),
        Register("D", RegisterSpace.INPUT, 4, RegisterType.ASCII, length=1),
    ]
    block = RegisterMap(rows).contiguous_block("ABCD")
    words = [15, 0xFFFF, 0xFFFE, 0x8000, 0x4142]
    assert block.decode(words) == {"A": 1.5, "B": -2, "C": -32768, "D": "AB"}
    assert block.restricted_to("BC").decode(words) == {"B": -2, "C": -32768}
    with pytest.raises(RegisterError, match="words came"):
        block.restricted_to("A").decode(words[:1])


def test_a_block_needs_rows_of_one_kind():
    table = RegisterMap([Register("A", RegisterSpace.INPUT, 0),
                         Register("B", RegisterSpace.HOLDING, 0)])
    for names in ([], ["A", "B"]):
        with pytest.raises(RegisterError):
            table.contiguous_block(names)


def test_an_input_is_never_written():
    with pytest.raises(RegisterError, match="A: an input cannot be written"):
        RegisterMap([Register("A", RegisterSpace.INPUT, 0, writable=True)])
