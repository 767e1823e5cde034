"""The control socket: who may speak, what is answered, and that no client can hurt the run."""

from __future__ import annotations

import asyncio
import errno
import json
import os
import socket
import stat
import tempfile
from contextlib import ExitStack
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lmctl.errors import JournalError, UsageError
from lmctl.run.control import socket_path as control_path
from lmctl.run.control.server import (
    MAX_CLIENTS,
    MAX_REQUEST_BYTES,
    ControlCallbacks,
    ControlSocket,
    listening_socket,
    parse_request,
)
from simulators import virtual_time


class Run:
    """Stands where a run would: it can be held once."""

    def __init__(self, padding=0):
        self.state = "depositing"
        self.percent = 100
        self.came = []
        self.padding = "x" * padding

    def status(self):
        return {"state": self.state, "percent": self.percent, "padding": self.padding}

    def act(self, act, values):
        if act == "override":
            self.percent = values["percent"]
        elif act == "hold" and self.state == "depositing":
            self.state = "held"
        elif act == "height":
            self.height_mm = values["height_mm"]
        elif act == "refill":
            self.state = "refilling"
        else:
            raise UsageError(f"cannot {act} now", hint="wait")

    def on_act(self, act, operator, peer, refused):
        self.came.append((act, peer, refused))


def serve(folder, talk, run=None):
    """Serve a run in `folder` while `talk(run)` speaks to it; returns the run."""
    run = run or Run()

    async def main():
        with listening_socket(folder) as made:
            control = ControlSocket(made, ControlCallbacks(run.status, run.act, run.on_act))
            control.start()
            await talk(run)
            await control.close()

    virtual_time.run_in_virtual_time(main())
    return run


async def connected(folder):
    return await asyncio.open_unix_connection(str(folder / control_path.SOCKET_NAME))


async def asked(folder, *lines):
    """The answers to these lines, one connection."""
    reader, writer = await connected(folder)
    for line in lines:
        writer.write(line if isinstance(line, bytes) else json.dumps(line).encode() + b"\n")
    answers = [json.loads(await reader.readline()) for _ in lines]
    writer.close()
    await writer.wait_closed()
    return answers


def test_requests_are_answered_in_order_and_acts_are_reported(tmp_path):
    async def talk(run):
        said = await asked(tmp_path, {"do": "status"}, {"do": "hold"}, {"do": "hold"},
                           {"do": "override", "percent": 80}, {"do": "status"},
                           {"do": "refill", "hopper": "A"},
                           {"do": "refill", "hopper": "A", "lot": "L 7", "mass_g": 2000},
                           {"do": "height", "height_mm": 8.15},
                           {"do": "height", "height_mm": None})
        assert [answer["ok"] for answer in said[:5]] == [True, True, False, True, True]
        assert said[0]["state"] == "depositing"
        assert said[1]["state"] == "held"
        assert (said[2]["error"], said[2]["hint"]) == ("cannot hold now", "wait")
        assert said[4]["percent"] == 80

    run = serve(tmp_path, talk)
    assert [(act, refused) for act, _, refused in run.came] == [
        ("hold", ""), ("hold", "cannot hold now"), ("override 80 %", ""),
        ("refill A", ""), ("refill A with lot L 7, 2000 g", ""),
        ("height 8.15 mm", ""), ("height not measured", ""),
    ]
    assert {(peer.uid, peer.pid) for _, peer, _ in run.came} == {(os.getuid(), os.getpid())}


@pytest.mark.parametrize("line", [
    b"\n", b"hold\n", b"\x00\xff\xfe\n", b"[]\n", b"{}\n", b'{"do": 7}\n', b'{"do": "fire"}\n',
    b'{"do": ["hold"]}\n', b'{"do": "hold", "force": true}\n', b'{"do": "override"}\n',
    b'{"do": "height"}\n', b'{"do": "height", "height_mm": 0}\n',
    b'{"do": "height", "height_mm": "8"}\n', b'{"do": "height", "height_mm": true}\n',
    b'{"do": "height", "height_mm": 1e9}\n', b'{"do": "height", "height_mm": NaN}\n',
    b'{"do": "refill"}\n', b'{"do": "refill", "hopper": ""}\n',
    b'{"do": "refill", "hopper": "A", "lot": "L"}\n',
    b'{"do": "refill", "hopper": "A", "mass_g": 5}\n',
    b'{"do": "refill", "hopper": "A", "lot": "L", "mass_g": true}\n',
    b'{"do": "refill", "hopper": "A", "lot": "L", "mass_g": 0}\n',
    b'{"do": "refill", "hopper": "A", "lot": "L", "mass_g": 1e99}\n',
    b'{"do": "refill", "hopper": "A\\n", "lot": "L", "mass_g": 5}\n',
    b'{"do": "override", "percent": true}\n', b'{"do": "override", "percent": 1e2}\n',
    b'{"do": "override", "percent": 9999999999999}\n', b'{"do": "watch", "every_s": NaN}\n',
    b'{"do": "hold", "operator": 7}\n', b'{"do": "hold", "operator": "' + b"A" * 300 + b'"}\n',
    b'{"do": "watch", "every_s": 0}\n', b'{"do": "watch", "every_s": 1e400}\n',
    b'{"do": "status"' + b" " * MAX_REQUEST_BYTES + b"}\n", b"[" * 1000 + b"\n",
    b"x" * 100_000,
])
def test_nonsense_is_refused_and_its_sender_dropped(tmp_path, line):
    async def talk(run):
        reader, writer = await connected(tmp_path)
        writer.write(line)
        answer = json.loads(await reader.readline())
        assert answer["ok"] is False
        assert answer["error"]
        writer.write(b'{"do": "hold"}\n')
        with pytest.raises((asyncio.IncompleteReadError, ConnectionError)):
            await reader.readexactly(1)
        writer.close()
        assert (await asked(tmp_path, {"do": "status"}))[0]["ok"]

    assert serve(tmp_path, talk).came == []


