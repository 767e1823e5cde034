"""Register maps as data: which value is at which Modbus address, and how its words are read.

A map is a table of `Register` rows with the device's habits (word order, address base) beside it.
It turns engineering values into 16-bit words and back; it sends nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from firmware_protocol.register_block import (
    PlacedRegister,
    Register,
    RegisterBlock,
    RegisterError,
    RegisterSpace,
    RegisterType,
    RegisterValue,
    WordOrder,
)

__all__ = [
    "MAX_BITS",
    "MAX_READ_REGISTERS",
    "MAX_WRITE_REGISTERS",
    "Register",
    "RegisterBlock",
    "RegisterError",
    "RegisterMap",
    "RegisterSpace",
    "RegisterType",
    "RegisterValue",
    "WordOrder",
]

#: Most registers one request may read (FC 03, 04) and write (FC 16), and most bits that one may
#: both read and write (FC 01, 02, 15), Modbus application protocol.
MAX_READ_REGISTERS = 125
MAX_WRITE_REGISTERS = 123
MAX_BITS = 1968

class RegisterMap:
    """The rows of one device and its habits.

    input_base, holding_base, coil_base, discrete_base : what the manual calls the one at wire
        address 0: 0, 1, or 30001, 40001, 1 and 10001
    Raises RegisterError where rows overlap, share a name, or leave the address space.
    """

    def __init__(
        self, rows: Iterable[Register], *, word_order: WordOrder = WordOrder.ABCD,
        input_base: int = 0, holding_base: int = 0, coil_base: int = 0, discrete_base: int = 0,
    ) -> None:
        self.rows = tuple(rows)
        self.word_order = word_order
        self._base = {
            RegisterSpace.INPUT: input_base, RegisterSpace.HOLDING: holding_base,
            RegisterSpace.COIL: coil_base, RegisterSpace.DISCRETE: discrete_base}
        self._by_name = {row.name: row for row in self.rows}
        if len(self._by_name) != len(self.rows):
            raise RegisterError("two rows of the map share a name")
        taken: dict[tuple[RegisterSpace, int], str] = {}
        for row in self.rows:
            self._check(row)
            for address in range(row.address, row.address + row.word_count):
                other = taken.setdefault((row.space, address), row.name)
                if other != row.name:
                    raise RegisterError(f"{row.name} and {other} overlap at {address}")

    def _check(self, row: Register) -> None:
        if row.writable and row.space in (RegisterSpace.INPUT, RegisterSpace.DISCRETE):
            raise RegisterError(f"{row.name}: an input cannot be written")
        if row.space.has_bits is not (row.type is RegisterType.BIT):
            raise RegisterError(f"{row.name}: coils and discrete inputs are of type BIT, and "
                                "nothing else is")
        if row.word_count < 1 or not 0 < row.counts_per_unit < float("inf"):
            raise RegisterError(f"{row.name}: length and scale must be above 0")
        first = self.wire_address(row.name)
        if first < 0 or first + row.word_count > 0x1_0000:
            raise RegisterError(f"{row.name}: wire address {first} is outside 0..65535")

    def __getitem__(self, name: str) -> Register:
        return self._by_name[name]

    def wire_address(self, name: str) -> int:
        row = self._by_name[name]
        return row.address - self._base[row.space]

    def encode(self, name: str, value: RegisterValue) -> tuple[int, ...]:
        """The words of one row. Raises RegisterError where the value does not fit."""
        return tuple(self.contiguous_block([name]).encode({name: value}))

    def decode(self, name: str, words: Sequence[int]) -> RegisterValue:
        """The value of one row's words; None where the device reports "not available"."""
        return self.contiguous_block([name]).decode(words)[name]

    def contiguous_block(self, names: Iterable[str]) -> RegisterBlock:
        """The rows, in any order, as one contiguous stretch; gaps stay inside it.

        Raises RegisterError for rows of both kinds, or none.
        """
        rows = sorted((self._by_name[name] for name in names), key=lambda row: row.address)
        if not rows or len({row.space for row in rows}) != 1:
            raise RegisterError("a block needs rows, all of one kind")
        start = self.wire_address(rows[0].name)
        placed = [PlacedRegister.from_register(row, row.address - rows[0].address) for row in rows]
        count = placed[-1].offset + placed[-1].word_count
        return RegisterBlock(rows[0].space, start, count, placed, self.word_order)

    def plan_reads(self, names: Iterable[str], *,
                   most: int = MAX_READ_REGISTERS) -> tuple[RegisterBlock, ...]:
        """The fewest gapless blocks that hold the rows, none longer than one request may read.

        most : registers; of bits one request moves up to MAX_BITS
        A gap would be answered by "illegal address" on many devices, so none is read across.
        """
        rows = [self._by_name[name] for name in dict.fromkeys(names)]
        rows.sort(key=lambda row: (row.space.value, row.address))
        runs: list[list[Register]] = []
        for row in rows:
            last = runs[-1] if runs else None
            if (
                last is not None
                and last[-1].space is row.space
                and last[-1].address + last[-1].word_count == row.address
                and row.address + row.word_count - last[0].address
                <= (MAX_BITS if row.space.has_bits else most)
            ):
                last.append(row)
            else:
                runs.append([row])
        return tuple(self.contiguous_block(row.name for row in run) for run in runs)
