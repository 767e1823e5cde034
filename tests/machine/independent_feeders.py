"""Feeders of the example maps, written from their manuals: addresses and words by hand.

Nothing here knows a map file or the simulators; pymodbus's own server answers.
"""

from __future__ import annotations

import asyncio
import struct
from contextlib import asynccontextmanager
from itertools import pairwise

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice


def now() -> float:
    return asyncio.get_running_loop().time()


class HandWrittenFeeder:
    """Registers by (unit, function, address on the wire). history : (time, flows [g/min])"""

    units = (1,)
    functions = (3, 16)
    most = 125

    def __init__(self) -> None:
        self.began_s = now()
        self.held: dict[tuple[int, int], int] = {}
        self.history: list[tuple[float, tuple[float, float]]] = [(now(), (0.0, 0.0))]
        self.gas: list[tuple[float, bool]] = [(now(), False)]
        self.written: list[tuple[int, int, tuple[int, ...]]] = []
        self.ignored: set[tuple[int, int]] = set()

    # what a device has to say

    def reported(self, unit: int, code: int) -> dict[int, int]:
        raise NotImplementedError

    def carry_out(self, unit: int, address: int) -> None:
        raise NotImplementedError

    # what the three have in common

    @property
    def flows_g_min(self) -> tuple[float, float]:
        return self.history[-1][1]

    @property
    def gas_on(self) -> bool:
        return self.gas[-1][1]

    def set_flows(self, *flows_g_min: float) -> None:
        if flows_g_min != self.flows_g_min:
            self.history.append((now(), flows_g_min))

    def set_gas(self, on: bool) -> None:
        if on != self.gas_on:
            self.gas.append((now(), on))

    def fed_g(self, channel: int, start_s: float = 0.0, end_s: float = float("inf")) -> float:
        steps = [*self.history, (now(), (0.0, 0.0))]
        return sum(
            flows[channel - 1] / 60.0 * max(0.0, min(end, end_s) - max(begin, start_s))
            for (begin, flows), (end, _) in pairwise(steps))

    def word(self, unit: int, address: int) -> int:
        return self.held.get((unit, address), 0)

    async def answer(self, unit, code, start, address, count, current, written):
        if code not in self.functions:
            return ExcCodes.ILLEGAL_FUNCTION
        if count > self.most:
            return ExcCodes.ILLEGAL_VALUE
        if written is not None:
            self.written.append((unit, address, tuple(written)))
            for at, word in enumerate(written, address):
                if (unit, at) not in self.ignored:
                    self.held[unit, at] = word
            self.carry_out(unit, address)
            return None
        known = self.reported(unit, code)
        for at in range(address, address + count):
            if at not in known:
                return ExcCodes.ILLEGAL_ADDRESS
            current[at - start] = known[at] & 0xFFFF
        return None

    def _device(self, unit):
        async def action(*request):
            return await self.answer(unit, *request)

        registers = SimData(0, count=9000, values=0, datatype=DataType.REGISTERS)
        return SimDevice(id=unit, simdata=[registers], action=action)

    @asynccontextmanager
    async def served(self):
        server = ModbusTcpServer([self._device(unit) for unit in self.units],
                                 address=("127.0.0.1", 0))
        await server.listen()
        try:
            yield f"modbus-tcp://127.0.0.1:{server.transport.sockets[0].getsockname()[1]}"
        finally:
            await server.shutdown()


def low_word_first(value: int) -> tuple[int, int]:
    return value & 0xFFFF, value >> 16 & 0xFFFF


def float_words(value: float) -> tuple[int, int]:
    return struct.unpack(">HH", struct.pack(">f", value))


