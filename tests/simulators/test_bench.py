"""The assembled cell: every device on its wire, embedded and as a process of its own."""

import asyncio
import json
import os
import signal
import socket
import stat
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import pytest
from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient

from simulators import virtual_time
from simulators.__main__ import main as serve
from simulators.bench import Bench, with_motion_on_pty
from simulators.bench_config import BenchConfig

SHIPPED = files("lmctl.examples") / "bench.toml"
CONFIG = BenchConfig.parse(SHIPPED.read_text(encoding="utf-8"))


def port_of(endpoint: str) -> int:
    return int(endpoint.rpartition(":")[2])


async def device_id(endpoint: str) -> int:
    if endpoint.startswith("modbus-tcp"):
        client = AsyncModbusTcpClient("127.0.0.1", port=port_of(endpoint), retries=0)
    else:
        path = endpoint.removeprefix("modbus-rtu://").partition("?")[0]
        client = AsyncModbusSerialClient(path, baudrate=19_200, parity="N", retries=0)
    assert await client.connect()
    answer = await client.read_input_registers(0, count=1, device_id=1)
    client.close()
    return answer.registers[0]


async def motion_identity(endpoint: str) -> bytes:
    reader, writer = await asyncio.open_connection("127.0.0.1", port_of(endpoint))
    writer.write(b"$I\n")
    answer = await reader.readuntil(b"ok\r\n")
    writer.close()
    await writer.wait_closed()
    return answer


def test_every_device_answers_where_it_says():
    async def main():
        async with Bench(CONFIG, ephemeral_ports=True) as bench:
            assert set(bench.endpoints) == {"motion", "F1", "F2", "scale"}
            assert len({port_of(endpoint) for endpoint in bench.endpoints.values()}) == 4
            assert b"lmctl-bench" in await motion_identity(bench.endpoints["motion"])
            assert await device_id(bench.endpoints["F1"]) == 0x504D
            assert await device_id(bench.endpoints["F2"]) == 0x504D
            assert list(bench.feeders) == ["F1", "F2"]

    virtual_time.run_in_virtual_time(main())


def test_feeders_on_ptys():
    text = SHIPPED.read_text(encoding="utf-8")
    config = BenchConfig.parse(text.replace("modbus-tcp://127.0.0.1:5021", "pty"))

    async def main():
        async with Bench(config, ephemeral_ports=True) as bench:
            assert bench.endpoints["F1"].startswith("modbus-rtu:///dev/pts/")
            assert await device_id(bench.endpoints["F1"]) == 0x504D

    virtual_time.run_in_virtual_time(main())


def test_motion_on_a_pty():
    async def main():
        async with Bench(with_motion_on_pty(CONFIG), ephemeral_ports=True) as bench:
            path = bench.endpoints["motion"].removeprefix("pty://")
            assert stat.S_ISCHR(os.stat(path).st_mode)

    virtual_time.run_in_virtual_time(main())


def test_leaving_frees_the_ports_and_keeps_the_record():
    async def main():
        async with Bench(CONFIG, ephemeral_ports=True) as bench:
            ports = [port_of(endpoint) for endpoint in bench.endpoints.values()]
        for port in ports:
            with pytest.raises(ConnectionRefusedError):
                await asyncio.open_connection("127.0.0.1", port)
        return bench.record

    record = virtual_time.run_in_virtual_time(main())
    assert len(record.beam_on_path().time_s) == 0
    assert record.fed_g() == {"316L": 0.0, "WC-12Co": 0.0}


@pytest.mark.parametrize("name", ["motion", "feeder F1"])
def test_a_taken_port_is_named_and_nothing_is_left_listening(name):
    async def main():
        blocker = await asyncio.start_server(lambda *_: None, "127.0.0.1", 0)
        port = blocker.sockets[0].getsockname()[1]
        key = name.rpartition(" ")[2]
        free = {k: type(a)(a.host, 0) for k, a in CONFIG.addresses.items()}
        taken = type(CONFIG.addresses[key])("127.0.0.1", port)
        config = BenchConfig(CONFIG.name, CONFIG.motion, CONFIG.feeders, free | {key: taken})
        bench = Bench(config)
        with pytest.raises(OSError, match=f"{name} cannot listen on 127.0.0.1:{port}"):
            async with bench:
                pass
        blocker.close()
        if "motion" in bench.endpoints:
            with pytest.raises(ConnectionRefusedError):
                await asyncio.open_connection("127.0.0.1", port_of(bench.endpoints["motion"]))

    virtual_time.run_in_virtual_time(main())


def start(*arguments: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-m", "simulators", *arguments], stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2],
    )


@pytest.mark.parametrize("interruption", [signal.SIGINT, signal.SIGTERM])
def test_as_a_process(tmp_path, interruption):
    bench = tmp_path / "bench.toml"
    text = SHIPPED.read_text(encoding="utf-8")
    for port in ("2323", "5021", "5022"):
        text = text.replace(f":{port}", ":0")
    bench.write_text(text, encoding="utf-8")
    process = start(str(bench), "--pty")
    try:
        endpoints = json.loads(process.stdout.readline())
        assert Path(endpoints["motion"].removeprefix("pty://")).is_char_device()
        assert asyncio.run(device_id(endpoints["F1"])) == 0x504D
        process.send_signal(interruption)
        rest, complaint = process.communicate(timeout=20)
        assert (process.returncode, rest, complaint) == (0, "", "")
    finally:
        process.kill()
        process.communicate()


def test_a_process_with_nothing_to_serve(tmp_path, capsys):
    (tmp_path / "bad.toml").write_text("[motion]\nspeed = 1\n", encoding="utf-8")
    for name, message in (
        ("bad.toml", "motion.speed: there is no such key"), ("none", "cannot read")
    ):
        assert serve([str(tmp_path / name)]) == 3
        out, complaint = capsys.readouterr()
        assert out == ""
        assert message in complaint


def test_a_process_whose_port_is_taken(tmp_path, capsys):
    with socket.create_server(("127.0.0.1", 0)) as blocker:
        port = blocker.getsockname()[1]
        bench = tmp_path / "bench.toml"
        bench.write_text(f'[motion]\nendpoint = "tcp://127.0.0.1:{port}"\n', encoding="utf-8")
        assert serve([str(bench)]) == 4
    out, complaint = capsys.readouterr()
    assert out == ""
    assert f"error: motion cannot listen on 127.0.0.1:{port}" in complaint