@given(st.binary(max_size=1200))
@settings(max_examples=300, deadline=None)
def test_whatever_a_line_holds_it_is_a_request_or_a_usage_error(line):
    try:
        request = parse_request(line)
    except UsageError:
        return
    assert request["do"] in ("status", "watch", "hold", "resume", "stop", "override")


@given(st.lists(st.integers(1, 30), max_size=8))
@settings(max_examples=20, deadline=None,
          suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_requests_may_come_in_any_pieces(tmp_path, cuts):
    wire = b'{"do": "status"}\n{"do": "hold"}\n{"do": "override", "percent": 90}\n'

    async def talk(run):
        reader, writer = await connected(tmp_path)
        rest = wire
        for cut in cuts:
            writer.write(rest[:cut])
            await writer.drain()
            await asyncio.sleep(0.01)
            rest = rest[cut:]
        writer.write(rest)
        said = [json.loads(await reader.readline()) for _ in range(3)]
        assert [answer["ok"] for answer in said] == [True, True, True]
        writer.close()

    assert len(serve(tmp_path, talk).came) == 2


def test_half_a_line_asks_for_nothing(tmp_path):
    async def talk(run):
        _, writer = await connected(tmp_path)
        writer.write(b'{"do": "hold"}')
        writer.close()
        await asyncio.sleep(10)

    assert serve(tmp_path, talk).state == "depositing"


def test_a_client_that_never_reads_is_dropped_and_costs_the_others_nothing(tmp_path):
    async def talk(run):
        with socket.socket(socket.AF_UNIX) as deaf:
            deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            deaf.connect(str(tmp_path / control_path.SOCKET_NAME))
            deaf.sendall(b'{"do": "watch", "every_s": 0.1}\n')
            loop = asyncio.get_running_loop()
            for _ in range(200):
                before_s = loop.time()
                assert (await asked(tmp_path, {"do": "status"}))[0]["ok"]
                assert loop.time() - before_s < 0.5
                await asyncio.sleep(0.5)
            deaf.setblocking(False)
            got = 0
            while data := deaf.recv(65536):  # to its end: it has been closed
                got += len(data)
            assert got < 1_000_000

    serve(tmp_path, talk, Run(padding=10_000))


def test_of_too_many_clients_the_one_silent_for_longest_goes(tmp_path):
    async def talk(run):
        crowd = []
        for _ in range(3 * MAX_CLIENTS):
            crowd.append(await connected(tmp_path))
            await asyncio.sleep(0.001)
        assert (await asked(tmp_path, {"do": "hold"}))[0]["ok"]
        assert await crowd[0][0].read() == b""
        crowd[-1][1].write(b'{"do": "status"}\n')
        assert json.loads(await crowd[-1][0].readline())["ok"]
        for _, writer in crowd:
            writer.close()

    assert serve(tmp_path, talk).state == "held"


def test_a_flood_of_requests_leaves_the_loop_to_the_run(tmp_path):
    async def talk(run):
        loop = asyncio.get_running_loop()
        reader, writer = await connected(tmp_path)
        writer.write(b'{"do": "override", "percent": 90}\n' * 5000)
        began_s = loop.time()
        await reader.readline()
        await asyncio.sleep(1.0)
        assert loop.time() - began_s < 1.1
        assert len(run.came) <= 60  # 50 a second
        writer.close()

    serve(tmp_path, talk)


def test_who_watches_sees_how_it_ended(tmp_path):
    seen = []

    async def talk(run):
        reader, writer = await connected(tmp_path)
        writer.write(b'{"do": "watch", "every_s": 2}\n')
        for _ in range(3):
            seen.append(json.loads(await reader.readline())["state"])
        run.state = "done"

        async def rest():
            seen.append(json.loads(await reader.readline())["state"])
            assert await reader.read() == b""
            writer.close()

        talk.rest = asyncio.create_task(rest())
        await asyncio.sleep(0)

    async def main(run):
        await talk(run)

    def whole():
        run = Run()

        async def body():
            with listening_socket(tmp_path) as made:
                control = ControlSocket(made, ControlCallbacks(run.status, run.act, run.on_act))
                control.start()
                await main(run)
                await control.close()
                await talk.rest

        virtual_time.run_in_virtual_time(body())

    whole()
    assert seen == ["depositing"] * 3 + ["done"]


# --- where it is ------------------------------------------------------------------------------


@pytest.fixture
def session(monkeypatch):
    """A run-time folder, whose path leaves room for a socket's."""
    with tempfile.TemporaryDirectory(prefix="lmctl-", dir="/tmp") as name:
        monkeypatch.setenv("XDG_RUNTIME_DIR", name)
        yield Path(name)


def test_only_its_owner_may_open_it_and_it_is_gone_afterwards(tmp_path):
    with listening_socket(tmp_path):
        found = (tmp_path / control_path.SOCKET_NAME).stat()
        assert stat.S_ISSOCK(found.st_mode)
        assert stat.S_IMODE(found.st_mode) == 0o600
    assert list(tmp_path.iterdir()) == []


def test_a_folder_too_deep_for_a_socket_gets_a_link_to_one(tmp_path, session):
    deep = tmp_path / ("d" * 100) / "run-0001"
    deep.mkdir(parents=True)

    async def talk(run):
        assert (deep / control_path.SOCKET_NAME).is_symlink()
        client = control_path.connect_to_run(deep)
        assert client is not None
        client.close()

    serve(deep, talk)
    assert list(deep.iterdir()) == []
    assert list((session / "lmctl").iterdir()) == []


def test_two_runs_that_begin_at_once_in_deep_folders_get_a_socket_each(
    tmp_path, session, monkeypatch
):
    ours, theirs = (tmp_path / ("d" * 100) / name for name in ("run-0001", "run-0002"))
    ours.mkdir(parents=True)
    theirs.mkdir()
    renames = Path.rename
    with ExitStack() as open_sockets:

        def rename_when_the_other_has_begun(path, target):
            monkeypatch.setattr(Path, "rename", renames)
            other = open_sockets.enter_context(listening_socket(theirs))
            sockets.append(other)
            return path.rename(target)

        sockets = []
        monkeypatch.setattr(Path, "rename", rename_when_the_other_has_begun)
        sockets.insert(0, open_sockets.enter_context(listening_socket(ours)))
        for folder, listens in zip((ours, theirs), sockets, strict=True):
            with control_path.connect_to_run(folder):
                accepted, _ = listens.accept()  # raises where no client connected
                accepted.close()


def test_a_socket_that_cannot_be_made_leaves_nothing_behind(tmp_path, monkeypatch):
    def no_rename(path, target):
        raise PermissionError(errno.EACCES, "not here")

    monkeypatch.setattr(Path, "rename", no_rename)
    with pytest.raises(JournalError, match="no control socket"), listening_socket(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("named", ["", "gone", "relative"])
def test_without_a_folder_of_the_session_the_temporary_one_serves(
    tmp_path, session, monkeypatch, named
):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(session / "gone") if named == "gone" else named)
    monkeypatch.setattr(tempfile, "tempdir", str(session))
    deep = tmp_path / ("d" * 100) / "run-0001"
    deep.mkdir(parents=True)
    with listening_socket(deep):
        target = (deep / control_path.SOCKET_NAME).readlink()
        assert target.parent == session / f"lmctl-{os.getuid()}"


def test_a_foreign_run_time_folder_is_not_used(tmp_path, session):
    (session / "lmctl").mkdir()
    (session / "lmctl").chmod(0o777)
    deep = tmp_path / ("d" * 100) / "run-0001"
    deep.mkdir(parents=True)
    with pytest.raises(JournalError, match="no control socket"), listening_socket(deep):
        pass


def test_the_socket_of_a_dead_process_is_recognised_and_removed(tmp_path):
    left = socket.socket(socket.AF_UNIX)
    left.bind(str(tmp_path / control_path.SOCKET_NAME))
    left.close()
    assert control_path.connect_to_run(tmp_path) is None
    assert list(tmp_path.iterdir()) == []
    left = socket.socket(socket.AF_UNIX)
    left.bind(str(tmp_path / control_path.SOCKET_NAME))
    left.close()
    with listening_socket(tmp_path):
        assert (tmp_path / control_path.SOCKET_NAME).exists()


def test_a_living_one_keeps_a_second_out(tmp_path):
    with listening_socket(tmp_path), pytest.raises(JournalError, match="already drives"), \
            listening_socket(tmp_path):
        pass