class ScrewFeeder(HandWrittenFeeder):
    """KR-2. Number n of the manual is wire address n - 1; 32-bit values low word first."""

    functions = (3, 4, 16)
    most = 16

    def carry_out(self, unit, address):
        control = self.word(1, 0)
        self.set_gas(bool(control & 2) or (self.gas_on and now() < self._gas_until_s))
        sets = [self.word(1, 100 + 20 * h) | self.word(1, 101 + 20 * h) << 16 for h in (0, 1)]
        runs = bool(control & 4) and bool(control & 2)
        if not runs and any(self.flows_g_min):
            self._gas_until_s = now() + self.word(1, 5) / 10
        if runs and not self._runs:
            self.since_s = now()
        self._runs = runs
        self.set_flows(*(s / 1000 if runs else 0.0 for s in sets))

    _runs, _gas_until_s, since_s = False, -1.0, 0.0

    def reported(self, unit, code):
        gas = self.gas_on and (self._runs or bool(self.word(1, 0) & 2) or
                               now() < self._gas_until_s)
        if code == 3:
            return {at: self.word(1, at) for at in [*range(6), *range(100, 103),
                                                    *range(120, 123)]}
        steady = self._runs and now() - self.since_s >= self.word(1, 4) / 10
        known = {
            0: 1742, 1: 20 if self._runs else 10 if gas else 0,
            2: (self.word(1, 0) & 1) | gas << 1 | steady << 2, 3: 0,
            6: int(1000 * now()), 7: 80 if gas else 0,
        }
        known |= dict(enumerate(low_word_first(int(now() - self.began_s)), 4))
        for hopper in (0, 1):
            base, flow = 100 + 20 * hopper, round(1000 * self.flows_g_min[hopper])
            weight = round(100 * (5000 - self.fed_g(hopper + 1)))
            for at, value in ((base, flow), (base + 2, flow), (base + 4, weight)):
                known |= dict(enumerate(low_word_first(value), at))
            known |= {base + 6: 500, base + 7: self.word(1, base + 2) if gas else 0,
                      base + 8: gas << 3}
        return known


class DosingRack(HandWrittenFeeder):
    """Meridian. Unit 1 is the rack, 11 and 12 the heads; floats in kg/h, high word first."""

    units = (1, 11, 12)

    def carry_out(self, unit, address):
        self.set_gas(self.word(1, 10) == 1)
        flows = []
        for head in (11, 12):
            words = struct.pack(">HH", self.word(head, 10), self.word(head, 11))
            (kg_h,) = struct.unpack(">f", words)
            flows.append(kg_h * 1000 / 60 if self.word(head, 1) == 2 else 0.0)
        self.set_flows(*flows)

    def reported(self, unit, code):
        if unit == 1:
            clock = int(1000 * (now() - self.began_s))
            return {10: self.word(1, 10), 11: int(self.gas_on), 12: clock >> 16, 13: clock}
        flow = self.flows_g_min[unit - 11]
        known = {0: 7, 1: self.word(unit, 1), 2: int(self.word(unit, 1) == 2)}
        known |= {at: self.word(unit, at) for at in (10, 11, 12, 13)}
        for at, value in ((20, flow * 60 / 1000), (22, 4.0),
                          (24, 5.0 if self.gas_on else 0.0)):
            known |= dict(enumerate(float_words(value), at))
        return known


class AnalogModule(HandWrittenFeeder):
    """The module at 8192 says 750; outputs at 512, and 27648 counts for 10 V from 520 on."""

    most = 32

    def carry_out(self, unit, address):
        outputs = self.word(1, 512)
        self.set_gas(bool(outputs & 1))
        self.set_flows(*(75.0 * self.word(1, 520 + h) / 27648 if outputs & 2 else 0.0
                         for h in (0, 1)))

    def reported(self, unit, code):
        return {8192: 750, **{at: self.word(1, at) for at in (512, 520, 521)}}


