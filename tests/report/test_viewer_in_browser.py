"""The page of a job in a browser, wide and on a phone. Left out where there is no Chromium."""

from __future__ import annotations

import shutil

import pytest

from lmctl.config.machine import load_profile
from lmctl.report.job_viewer.writing import write_job_viewer
from tests.run.conftest import squares, write_job
from tests.run.whole.conftest import EXAMPLES

playwright = pytest.importorskip(
    "playwright.sync_api", reason="the extra `browser` (playwright) is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
if CHROMIUM is None:
    pytest.skip("there is no chromium on this machine", allow_module_level=True)

WIDE = {"viewport": {"width": 1440, "height": 500}}  # so low that its column scrolls
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}

#: What of the page is wider than the window, or cut.
LAYOUT = """() => {
  const wrong = [], box = (one) => one.getBoundingClientRect();
  if (document.documentElement.scrollWidth > innerWidth) wrong.push("wider than the window");
  const isInline = (one) => getComputedStyle(one).display === "inline";
  for (const one of document.querySelectorAll("h1, small, p, select, label, td, th, span"))
    if (one.offsetParent && !isInline(one)
      && (box(one).right > innerWidth + 1 || one.scrollWidth > one.clientWidth + 1))
      wrong.push(`cut: ${one.textContent.slice(0, 40)}`);
  return wrong;
}"""


@pytest.fixture(scope="module")
def job_page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("viewer")
    write_job(folder / "job.lmj", load_profile(EXAMPLES / "cell.toml"), squares(2, 3, 12.0))
    write_job_viewer(folder / "job.lmj", folder / "job.html")
    return f"file://{folder}/job.html"


@pytest.fixture
def open_page(job_page):
    errors = []
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])

        def open_one(**device):
            page = browser.new_context(**device).new_page()
            page.on("pageerror", lambda error: errors.append(str(error)))
            page.goto(job_page)
            page.wait_for_selector("#values td")
            return page

        yield open_one
        browser.close()
    assert errors == []


def at(page, where, x, y):
    box = page.locator(where).bounding_box()
    return box["x"] + x * box["width"], box["y"] + y * box["height"]


def first_bead(page):
    """Where the middle of the layer's first bead is in the window."""
    return page.evaluate("""() => {
      const box = canvas.getBoundingClientRect(), f = frame(box.width, box.height);
      const i = view.lines.kind.indexOf(KIND.BEAD);
      return [box.left + f.x((view.beginX[i] + view.lines.x[i]) / 2),
              box.top + f.y((view.beginY[i] + view.lines.y[i]) / 2)];
    }""")


def is_inside(page, what):
    return page.evaluate("""(what) => {
      const box = document.querySelector(what).getBoundingClientRect();
      return box.width > 0 && box.left >= 0 && box.right <= innerWidth && box.top >= 0;
    }""", what)


def test_values_show_under_the_mouse_and_time_moves_along_the_curves(open_page):
    page = open_page(**WIDE)
    assert page.evaluate(LAYOUT) == []
    page.mouse.move(*first_bead(page))
    assert "kind: bead" in page.inner_text("#tip")
    assert "vol. %: designed / planned / predicted" in page.inner_text("#tip")
    assert "316L: 60.0 / 50.0 / –" in page.inner_text("#tip")
    assert is_inside(page, "#tip")
    before = page.inner_text("#time-text")
    page.mouse.click(*at(page, "#curves", 0.5, 0.3))
    assert page.inner_text("#time-text") != before
    page.keyboard.press("ArrowUp")
    page.wait_for_function("document.body.dataset.layer === '2'")


def test_on_a_phone_nothing_is_cut_and_fingers_do_what_a_mouse_does(open_page):
    page = open_page(**PHONE)
    assert page.evaluate(LAYOUT) == []
    page.touchscreen.tap(*first_bead(page))
    assert "kind: bead" in page.inner_text("#tip")
    assert is_inside(page, "#tip")
    # One finger over the layer scrolls the page; only two zoom, and then one moves the layer.
    assert page.evaluate("getComputedStyle(canvas).touchAction") == "pan-y"
    page.evaluate("""() => {
      const send = (kind, pointerId, x) => canvas.dispatchEvent(new PointerEvent(kind, {
        pointerId, pointerType: "touch", clientX: x, clientY: 300, bubbles: true, buttons: 1 }));
      send("pointerdown", 1, 150); send("pointerdown", 2, 250);
      send("pointermove", 2, 350);
      send("pointerup", 1, 150); send("pointerup", 2, 350);
    }""")
    assert page.evaluate("state.zoom") == pytest.approx(2.0)
    page.wait_for_function("getComputedStyle(canvas).touchAction === 'none'")
    box = page.locator("#curves").bounding_box()
    page.evaluate("scrollTo(0, document.body.scrollHeight)")
    assert page.evaluate("scrollY") > 0
    assert box["width"] > 300
