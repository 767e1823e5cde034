"""What the page refuses before anything of it is reached, and what it never serves."""

from __future__ import annotations

import asyncio

import httpx
import pytest
from starlette.responses import PlainTextResponse

from lmctl.web.access import AccessPolicy
from lmctl.web.application import PAGE_FILES
from lmctl.web.protection import (
    MAX_BODY_BYTES,
    REQUESTS_AT_ONCE,
    REQUESTS_PER_S,
    RequestProtection,
)
from tests.web.conftest import OPERATOR, VIEWER, bearer

READING = ["/api/runs", "/api/runs/run-0001", "/api/runs/run-0001/layers/1", "/metrics",
           "/api/runs/run-0001/events", "/api/runs/run-0001/report.html"]
ACT = {"act": "hold", "seen_state": "depositing", "number": 1}


def test_every_answer_carries_the_security_headers(asking):
    found = asking(
        ("GET", "/", {}), ("GET", "/page/dash.js", {}), ("GET", "/nowhere", {}),
        ("GET", "/api/runs", {}), ("POST", "/api/seat", {"headers": bearer("wrong")}),
        ("GET", "/", {"headers": {"Host": "evil.example"}}))
    assert [answer.status_code for answer in found] == [200, 200, 404, 200, 401, 421]
    for answer in found:
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert answer.headers["x-frame-options"] == "DENY"
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert "server" not in answer.headers


def test_the_page_loads_nothing_from_elsewhere_and_has_no_script_in_its_text(asking):
    names = [f"/page/{name}" for name in PAGE_FILES]
    for name, answer in zip(names, asking(*[("GET", name, {}) for name in names]), strict=True):
        assert answer.status_code == 200
        if "uPlot" not in name:
            assert "://" not in answer.text.replace("https://github.com", "")
        if name.endswith("html"):
            assert "<style" not in answer.text
            assert " style=" not in answer.text
            assert answer.text.count("<script") == answer.text.count("<script src") + (
                answer.text.count('<script type="module" src'))


@pytest.mark.parametrize("path", [
    "/page/../rest.py", "/page/%2e%2e/rest.py", "/page/..%2frest.py", "/page/....//rest.py",
    "/page//etc/passwd", "/../../etc/passwd", "/page/%00", "/page/index.html%00.js",
    "/api/runs/..", "/api/runs/%2e%2e/events", "/api/runs/..%2f..%2fetc", "/api/runs/run-9999",
    "/api/runs/run-0001%2f..%2frun-0001", "/api/runs/run-0001/layers/-1",
    "/api/runs/run-0001/layers/99999999999999999999",
])
def test_a_path_leads_nowhere_else(asking, path):
    answer, = asking(("GET", path, {}))
    assert answer.status_code in (404, 409), answer.text
    assert "root:" not in answer.text
    assert "import" not in answer.text


@pytest.mark.parametrize("path", READING)
def test_reading_needs_a_token_where_viewers_have_one(asking, path):
    tokens = [None, "wrong", OPERATOR + "x"]
    found = asking(*[("GET", path, {"headers": bearer(one) if one else {}}) for one in tokens],
                   access=AccessPolicy(OPERATOR, VIEWER, None))
    assert [answer.status_code for answer in found] == [401, 401, 401]
    assert all("run-0001" not in answer.text for answer in found)


def test_a_viewer_reads_and_cannot_act(asking):
    seat = bearer(VIEWER)
    found = asking(
        ("GET", "/api/runs", {"headers": seat}),
        ("GET", "/api/session", {"headers": seat}),
        ("POST", "/api/seat", {"headers": seat, "json": {"operator": "Eve"}}),
        ("POST", "/api/runs/run-0001/acts", {"headers": seat, "json": ACT}),
        ("DELETE", "/api/seat", {"headers": seat}),
        access=AccessPolicy(OPERATOR, VIEWER, None))
    assert [answer.status_code for answer in found] == [200, 200, 401, 401, 401]
    assert found[1].json()["role"] == "viewer"
    assert "token of an operator" in found[3].json()["error"]


