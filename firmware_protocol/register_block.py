"""Rows of a register map, and the conversion of consecutive rows to words and back to values.

A `Register` defines the address and format of a value; a `Block` is what one request transfers.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from math import isfinite
from typing import NamedTuple

#: Largest number of an F32 row.
_LARGEST_F32 = 3.4028234663852886e38

#: What a register may hold: None is the device's "not available".
RegisterValue = int | float | str | None


class RegisterError(ValueError):
    """A value does not fit its register, or a map contradicts itself."""


class RegisterSpace(Enum):
    """Which of the four spaces of a Modbus device a row is in."""

    INPUT = "input"        # registers, read by FC 04
    HOLDING = "holding"    # registers, read by FC 03, written by FC 06 and 16
    COIL = "coil"          # single bits, read by FC 01, written by FC 15
    DISCRETE = "discrete"  # single bits (discrete inputs), read by FC 02

    @property
    def has_bits(self) -> bool:
        """Whether each address holds one bit, not a word."""
        return self in (RegisterSpace.COIL, RegisterSpace.DISCRETE)


class RegisterType(Enum):
    """How the words of a row are read: (words, least, greatest, code for "not available")."""

    U16 = (1, 0, 0xFFFF, 0xFFFF)
    I16 = (1, -0x8000, 0x7FFF, -0x8000)
    U32 = (2, 0, 0xFFFF_FFFF, 0xFFFF_FFFF)
    I32 = (2, -0x8000_0000, 0x7FFF_FFFF, 0x7FFF_FFFF)
    BITS = (1, 0, 0xFFFF, -1)
    BIT = (1, 0, 1, -1)    # a coil or a discrete input: its "word" is 0 or 1
    F32 = (2, 0, 0, -2)    # IEEE 754 single precision; a NaN is "not available"
    ASCII = (0, 0, 0, -1)  # two characters a word, first in the high byte, padded with NUL

    def __init__(self, words: int, least: int, greatest: int, not_available: int) -> None:
        self.words = words
        self.least = least
        self.greatest = greatest
        self.not_available = not_available


class WordOrder(Enum):
    """Byte order of a 32-bit value, A its most significant byte.

    Source: docs/explanation/motion-link.md, Word order of 32-bit registers.
    """

    ABCD = "ABCD"
    CDAB = "CDAB"
    BADC = "BADC"
    DCBA = "DCBA"


@dataclass(frozen=True)
class Register:
    """One row of a map.

    address : as the device's manual numbers it; the map's base is taken off for the wire
    counts_per_unit : counts in one unit: 100 for a register in 0.01 rpm, 0.1 for one in steps of
        10; decoded values are then floats. Unused by F32
    minimum, maximum : limits in units, within what the words can hold
    may_be_unavailable : the device may answer "not available"; that code is then no value
    length : words of an ASCII row; other types know theirs
    """

    name: str
    space: RegisterSpace
    address: int
    type: RegisterType = RegisterType.U16
    counts_per_unit: float = 1
    unit: str = ""
    description: str = ""
    writable: bool = False
    minimum: float | None = None
    maximum: float | None = None
    may_be_unavailable: bool = False
    length: int = 0

    @property
    def word_count(self) -> int:
        return self.length if self.type is RegisterType.ASCII else self.type.words


class PlacedRegister(NamedTuple):
    """A row within a block, with precomputed values for decoding and encoding.

    min_counts, max_counts : limits of its counts
    """

    name: str
    offset: int
    word_count: int
    counts_per_unit: float
    min_counts: int
    max_counts: int
    register: Register

    @classmethod
    def from_register(cls, row: Register, offset: int) -> PlacedRegister:
        low, high, missing = row.type.least, row.type.greatest, row.type.not_available
        if row.minimum is not None:
            low = max(low, round(row.minimum * row.counts_per_unit))
        if row.maximum is not None:
            high = min(high, round(row.maximum * row.counts_per_unit))
        if row.may_be_unavailable:  # its code is at one end of the range, and is no value
            low, high = low + (low == missing), high - (high == missing)
        return cls(row.name, offset, row.word_count, row.counts_per_unit, low, high, row)

    @property
    def is_single_number(self) -> bool:
        """Whether it is one word of whole counts, with a scale that keeps whole numbers whole."""
        return (self.word_count == 1 and isinstance(self.counts_per_unit, int)
                and self.register.type is not RegisterType.ASCII)


class RegisterBlock:
    """A stretch of registers, or of bits, that one request moves: `count` from wire address
    `address` on."""

    def __init__(
        self, kind: RegisterSpace, address: int, count: int, placed: Sequence[PlacedRegister],
        word_order: WordOrder,
    ) -> None:
        self.kind = kind
        self.address = address
        self.count = count
        self.rows = tuple(place.register for place in placed)
        self._placed = tuple(placed)
        self._word_order = word_order
        # Most rows are a number in one word.
        self._numbers = [
            (place.name, place.offset, place.counts_per_unit, place.min_counts, place.max_counts,
             place.register)
            for place in placed if place.is_single_number
        ]
        self._others = [place for place in placed if not place.is_single_number]

    def with_word_order(self, word_order: WordOrder) -> RegisterBlock:
        """The same stretch of registers of a device with another word order."""
        return RegisterBlock(self.kind, self.address, self.count, self._placed, word_order)

    def restricted_to(self, names: Iterable[str]) -> RegisterBlock:
        """The same stretch of registers, with only these rows decoded."""
        wanted = set(names)
        placed = [place for place in self._placed if place.name in wanted]
        return RegisterBlock(self.kind, self.address, self.count, placed, self._word_order)

    def decode(self, words: Sequence[int]) -> dict[str, RegisterValue]:
        """Values by name. Raises RegisterError where the number of words is not `count`."""
        if len(words) != self.count:
            raise RegisterError(f"{len(words)} words came where {self.count} were asked for")
        order = self._word_order
        values: dict[str, RegisterValue] = {}
        for name, offset, per_unit, low, high, row in self._numbers:
            raw = words[offset]
            if low <= raw <= high:
                values[name] = raw if per_unit == 1 else raw / per_unit
            else:
                values[name] = _decode(row, (raw,), order)
        for place in self._others:
            own = words[place.offset : place.offset + place.word_count]
            values[place.name] = _decode(place.register, own, order)
        return values

    def encode(self, values: Mapping[str, RegisterValue]) -> list[int]:
        """Words of the whole block; gaps are 0.

        Raises RegisterError for a value that does not fit; KeyError where one is missing.
        """
        words = [0] * self.count
        for name, offset, per_unit, low, high, row in self._numbers:
            value = values[name]
            if type(value) is int or (type(value) is float and isfinite(value)):
                raw = round(value * per_unit)
            else:
                raw = _rare_counts(row, value)
            if low <= raw <= high or value is None:
                words[offset] = raw & 0xFFFF
            else:
                raise _out_of_range(row, low, high, value)
        for place in self._others:
            own = _encode_other(place, values[place.name], self._word_order)
            words[place.offset : place.offset + place.word_count] = own
        return words


def _encode_other(place: PlacedRegister, value: RegisterValue, order: WordOrder) -> tuple[int, ...]:
    """Words of a text, or of a number in two words."""
    row = place.register
    if row.type is RegisterType.ASCII:
        return _encode_text(row, value)
    if row.type is RegisterType.F32:
        return _encode_float(row, value, order)
    if type(value) is float and isfinite(value):
        raw = round(value * place.counts_per_unit)
    else:
        raw = _rare_counts(row, value)
    if not place.min_counts <= raw <= place.max_counts and value is not None:
        raise _out_of_range(row, place.min_counts, place.max_counts, value)
    if place.word_count == 1:
        return (raw & 0xFFFF,)
    return _swapped((raw >> 16 & 0xFFFF, raw & 0xFFFF), order)


def _rare_counts(row: Register, value: RegisterValue) -> int:
    """Counts of a value that is neither a plain int nor a finite float."""
    if value is None and row.may_be_unavailable:
        return row.type.not_available
    if value is None:
        raise RegisterError(f"{row.name} cannot be left out")
    if isinstance(value, int):  # bool, and members of an IntEnum
        return round(int(value) * row.counts_per_unit)
    raise RegisterError(f"{row.name} must be a number, not {value!r}")


def _encode_float(row: Register, value: RegisterValue, order: WordOrder) -> tuple[int, ...]:
    """Words of a single-precision number."""
    if value is None and row.may_be_unavailable:
        number = float("nan")
    elif isinstance(value, int | float) and isfinite(value):
        number = float(value)
        low = -_LARGEST_F32 if row.minimum is None else row.minimum
        high = _LARGEST_F32 if row.maximum is None else row.maximum
        if not low <= number <= high:
            raise _out_of_range(row, low, high, value)
    else:
        raise RegisterError(f"{row.name} must be a number, not {value!r}")
    high_word, low_word = struct.unpack(">HH", struct.pack(">f", number))
    return _swapped((high_word, low_word), order)


def _out_of_range(row: Register, low: float, high: float, value: RegisterValue) -> RegisterError:
    """low, high : in counts; of an F32 row in units"""
    unit, per_unit = row.unit and f" {row.unit}", row.counts_per_unit
    if row.type is RegisterType.F32:
        per_unit = 1
    return RegisterError(
        f"{row.name} must be between {low / per_unit:g} and {high / per_unit:g}{unit}, not {value}"
    )


def _decode(row: Register, words: Sequence[int], order: WordOrder) -> RegisterValue:
    kind = row.type
    if kind is RegisterType.ASCII:
        text = b"".join((word & 0xFFFF).to_bytes(2, "big") for word in words)
        return text.split(b"\0")[0].decode("ascii", "replace")
    raw = words[0]
    if kind.words == 2:
        high, low = _swapped((words[0], words[1]), order)
        if kind is RegisterType.F32:
            (number,) = struct.unpack(">f", struct.pack(">HH", high & 0xFFFF, low & 0xFFFF))
            return number if isfinite(number) else None
        raw = high << 16 | low
    if raw > kind.greatest:
        raw -= 1 << (16 * kind.words)
    if row.may_be_unavailable and raw == kind.not_available:
        return None
    return raw if row.counts_per_unit == 1 else raw / row.counts_per_unit


def _encode_text(row: Register, value: RegisterValue) -> tuple[int, ...]:
    if not isinstance(value, str) or not value.isascii() or "\0" in value:
        raise RegisterError(f"{row.name} must be plain ASCII text, not {value!r}")
    if len(value) > 2 * row.length:
        raise RegisterError(f"{row.name} holds {2 * row.length} characters, not {len(value)}")
    data = value.encode("ascii").ljust(2 * row.length, b"\0")
    return tuple(int.from_bytes(data[i : i + 2], "big") for i in range(0, len(data), 2))


def _swapped(pair: tuple[int, int], order: WordOrder) -> tuple[int, int]:
    """High and low word in their order on the wire, or back: every order is its own inverse."""
    high, low = pair
    if order in (WordOrder.BADC, WordOrder.DCBA):
        high, low = (high >> 8 | high << 8) & 0xFFFF, (low >> 8 | low << 8) & 0xFFFF
    return (low, high) if order in (WordOrder.CDAB, WordOrder.DCBA) else (high, low)
