"""The page in a browser: what a person sees and does. Left out where there is no Chromium."""

from __future__ import annotations

import shutil
from urllib.parse import urlsplit

import pytest

from lmctl.run.journal.format import read_records
from tests.web.conftest import OPERATOR

playwright = pytest.importorskip(
    "playwright.sync_api", reason="the extra `browser` (playwright) is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
if CHROMIUM is None:
    pytest.skip("there is no chromium on this machine", allow_module_level=True)

WIDE, NARROW = {"width": 1440, "height": 1000}, {"width": 390, "height": 844}
expect = playwright.expect

#: Sections that overlap, text that is cut, and whether the page is wider than the window.
LAYOUT = """() => {
  const wrong = [], all = (what) => [...document.querySelectorAll(what)];
  const box = (one) => one.getBoundingClientRect(), name = (one) => one.id || one.textContent;
  if (document.documentElement.scrollWidth > innerWidth) wrong.push("wider than the window");
  for (const a of all("section")) for (const b of all("section")) {
    const p = box(a), q = box(b);
    if (a.id < b.id && p.left < q.right - 1 && q.left < p.right - 1
      && p.top < q.bottom - 1 && q.top < p.bottom - 1) wrong.push(`${a.id} over ${b.id}`);
  }
  for (const one of all("button, h1, h2, dd, dt, p, li, #values td, .hopper"))
    if (one.offsetParent && one.scrollWidth > one.clientWidth + 1
      && getComputedStyle(one).display !== "inline") wrong.push(`cut: ${name(one)}`);
  for (const section of all("section"))
    for (const one of section.querySelectorAll("canvas, button, table"))
      if (one.offsetParent && !one.closest(".scroll")
        && box(one).right > box(section).right + 1) wrong.push(`${name(one)} leaves its section`);
  return wrong;
}"""

#: Pixels of a colour in the layer.
PIXELS = """([r, g, b]) => {
  const canvas = document.getElementById("layer"), found = canvas.getContext("2d")
    .getImageData(0, 0, canvas.width, canvas.height).data;
  let n = 0;
  for (let i = 0; i < found.length; i += 4)
    n += Math.abs(found[i] - r) + Math.abs(found[i + 1] - g) + Math.abs(found[i + 2] - b) < 12;
  return n;
}"""
DONE, NOZZLE, REENTRY = [31, 122, 77], [11, 87, 208], [122, 43, 181]


@pytest.fixture
def open_page():
    """Opens pages in one browser: open_page(url, viewport); none may report an error."""
    errors = []
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])

        def open_one(url, viewport=WIDE):
            page = browser.new_context(viewport=viewport).new_page()
            page.on("pageerror", lambda error: errors.append(str(error)))
            page.on("console", lambda one: errors.append(one.text)
                    if "Content Security Policy" in one.text else None)
            page.goto(url)
            return page

        yield open_one
        browser.close()
    assert errors == []


def press_until_focused(page, name):
    """Tab until a button has the focus, as without a mouse."""
    press_until(page, f"document.activeElement.textContent === '{name}'")


def press_until(page, condition):
    for _ in range(60):
        if page.evaluate(condition):
            return
        page.keyboard.press("Tab")
    raise AssertionError(f"no Tab leads to where {condition}")


def until(page, condition):
    """Wait for a condition; the page's own policy keeps a test from waiting inside it."""
    for _ in range(300):
        if condition():
            return
        page.wait_for_timeout(50)
    raise AssertionError("it never came to that")


def line_of(page):
    return int(page.inner_text("#place dd:nth-of-type(2)").split()[0])