class CoilFeeder(HandWrittenFeeder):
    """CD-2: coils from 1, discrete inputs from 10001. Its Modbus TCP is written here, too."""

    def __init__(self) -> None:
        super().__init__()
        self.coils = dict.fromkeys([*range(5), 10, 11], 0)
        self.since_s = self.beaten_s = now()
        self.beats = self.resets = 0

    @property
    def runs(self) -> bool:
        """RUN; the coil ENABLE of each hopper counts for its own flow only."""
        return bool(self.coils[2])

    def carry_out(self, unit, address):
        self.set_gas(bool(self.coils[1]))
        before = any(self.flows_g_min)
        turns = [self.runs and self.coils[10 + hopper] for hopper in (0, 1)]
        self.set_flows(*(self.word(1, 10 + 10 * hopper) / 100 if turns[hopper] else 0.0
                         for hopper in (0, 1)))
        if any(self.flows_g_min) and not before:
            self.since_s = now()

    def write_coils(self, address, bits):
        self.written.append((1, address, tuple(bits)))
        for at, bit in enumerate(bits, address):
            self.beats += at == 4 and bit != self.coils[4]
            self.resets += at == 3 and bit > self.coils[3]
            if (1, at) not in self.ignored:
                self.coils[at] = bit
        self.carry_out(1, address)

    def inputs(self):
        steady = self.runs and now() - self.since_s >= 3.0
        known = dict(enumerate([self.coils[0], int(self.gas_on), int(self.runs), int(steady), 0, 0,
                                0]))
        return known | {at + 10 * h: bit for h in (0, 1)
                        for at, bit in ((10, 0), (11, 0), (12, int(self.gas_on)))}

    def reported(self, unit, code):
        if code == 4:
            return {0: 4471, 1: int(1000 * now()), **{
                10 + 10 * h: round(100 * self.flows_g_min[h]) for h in (0, 1)}}
        return {at: self.word(1, at) for at in (0, 10, 20)}

    def reply(self, pdu):
        """The answer to a PDU, by the letter of the protocol."""
        code, address, count = struct.unpack_from(">BHH", pdu)
        try:
            if code in (1, 2):
                known = self.coils if code == 1 else self.inputs()
                bits = sum(known[address + at] << at for at in range(count))
                return struct.pack("BB", code, (count + 7) // 8) + bits.to_bytes(
                    (count + 7) // 8, "little")
            if code in (3, 4):
                known = self.reported(1, code)
                words = [known[at] & 0xFFFF for at in range(address, address + count)]
                return struct.pack(f">BB{count}H", code, 2 * count, *words)
            if code == 15:
                bits = int.from_bytes(pdu[6:], "little")
                if not all(at in self.coils for at in range(address, address + count)):
                    raise KeyError(address)
                self.write_coils(address, [bits >> at & 1 for at in range(count)])
                return pdu[:5]
            if code == 16:
                words = struct.unpack_from(f">{count}H", pdu, 6)
                self.written.append((1, address, words))
                for at, word in enumerate(words, address):
                    if (1, at) not in self.ignored:
                        self.held[1, at] = word
                self.carry_out(1, address)
                return pdu[:5]
            return struct.pack("BB", code | 0x80, 1)
        except KeyError:
            return struct.pack("BB", code | 0x80, 2)

    @asynccontextmanager
    async def served(self):
        talks = []

        class Talk(asyncio.Protocol):
            def connection_made(talk, transport):  # noqa: N805 (self is the feeder)
                talk.transport, talk.unread = transport, b""
                talks.append(transport)

            def data_received(talk, data):  # noqa: N805
                talk.unread += data
                while len(talk.unread) >= 7:
                    number, zero, length, unit = struct.unpack_from(">HHHB", talk.unread)
                    if len(talk.unread) < 6 + length:
                        return
                    pdu, talk.unread = talk.unread[7 : 6 + length], talk.unread[6 + length :]
                    answer = self.reply(pdu)
                    talk.transport.write(
                        struct.pack(">HHHB", number, zero, len(answer) + 1, unit) + answer)

        server = await asyncio.get_running_loop().create_server(Talk, "127.0.0.1", 0)
        try:
            yield f"modbus-tcp://127.0.0.1:{server.sockets[0].getsockname()[1]}"
        finally:
            server.close()
            for transport in talks:
                transport.close()
            await asyncio.sleep(0)


FEEDERS = {"coils": CoilFeeder, "rtu": ScrewFeeder, "tcp": DosingRack, "analog": AnalogModule}