def test_no_other_page_can_act_in_an_operators_name(asking):
    def post(**headers):
        return ("POST", "/api/seat", {"headers": bearer(OPERATOR) | headers,
                                      "content": b'{"operator": "Eve"}'})

    found = asking(
        post(Origin="https://evil.example"), post(Origin="null"),
        post(**{"Sec-Fetch-Site": "cross-site"}), post(**{"Sec-Fetch-Site": "same-site"}),
        post(**{"Content-Type": "text/plain"}),
        post(**{"Content-Type": "application/x-www-form-urlencoded"}),
        post(Host="evil.example:8440"), post(Origin="http://127.0.0.1:8440"))
    assert [answer.status_code for answer in found] == [403, 403, 403, 403, 415, 415, 421, 200]


def test_bodies_are_bounded_whatever_they_say_of_their_length(asking):
    async def endless():
        while True:
            yield b"x" * 1000

    found = asking(
        ("POST", "/api/seat", {"headers": bearer(OPERATOR), "content": b"x" * MAX_BODY_BYTES * 2}),
        ("POST", "/api/seat", {"headers": bearer(OPERATOR), "content": endless()}),
        ("POST", "/api/seat", {"headers": bearer(OPERATOR, **{"Content-Length": "-5"}),
                               "content": b""}),
        *[("POST", "/api/seat", {"headers": bearer(OPERATOR), "content": body})
          for body in (b"[]", b"{", b'"x"', b"[" * 4000, b'{"operator": "Ada", "rights": 9}')])
    assert [answer.status_code for answer in found] == [413, 413, 413, 400, 400, 400, 400, 400]


def test_a_flood_is_refused_and_so_are_guesses_of_a_token():
    now_s = [0.0]
    protected = RequestProtection(PlainTextResponse("here"), AccessPolicy(OPERATOR),
                                  lambda: now_s[0])

    async def codes(count, token=lambda number: None):
        transport = httpx.ASGITransport(app=protected)
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            return [(await client.get("/", headers=bearer(one) if (one := token(n)) else {}))
                    .status_code for n in range(count)]

    allowed = int(REQUESTS_AT_ONCE)
    assert asyncio.run(codes(allowed + 50)) == [200] * allowed + [429] * 50
    now_s[0] += 1.0
    allowed = int(REQUESTS_PER_S)
    assert asyncio.run(codes(allowed + 5)) == [200] * allowed + [429] * 5

    now_s[0] += 100.0
    assert asyncio.run(codes(20, lambda n: f"guess-{n}")) == [200] * 10 + [429] * 10
    assert asyncio.run(codes(1, lambda n: OPERATOR)) == [429]
    assert asyncio.run(codes(1)) == [200]
    now_s[0] += 10.0
    assert asyncio.run(codes(1, lambda n: OPERATOR)) == [200]


def test_a_seat_is_kept_by_looking_and_seen_to_be_lost(asking):
    def look(key):
        return ("GET", "/api/session", {"headers": bearer(OPERATOR, **{"X-Operator-Seat": key})})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lmctl.web.operator_seat.secrets.token_urlsafe", lambda _: "key")
        first, kept, guessed, left, lost = asking(
            ("POST", "/api/seat", {"headers": bearer(OPERATOR), "json": {"operator": "Ada"}}),
            look("key"), look("guess"),
            ("DELETE", "/api/seat", {"headers": bearer(OPERATOR, **{"X-Operator-Seat": "key"})}),
            look("key"))
    assert (first.status_code, left.status_code) == (200, 200)
    assert (kept.json()["operator"], kept.json()["has_seat"]) == ("Ada", True)
    assert not guessed.json()["has_seat"]
    assert (lost.json()["operator"], lost.json()["has_seat"]) == ("", False)


def test_an_act_needs_the_seat_even_with_the_token(asking):
    found = asking(
        ("POST", "/api/runs/run-0001/acts", {"headers": bearer(OPERATOR), "json": ACT}),
        ("POST", "/api/seat", {"headers": bearer(OPERATOR), "json": {"operator": "Ada"}}),
        ("POST", "/api/runs/run-0001/acts", {
            "headers": bearer(OPERATOR, **{"X-Operator-Seat": "guessed"}), "json": ACT}),
        ("POST", "/api/seat", {"headers": bearer(OPERATOR), "json": {"operator": "Bob"}}),
        ("POST", "/api/runs/run-0001/acts", {"headers": bearer(OPERATOR),
                                             "json": ACT | {"act": "fire"}}))
    assert [answer.status_code for answer in found] == [403, 200, 403, 409, 400]
    assert "Ada is the operator already" in found[3].json()["error"]
