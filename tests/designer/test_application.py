"""The designer's page over HTTP: its token, its answers, and requests that no page sends."""

from __future__ import annotations

import asyncio

import httpx
import pytest

from lmctl.designer.application import PAGE_FILES, designer_application
from lmctl.web.access import AccessPolicy

TOKEN = "a-token-of-the-designer-0123456789"
VIEW = {"axis": 2, "at_mm": 2.0}


@pytest.fixture
def ask(session):
    """ask(method, path, json=..., token=...) -> response"""
    application = designer_application(session, AccessPolicy(TOKEN))

    async def one(method, path, **given):
        token = given.pop("token", TOKEN)
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        transport = httpx.ASGITransport(application)
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            return await client.request(method, path, headers=headers | given.pop("headers", {}),
                                        **given)

    return lambda *args, **given: asyncio.run(one(*args, **given))


def test_the_page_and_its_files_are_served(ask):
    assert "lmctl designer" in ask("GET", "/", token="").text
    for name, media_type in PAGE_FILES.items():
        answer = ask("GET", f"/page/{name}", token="")
        assert answer.headers["content-type"] == media_type
        assert "script-src 'self'" in answer.headers["content-security-policy"]
    assert ask("GET", "/page/../part_document.py", token="").status_code == 404


def test_a_number_is_moved_and_the_part_redrawn(ask):
    state = ask("GET", "/api/design").json()["state"]
    assert state["name"] == "block"
    path = ["composition", "blend", 0, "weight"]
    answer = ask("POST", "/api/adjust", json={**VIEW, "path": path, "value": 0.5}).json()
    assert answer["solid_changed"] is False
    assert answer["section"]["png"]
    assert answer["colours"]
    assert "weight = 0.5   # of the first" in answer["state"]["text"]
    assert ask("POST", "/api/undo", json=VIEW).json()["state"]["saved"] is True


@pytest.mark.parametrize("token", ["", "wrong-token-0123456789-0123456789"])
def test_without_its_token_nothing_is_shown_and_nothing_changed(ask, part_path, token):
    before = part_path.read_text()
    assert ask("GET", "/api/design", token=token).status_code == 401
    assert ask("POST", "/api/save", json={}, token=token).status_code == 401
    assert part_path.read_text() == before


def test_another_site_cannot_act(ask):
    foreign = {"Origin": "http://elsewhere.example"}
    assert ask("POST", "/api/save", json={}, headers=foreign).status_code == 403
    assert ask("GET", "/api/design", headers={"Host": "elsewhere.example"}).status_code == 421


@pytest.mark.parametrize(("name", "given", "words"), [
    ("adjust", {**VIEW, "path": ["body", 0, "high_mm", 0], "value": -5}, "low_mm is not below"),
    ("adjust", {**VIEW, "path": "body", "value": 1}, "path is a list"),
    ("adjust", {**VIEW, "path": ["name"], "value": 1}, "no number"),
    ("adjust", {**VIEW, "path": ["body"], "value": True}, "value is a number"),
    ("section", {"axis": 3, "at_mm": 0}, "axis is 0, 1 or 2"),
    ("verdict", {"layer": 99}, "no layer 99"),
    ("verdict", {"layer": "two"}, "whole number"),
    ("redo", VIEW, "nothing to redo"),
    ("section", [1, 2], "one JSON object"),
])
def test_what_cannot_be_is_answered_in_words(ask, name, given, words):
    answer = ask("POST", f"/api/{name}", json=given)
    assert answer.status_code == 422
    found = answer.json()
    assert words in " ".join([found["error"], *found["where"], found["hint"]])