def test_a_run_is_watched_held_and_resumed_by_keyboard_alone(live_page, open_page):
    live = live_page(side_mm=80.0, speed=4.0)
    live.state_is("depositing")
    page = open_page(f"{live.url}#token={live.token}")
    assert "token" not in page.url
    expect(page.locator("#state")).to_have_text("depositing", timeout=20_000)
    first, pixels = line_of(page), page.evaluate(PIXELS, DONE)
    until(page, lambda: line_of(page) > first)
    until(page, lambda: page.evaluate(PIXELS, DONE) > pixels)
    assert page.evaluate(PIXELS, NOZZLE) > 20
    until(page, lambda: page.locator("#curve-mixture .u-value").last.inner_text() != "–")
    assert page.evaluate(LAYOUT) == []

    viewer = open_page(live.url, NARROW)
    expect(viewer.locator("#state")).to_have_text("depositing", timeout=20_000)
    assert viewer.locator("#acts button:visible").count() == 5
    assert viewer.locator("#acts button:enabled").count() == 0
    assert viewer.evaluate(LAYOUT) == []

    press_until_focused(page, "Take control")
    page.keyboard.press("Enter")
    page.keyboard.type("Bob")
    page.keyboard.press("Enter")
    expect(page.locator("#seat")).to_have_text("You operate as Bob.")
    press_until_focused(page, "Hold")
    page.keyboard.press("Enter")
    expect(page.locator("#confirm-title")).to_have_text("Hold the run?")
    press_until_focused(page, "Confirm")
    page.keyboard.press("Enter")
    expect(page.locator("#state")).to_have_text("held", timeout=20_000)
    expect(page.locator("#doing")).to_contain_text("held by: the operator")
    expect(viewer.locator("#state")).to_have_text("held", timeout=20_000)
    expect(viewer.locator("#seat")).to_contain_text("Bob operates", timeout=20_000)
    until(page, lambda: page.evaluate(PIXELS, REENTRY) > 20)

    press_until_focused(page, "Resume")
    page.keyboard.press("Enter")
    text = page.inner_text("#confirm-text")
    assert "program line" in text
    assert "mm along the path" in text
    page.keyboard.press("Escape")
    expect(page.locator("#state")).to_have_text("held")
    press_until_focused(page, "Resume")
    page.keyboard.press("Enter")
    press_until_focused(page, "Confirm")
    page.keyboard.press("Enter")
    expect(page.locator("#act-result")).to_contain_text("resume: accepted")
    expect(page.locator("#state")).to_have_text("depositing", timeout=30_000)

    viewer.click("#take-seat")
    viewer.fill("input[name=name]", "Eve")
    viewer.fill("input[name=token]", OPERATOR)
    viewer.click("#confirm-yes")
    expect(viewer.locator("#act-result")).to_contain_text("token of an operator")
    assert viewer.locator("[data-act=stop]").is_disabled()

    live.dash.kill()
    live.dash.wait()
    expect(page.locator("#link")).to_have_text("connection lost, trying again", timeout=10_000)
    expect(page.locator("#stale")).to_contain_text("The run itself is not affected")
    assert page.locator("[data-act=hold]").is_disabled()
    live.start_dash(port=urlsplit(live.url).port)
    expect(page.locator("#link")).to_have_text("live", timeout=20_000)


def test_a_hopper_is_refilled_by_keyboard_alone_on_a_narrow_page(live_page, open_page):
    live = live_page(side_mm=80.0, speed=10.0)
    live.state_is("depositing")
    page = open_page(f"{live.url}#token={live.token}", NARROW)
    expect(page.locator("#state")).to_have_text("depositing", timeout=20_000)
    press_until_focused(page, "Take control")
    page.keyboard.press("Enter")
    page.keyboard.type("Bob")
    page.keyboard.press("Enter")
    expect(page.locator("#seat")).to_have_text("You operate as Bob.")

    press_until_focused(page, "Refill hopper")
    page.keyboard.press("Enter")
    page.keyboard.press("B")
    assert page.input_value("select[name=hopper]") == "B"
    press_until_focused(page, "Confirm")
    page.keyboard.press("Enter")
    expect(page.locator("#state")).to_have_text("refilling", timeout=60_000)
    expect(page.locator("#doing")).to_contain_text("left. Hopper B may be opened")

    press_until_focused(page, "Hopper filled")
    page.keyboard.press("Enter")
    expect(page.locator("#confirm-text")).to_contain_text("weighed")
    page.keyboard.type("HEAT-7")
    page.keyboard.press("Enter")
    expect(page.locator("#confirm")).to_be_visible()  # the mass is missing
    press_until(page, "document.activeElement.name === 'mass_g'")
    page.keyboard.type("1500")
    assert page.evaluate(LAYOUT) == []
    assert page.evaluate("document.getElementById('confirm').getBoundingClientRect().right") <= 390
    page.keyboard.press("Enter")
    expect(page.locator("#state")).to_have_text("held", timeout=60_000)
    expect(page.locator("#events")).to_contain_text("hopper B refilled, lot HEAT-7, 1500 g")
    journal = live.folder / "runs/run-0001/journal.jsonl"
    (filled,) = [one for one in read_records(journal) if one["kind"] == "refill"]
    assert (filled["hopper"], filled["lot"], filled["mass_g"]) == ("B", "HEAT-7", 1500.0)
    assert [one["operator"] for one in read_records(journal) if one["kind"] == "operator"] == [
        "Bob (live page, 127.0.0.1)"] * 2


def test_an_alarm_is_shown_with_what_to_do_at_both_widths(live_page, open_page):
    live = live_page(speed=10.0, faults='[[fault]]\nkind = "link_closed"\ndevice = "F1"\n'
                     'at_line = 30\nfor_s = 500\n')
    live.state_is("held")
    for viewport in (WIDE, NARROW):
        page = open_page(live.url, viewport)
        alarm = page.locator("#alarms li").first
        expect(alarm).to_contain_text("What to do:", timeout=20_000)
        expect(alarm).to_contain_text("F1")
        expect(page.locator("#interlocks [data-state]", has_text="feeder silent")
               ).not_to_have_attribute("data-state", "ok")
        assert page.evaluate(LAYOUT) == []
