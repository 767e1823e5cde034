"""`lmctl design` from the terminal to a page that moves a number, as a user's programs see it."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys

import httpx
import pytest


@pytest.fixture
def served(part_path):
    """The address and the token of a page that a process of its own serves."""
    with subprocess.Popen(
        [sys.executable, "-m", "lmctl.cli", "design", part_path.name, "--port", "0"],
        cwd=part_path.parent, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:
        try:
            found = re.search(r"(http://\S+/)#token=(\S+)", process.stdout.readline())
            assert found is not None, process.stderr.read()
            yield found[1], found[2]
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(timeout=20)


def test_a_number_moved_over_the_wire_is_in_the_saved_file(served, part_path):
    address, token = served
    with httpx.Client(base_url=address, headers={"Authorization": f"Bearer {token}"}) as client:
        assert client.get("/api/design").json()["state"]["file"] == "part.toml"
        moved = client.post("/api/adjust", json={
            "axis": 0, "at_mm": 3.0, "path": ["body", 0, "high_mm", 2], "value": 6})
        assert moved.json()["solid_changed"] is True
        assert client.post("/api/save", json={}).status_code == 200
    assert "high_mm = [20, 12, 6]" in part_path.read_text()
    assert httpx.get(f"{address}api/design").status_code == 401


def test_a_mesh_is_refused_with_the_way_to_a_part_file(tmp_path):
    (tmp_path / "part.stl").write_text("solid\nendsolid\n")
    done = subprocess.run([sys.executable, "-m", "lmctl.cli", "design", "part.stl"], cwd=tmp_path,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "is no part file" in done.stderr
    assert "lmctl init" in done.stderr


CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


@pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium on this machine")
@pytest.mark.parametrize("width", [390, 1440])
def test_a_slider_moved_by_keys_redraws_the_section_in_a_browser(served, width):
    driver = pytest.importorskip(
        "playwright.sync_api", reason="the extra `browser` (playwright) is not installed")
    address, token = served
    errors = []
    with driver.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": width, "height": 900})
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(f"{address}#token={token}")
        section = page.locator("#section")
        driver.expect(section).to_have_attribute("src", re.compile("^data:image/png"))
        before = section.get_attribute("src")
        page.get_by_label("part: blend 1 weight", exact=True).press("ArrowRight")
        driver.expect(section).not_to_have_attribute("src", before)
        driver.expect(page.locator("#saved")).to_have_text("not saved")
        page.keyboard.press("Control+z")
        driver.expect(section).to_have_attribute("src", before)
        driver.expect(page.locator("#saved")).to_have_text("saved")
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        browser.close()
    assert errors == []
