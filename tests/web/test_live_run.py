"""A page and a run in processes of their own: what viewers get, who may act, what cannot hurt."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import time
from contextlib import ExitStack
from urllib.parse import urlsplit

import httpx

from lmctl.run.journal.format import read_records, verify_journal
from tests.web.conftest import bearer, eventually

ACTS = "api/runs/run-0001/acts"


def events_of(url, until, token=""):
    """Events (name, data) of a stream, until one fulfils a condition."""
    found = []
    headers = bearer(token) if token else {}
    with httpx.stream("GET", url, timeout=100.0, headers=headers, verify=False) as answer:
        assert answer.headers["content-type"] == "text/event-stream"
        name = ""
        for line in answer.iter_lines():
            if line.startswith("event: "):
                name = line[7:]
            elif line.startswith("data: "):
                found.append((name, json.loads(line[6:])))
                if until(*found[-1]):
                    return found
    raise AssertionError("the stream ended")


def test_it_is_shown_live_and_held_resumed_and_stopped_by_one_operator(live_page):
    page = live_page()
    page.state_is("depositing")
    stream = events_of(page.url + "api/runs/run-0001/events",
                       lambda name, data: name == "snapshot" and data["line"] > 40)
    assert stream[0][0] == "everything"
    assert stream[0][1]["snapshot"]["live"]
    lines = [data["line"] for name, data in stream if name == "snapshot"]
    assert any(name == "points" for name, _ in stream)
    assert lines == sorted(lines)

    seat = page.post("api/seat", {"operator": "Bob"}).json()["seat"]
    assert page.post("api/seat", {"operator": "Eve"}).status_code == 409

    def act(what, seen, number, key=seat, **more):
        return page.post(ACTS, {"act": what, "seen_state": seen, "number": number, **more},
                         **{"X-Operator-Seat": key})

    assert act("hold", "depositing", 1, key="stolen").status_code == 403
    assert act("stop", "held", 1).status_code == 409
    held = act("hold", "depositing", 1)
    assert held.status_code == 200, held.text
    now = page.state_is("held")
    assert now["held_by"] == "the operator"
    assert now["reentry"]["layer"] == 1
    replayed = act("hold", "held", 1)
    assert replayed.status_code == 409
    assert "sent before" in replayed.json()["error"]
    assert "900 % is not possible" in act("override", "held", 2, percent=900).json()["error"]
    assert act("override", "held", 3, percent=80).json()["override_percent"] == 80
    assert act("refill", "held", 4, hopper="A", key="stolen").status_code == 403
    assert act("refill", "held", 4, hopper="Z").status_code == 409
    assert act("refill", "held", 5, hopper="A").json()["refill_hopper"] == "A"
    assert page.state_is("refilling")["refill_hopper"] == "A"
    assert act("refill", "refilling", 6, hopper="A", lot="HEAT-7").status_code == 409
    assert act("refill", "refilling", 7, hopper="A", lot="HEAT-7", mass_g=12.5).status_code == 200
    assert page.state_is("held")["refill_hopper"] is None
    assert act("resume", "held", 8).status_code == 200
    page.state_is("depositing")
    assert act("stop", "depositing", 9).status_code == 200
    ended = page.state_is("stopped")
    assert not ended["live"]
    assert ended["next"][0]["command"] == "lmctl recover run-0001"

    page.run.communicate(timeout=100)
    journal = page.folder / "runs/run-0001/journal.jsonl"
    assert verify_journal(journal).sealed
    (filled,) = [one for one in read_records(journal) if one["kind"] == "refill"]
    assert (filled["hopper"], filled["lot"], filled["mass_g"]) == ("A", "HEAT-7", 12.5)
    acts = [(one["act"], one["operator"], one["accepted"])
            for one in read_records(journal) if one["kind"] == "operator"]
    assert acts == [
        ("hold", "Bob (live page, 127.0.0.1)", True),
        ("override 900 %", "Bob (live page, 127.0.0.1)", False),
        ("override 80 %", "Bob (live page, 127.0.0.1)", True),
        ("refill Z", "Bob (live page, 127.0.0.1)", False),
        ("refill A", "Bob (live page, 127.0.0.1)", True),
        ("refill A with lot HEAT-7, 12.5 g", "Bob (live page, 127.0.0.1)", True),
        ("resume", "Bob (live page, 127.0.0.1)", True),
        ("stop", "Bob (live page, 127.0.0.1)", True)]
    report = page.get("api/runs/run-0001/report.html")
    assert report.status_code == 200
    assert "run-0001" in report.text
    assert "sandbox" in report.headers["content-security-policy"]


def test_a_page_that_is_stalled_flooded_and_killed_touches_no_run(live_page):
    page = live_page(side_mm=40.0, speed=20.0)
    page.state_is("depositing")
    with ExitStack() as deaf:
        for _ in range(5):  # browsers that never read
            one = deaf.enter_context(socket.create_connection(
                (urlsplit(page.url).hostname, urlsplit(page.url).port)))
            one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
            one.sendall(b"GET /api/runs/run-0001/events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        own = os.getpriority(os.PRIO_PROCESS, 0)
        assert os.getpriority(os.PRIO_PROCESS, page.dash.pid) == min(own + 10, 19)
        assert os.sched_getscheduler(page.dash.pid) == os.SCHED_BATCH
        codes = {page.get("api/session").status_code for _ in range(200)}
        assert codes <= {200, 429}
        events_of(page.url + "api/runs/run-0001/events", lambda name, data: name == "everything")
        os.kill(page.dash.pid, signal.SIGSTOP)
        time.sleep(0.5)
        page.dash.kill()
    out, talk = page.run.communicate(timeout=100)
    assert page.run.returncode == 0, talk
    assert re.match("run-0001: done", out)
    journal = page.folder / "runs/run-0001/journal.jsonl"
    assert verify_journal(journal).sealed
    assert [one for one in read_records(journal) if one["kind"] in ("alarm", "operator")] == []


def test_a_run_that_dies_is_shown_as_broken_off_and_a_new_one_appears(live_page):
    page = live_page()
    page.state_is("depositing")
    page.run.send_signal(signal.SIGKILL)
    page.run.wait()
    now = page.state_is("broken off")
    assert not now["live"]
    assert "recover" in now["next"][0]["command"]
    assert eventually(lambda: page.get("metrics").text.splitlines()[2] == "lmctl_runs 0")
