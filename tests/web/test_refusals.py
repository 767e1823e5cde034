"""What goes wrong between page, run and files, each said with what to do."""

from __future__ import annotations

import asyncio
import os
import socket
import sys
from contextlib import suppress

import httpx
import pytest

from lmctl.errors import ConfigError, JournalError, LmctlError, UsageError
from lmctl.run.control.server import listening_socket
from lmctl.web import report_process
from lmctl.web.access import AccessPolicy, read_token
from lmctl.web.application import dash_application
from lmctl.web.control_link import ControlLink
from lmctl.web.report_process import report_as_html_apart
from lmctl.web.run_catalogue import RunCatalogue
from lmctl.web.server import DashSettings, serve_dash
from tests.web.conftest import OPERATOR, bearer


def asked_of(folder, answer):
    """What a link raises that asks a stand-in of a run for its status. answer : b"" for none"""

    async def serve(reader, writer):
        with suppress(OSError):  # it goes away in the middle of an overlong answer
            await reader.readline()
            if answer is None:
                await reader.read()
            writer.write(answer or b"")
            await writer.drain()
        writer.close()
        ended.set()

    ended = asyncio.Event()

    async def main():
        with listening_socket(folder) as listening:
            server = await asyncio.start_unix_server(serve, sock=listening)
            try:
                async with ControlLink(folder) as link:
                    return await link.request("status")
            finally:
                await ended.wait()
                server.close()
                await asyncio.sleep(0)  # its transport closes

    with pytest.raises(LmctlError) as refusal:
        asyncio.run(main())
    return refusal.value


@pytest.mark.parametrize(("answer", "what", "hint"), [
    (b"[1]\n", "makes no sense", "another version"),
    (b"\xff\n", "makes no sense", "another version"),
    (b"{}\n", "makes no sense", "another version"),
    (b'{"ok": false, "error": "cannot hold now", "hint": "wait"}\n', "cannot hold now", "wait"),
    (b"x" * 2_000_000, "is not under way", "lmctl log"), (b"", "is not under way", "lmctl log"),
])
def test_what_a_run_answers_is_understood_or_refused(runs_dir, answer, what, hint):
    error = asked_of(runs_dir / "run-0001", answer)
    assert what in error.what
    assert hint in error.hint


def test_a_run_that_hangs_is_not_waited_for(runs_dir, monkeypatch):
    monkeypatch.setattr("lmctl.web.control_link.ANSWER_S", 0.1)
    error = asked_of(runs_dir / "run-0001", None)
    assert error.what == "run-0001 does not answer"
    assert "where it was started" in error.hint


def test_a_run_that_nothing_drives_cannot_be_acted_on(asking):
    _, act = asking(
        ("POST", "/api/seat", {"headers": bearer(OPERATOR), "json": {"operator": "Ada"}}),
        ("POST", "/api/runs/run-0001/acts", {
            "headers": bearer(OPERATOR), "json": {"act": "hold", "seen_state": "x", "number": 1}}))
    assert act.status_code == 403  # without the seat's key

    async def enter(folder):
        async with ControlLink(folder):
            pass

    with pytest.raises(JournalError, match="is not under way"):
        asyncio.run(enter(asking.runs_dir / "run-0001"))


def test_an_act_on_a_run_that_is_no_longer_as_it_was_seen_is_refused(runs_dir):
    async def serve(reader, writer):
        while await reader.readline():
            writer.write(b'{"ok": true, "state": "held"}\n')
            await writer.drain()
        writer.close()

    async def main():
        with listening_socket(runs_dir / "run-0001") as listening:
            server = await asyncio.start_unix_server(serve, sock=listening)
            async with RunCatalogue(runs_dir) as catalogue:
                app = dash_application(catalogue, AccessPolicy(OPERATOR))
                async with httpx.AsyncClient(transport=httpx.ASGITransport(app=app),
                                             base_url="http://127.0.0.1:8440") as client:
                    seat = await client.post(
                        "/api/seat", headers=bearer(OPERATOR), json={"operator": "Ada"})
                    headers = bearer(OPERATOR, **{"X-Operator-Seat": seat.json()["seat"]})
                    answer = await client.post(
                        "/api/runs/run-0001/acts", headers=headers,
                        json={"act": "hold", "seen_state": "depositing", "number": 1})
            server.close()
            await asyncio.sleep(0)
            return answer

    answer = asyncio.run(main())
    assert answer.json()["error"] == "cannot hold: the run is held, and you saw depositing"
    assert "look at the state" in answer.json()["hint"]


