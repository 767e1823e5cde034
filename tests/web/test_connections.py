"""Connections that ask nothing, or never to the end, in virtual time: none stays."""

from __future__ import annotations

import asyncio
import json
from contextlib import asynccontextmanager

import h11
import pytest
import uvicorn

from lmctl.web.access import AccessPolicy
from lmctl.web.application import dash_application
from lmctl.web.connections import LOOK_S
from lmctl.web.protection import BODY_S, REQUESTS_AT_ONCE, request_rate
from lmctl.web.run_catalogue import RunCatalogue
from lmctl.web.server import DashSettings, _config, listening_tcp
from simulators import virtual_time
from tests.web.conftest import OPERATOR


@asynccontextmanager
async def served(runs_dir):
    """The page on a free port; gives (reader, writer) makers."""
    async with RunCatalogue(runs_dir) as catalogue:
        with listening_tcp("127.0.0.1", 0) as listening:
            rate = request_rate(asyncio.get_running_loop().time)
            app = dash_application(catalogue, AccessPolicy(OPERATOR), rate)
            server = uvicorn.Server(_config(app, DashSettings(), rate))
            serving = asyncio.create_task(server._serve([listening]))
            while not server.started:  # noqa: ASYNC110 (it has no event)
                await asyncio.sleep(0.1)
            yield lambda: asyncio.open_connection(*listening.getsockname())
            server.should_exit = True
            await serving


@pytest.mark.parametrize("sent", [
    b"", b"GET / HTTP/1.1\r\n", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ",
])
def test_a_connection_without_a_whole_request_is_closed(runs_dir, sent):
    async def main():
        loop = asyncio.get_running_loop()
        async with served(runs_dir) as connect:
            reader, writer = await connect()
            writer.write(sent)
            began_s = loop.time()
            assert await reader.read() == b""
            assert loop.time() - began_s == pytest.approx(LOOK_S, abs=0.5)
            writer.close()

    virtual_time.run_in_virtual_time(main())


def test_a_body_that_never_comes_is_not_waited_for(runs_dir):
    async def main():
        loop = asyncio.get_running_loop()
        async with served(runs_dir) as connect:
            reader, writer = await connect()
            writer.write(b"POST /api/seat HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 9\r\n"
                         b"Content-Type: application/json\r\n\r\n{")
            began_s = loop.time()
            answer = await reader.readline()
            assert b" 408 " in answer
            assert loop.time() - began_s == pytest.approx(BODY_S, abs=0.5)
            writer.close()

    virtual_time.run_in_virtual_time(main())


def test_a_viewer_that_stays_is_not_cut(runs_dir):
    async def main():
        loop = asyncio.get_running_loop()
        async with served(runs_dir) as connect:
            reader, writer = await connect()
            writer.write(b"GET /api/runs/run-0001/events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
            began_s = loop.time()
            while loop.time() - began_s < 5 * LOOK_S:
                assert await reader.readline() != b""
            writer.close()

    virtual_time.run_in_virtual_time(main())


def test_a_flood_is_refused_before_it_is_parsed_and_others_are_not(runs_dir, monkeypatch):
    get = b"GET /api/session HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    parsed = []
    receive = h11.Connection.receive_data
    monkeypatch.setattr(h11.Connection, "receive_data",
                        lambda self, data: (parsed.append(data), receive(self, data))[1])

    async def main():
        async with served(runs_dir) as connect:
            async def ask(sent=get):
                reader, writer = await connect()
                writer.write(sent)
                answer = await reader.readuntil(b"\r\n\r\n")
                length = int(answer.lower().partition(b"content-length: ")[2].split(b"\r\n")[0])
                body = json.loads(await reader.readexactly(length))
                writer.close()
                return answer, body

            poster, writer = await connect()  # let in before, with its body still to come
            writer.write(b"POST /api/seat HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 2\r\n"
                         b"Content-Type: application/json\r\n\r\n")
            answers = [await ask() for _ in range(int(REQUESTS_AT_ONCE) - 1)]
            assert {answer.split()[1] for answer, _ in answers} == {b"200"}
            before = len(parsed)
            answer, body = await ask()
            assert answer.split()[1] == b"429"
            assert b"\r\nretry-after: 1\r\n" in answer
            assert b"\r\nContent-Security-Policy: default-src 'none'" in answer
            assert "requests a second" in body["error"]
            await ask(b"no HTTP at all")
            assert len(parsed) == before
            writer.write(b"{}")
            assert (await poster.readline()).split()[1] == b"401"
            writer.close()
            await asyncio.sleep(1.0)
            assert (await ask())[0].split()[1] == b"200"

    virtual_time.run_in_virtual_time(main())
