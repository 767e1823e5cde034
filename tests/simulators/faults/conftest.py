"""A bench in virtual time with raw wires: what a host would send, and what it would hear."""

from __future__ import annotations

import asyncio
import os
import tty
from collections.abc import Awaitable, Callable
from importlib.resources import files

import pytest

from firmware_protocol.pmx import PMX_MAP, FeederCommandBits, hopper_register_name
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig
from simulators.faults.fault_injector import FaultInjector
from simulators.faults.kinds import Fault
from simulators.safety_checks import SafetyChecks

SHIPPED = (files("lmctl.examples") / "bench.toml").read_text(encoding="utf-8")
SAFETY = "\n[safety]\nwatchdog_relay = false\n"


def cell_text(*replaced: tuple[str, str]) -> str:
    text = SHIPPED if "[safety]" in SHIPPED else SHIPPED + SAFETY
    for old, new in replaced:
        assert old in text
        text = text.replace(old, new)
    return text


class Cell:
    """A running bench. said : every byte the controller sent to the raw host"""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.board = FaultInjector(bench)
        self.loop = asyncio.get_running_loop()
        self.said = b""
        self._heartbeat = 0
        self._to_close = []
        self.reader: asyncio.StreamReader
        self.writer: asyncio.StreamWriter

    @property
    def now_s(self) -> float:
        return self.loop.time()

    @property
    def judge(self) -> SafetyChecks:
        return SafetyChecks(self.bench)

    def inject(self, kind: str, device: str = "", channel: int = 0, for_s=None, **values) -> int:
        return self.board.inject(Fault.create(kind, device, channel, **values), for_s)

    async def connect(self) -> None:
        port = int(self.bench.endpoints["motion"].rpartition(":")[2])
        self.reader, self.writer = await asyncio.open_connection("127.0.0.1", port)
        self._listening = asyncio.create_task(self._listen())
        self._to_close += [self._listening.cancel, self.writer.close]

    async def _listen(self) -> None:
        try:
            while data := await self.reader.read(65536):
                self.said += data
        except ConnectionError:
            pass

    async def send(self, text: str | bytes, then_s: float = 0.01) -> bytes:
        """Write to the controller; what it says within then_s."""
        before = len(self.said)
        self.writer.write(text.encode() if isinstance(text, str) else text)
        await asyncio.sleep(then_s)
        return self.said[before:]

    async def modbus(self, device: str = "F1") -> RawModbus:
        """A host's connection to a feeder, by bare frames."""
        endpoint = self.bench.endpoints[device]
        if endpoint.startswith("modbus-rtu"):
            raw = RawModbus.on_pty(endpoint.removeprefix("modbus-rtu://").partition("?")[0])
        else:
            raw = await RawModbus.on_tcp(int(endpoint.rpartition(":")[2]))
        self._to_close.append(raw.close)
        return raw

    async def drop(self) -> None:
        for close in self._to_close:
            close()

    def feed(self, feeder: str = "F1", g_min: float = 10.0) -> None:
        """Gas, recipe and discs on, as a host would command them; the watchdog is long."""
        device = self.bench.feeders[feeder]
        self._write(device, "COMMAND",
                    int(FeederCommandBits.ENABLE_REMOTE | FeederCommandBits.GAS_ON))
        self._write(device, "WD_TIMEOUT", 60_000)
        self._write(device, "STABILISE", 80)
        self._write(device, "SETPOINT_MODE", 1)
        self.recipe(feeder, g_min)
        self._write(device, "COMMAND", int(
            FeederCommandBits.ENABLE_REMOTE | FeederCommandBits.GAS_ON | FeederCommandBits.FEED_ON))

    def recipe(self, feeder: str, g_min: float) -> None:
        device = self.bench.feeders[feeder]
        for channel in device.hoppers:
            self._write(device, hopper_register_name(channel, "CARRIER_SP"), 500)
            self._write(device, hopper_register_name(channel, "FLOW_SP"), round(g_min * 100))
        self._heartbeat += 1
        self._write(device, "HEARTBEAT", self._heartbeat)
        self._write(device, "SEQ", self._heartbeat)

    def reset_alarm(self, feeder: str = "F1") -> None:
        self._write(self.bench.feeders[feeder], "ALARM_RESET", 1)

    @staticmethod
    def _write(device, name: str, word: int) -> None:
        device.write(PMX_MAP.wire_address(name), [word])


class RawModbus:
    """Frames out, bytes back. ask() numbers requests from 1 on TCP."""

    def __init__(self, write, close, is_rtu: bool) -> None:
        self._write, self.close, self._is_rtu = write, close, is_rtu
        self._number = 0
        self.got = b""

    @classmethod
    async def on_tcp(cls, port: int) -> RawModbus:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        raw = cls(writer.write, writer.close, False)
        raw._task = asyncio.create_task(raw._listen(reader))
        return raw

    @classmethod
    def on_pty(cls, path: str) -> RawModbus:
        line = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(line)
        loop = asyncio.get_running_loop()

        def close() -> None:
            loop.remove_reader(line)
            os.close(line)

        raw = cls(lambda data: os.write(line, data), close, True)

        def readable() -> None:
            raw.got += os.read(line, 4096)

        loop.add_reader(line, readable)
        return raw

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        try:
            while data := await reader.read(4096):
                self.got += data
            self.got += b"<closed>"
        except ConnectionError:
            self.got += b"<closed>"

    async def ask(self, address: int, count: int = 1, then_s: float = 0.01) -> bytes:
        """Read input registers: the bytes that come back within then_s."""
        self._number += 1
        request = bytes((1, 4)) + address.to_bytes(2, "big") + count.to_bytes(2, "big")
        if self._is_rtu:
            request += _crc(request)
        else:
            request = self._number.to_bytes(2, "big") + bytes((0, 0, 0, 6)) + request
        before = len(self.got)
        self._write(request)
        await asyncio.sleep(then_s)
        return self.got[before:]

    async def read(self, address: int, count: int = 1) -> list[int]:
        """The words of input registers; empty without an answer."""
        answer = await self.ask(address, count)
        words = answer[3:-2] if self._is_rtu else answer[9:]
        return [int.from_bytes(words[i : i + 2], "big") for i in range(0, len(words), 2)]


def _crc(data: bytes) -> bytes:
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc.to_bytes(2, "little")


@pytest.fixture(scope="session")
def play() -> Callable[..., object]:
    """Plays an async scene on a bench of its own: play(scene, *replacements in its text)."""

    def run(scene: Callable[[Cell], Awaitable[object]], *replaced: tuple[str, str]) -> object:
        async def main() -> object:
            async with Bench(BenchConfig.parse(cell_text(*replaced)), ephemeral_ports=True) as it:
                cell = Cell(it)
                await cell.connect()
                try:
                    return await scene(cell)
                finally:
                    cell.board.close()
                    await cell.drop()
                    await asyncio.sleep(0.01)

        return virtual_time.run_in_virtual_time(main())

    return run


@pytest.fixture(scope="session")
def bench_text() -> str:
    return cell_text()


@pytest.fixture(scope="session")
def bench_config() -> BenchConfig:
    return BenchConfig.parse(cell_text())