def test_a_layer_or_a_job_that_is_not_there_is_named(asking):
    there, beyond = asking(*[("GET", f"/api/runs/run-0001/layers/{n}", {}) for n in (1, 99)])
    assert there.status_code == 200
    assert there.json()["layer"] == 1
    assert beyond.json()["error"] == "the job has no layer 99"
    (asking.runs_dir / "run-0001/job.lmj").unlink()
    gone, = asking(("GET", "/api/runs/run-0001/layers/1", {}))
    assert "there is no file" in gone.json()["where"][0]
    (asking.runs_dir / "run-0001/journal.jsonl").write_text("no journal\n")
    unread, = asking(("GET", "/api/runs/run-0001/layers/1", {}))
    assert unread.json()["error"] == "the job of run-0001 cannot be read"


def test_too_many_viewers_are_asked_to_come_later(asking, monkeypatch):
    monkeypatch.setattr("lmctl.web.rest.MAX_VIEWERS", 0)
    answer, = asking(("GET", "/api/runs/run-0001/events", {}))
    assert (answer.status_code, "try again later") == (503, answer.json()["hint"])


def test_a_report_that_cannot_be_made_or_takes_too_long_is_refused(runs_dir, monkeypatch):
    journal = runs_dir / "run-0001/journal.jsonl"

    async def two_at_once():
        return await asyncio.gather(report_as_html_apart(journal), report_as_html_apart(journal),
                                    return_exceptions=True)

    monkeypatch.setattr(report_process, "MOST_S", 0.01)
    late, second = asyncio.run(two_at_once())
    assert "takes longer than" in late.what
    assert "has no such limit" in late.hint
    assert second.what == "another report is being made"
    monkeypatch.setattr(report_process, "MOST_S", 100.0)
    journal.write_text("no journal\n")
    with pytest.raises(JournalError, match="no report can be made") as refusal:
        asyncio.run(report_as_html_apart(journal))
    assert any("is not a run journal" in line for line in refusal.value.where)


def test_a_report_of_a_huge_journal_is_refused_at_once_with_the_command_that_makes_it(runs_dir):
    journal = runs_dir / "run-0001/journal.jsonl"
    os.truncate(journal, 10_000_000_000)  # a hole: it takes no room

    with pytest.raises(JournalError, match=r"holds 10\.0 GB") as refusal:
        asyncio.run(report_as_html_apart(journal))
    assert f"`lmctl report run-0001 --runs {runs_dir} -o report.html`" in refusal.value.hint


def test_a_token_that_cannot_be_read_is_refused(tmp_path):
    (tmp_path / "token").write_bytes(b"\xff" * 30)
    with pytest.raises(ConfigError, match="cannot read the token"):
        read_token(tmp_path / "token")


def test_a_port_of_opc_ua_in_use_is_named(tmp_path):
    pytest.importorskip("asyncua", reason="the extra `opcua` is not installed")
    from lmctl.web.opcua import OpcuaDoor

    async def main(port):
        async with OpcuaDoor(list, "127.0.0.1", port):
            pass

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(UsageError, match="cannot listen at") as refusal:
            asyncio.run(main(port))
    assert "--opcua names another port" in refusal.value.hint


@pytest.mark.parametrize(("module", "settings", "extra"), [
    ("uvicorn", DashSettings(port=0), "web"),
    ("asyncua", DashSettings(port=0, opcua_port=0), "opcua"),
])
def test_a_missing_extra_is_named(tmp_path, monkeypatch, module, settings, extra):
    from lmctl.web.access import AccessPolicy

    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.delitem(sys.modules, "lmctl.web.opcua", raising=False)
    with pytest.raises(UsageError, match="is not installed") as refusal:
        asyncio.run(serve_dash(tmp_path, settings, AccessPolicy(OPERATOR), print))
    assert refusal.value.hint == f"`pip install 'lmctl[{extra}]'`"
