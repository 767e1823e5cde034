"""The live page: how fast a record of a journal is seen, and whether looking on delays a hold.

journal_to_viewer_p99_ms : from a record's write to its arrival, at each of 20 viewers
journal_to_screen_p99_ms : the same until it stands in the page of one of the 20, in Chromium;
    left out where there is none
hold_p99_ms, hold_watched_p99_ms : of the run: from when a command lies in its control socket until
    the feed hold is given to the wire, alone, and with the page, 20 viewers and a flood of 1,000
    requests a second
operator_hold_p99_ms, operator_hold_watched_p99_ms : the same from when an operator's program
    begins to connect: it shares the cores of the computer with run, page and flood
hold_p99_ratio, operator_hold_p99_ratio : with page and flood over alone, in blocks that
    alternate, so that both see the same computer; hold_samples : of each
"""

from __future__ import annotations

import asyncio
import json
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from lmctl.errors import LmctlError
from lmctl.run.control.client import send_request
from lmctl.run.control.socket_path import connect_to_run
from lmctl.run.journal.writer import JournalWriter

FAR_END = Path(__file__).resolve().parents[1] / "far_end"
VIEWERS, FLOOD_S = 20, 1000
_RECORDS, _EVERY_S = 400, 0.03
_HOLDS, _BLOCK, _SPEED = 300, 15, 4.0
_MOMENTS = random.Random(1)


class _Delay(NamedTuple):
    """Milliseconds until the feed hold is on the wire."""

    of_run: float
    of_operator: float


def rows() -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        found = _journal_to_screen(Path(folder))
    with tempfile.TemporaryDirectory() as folder:
        return found | _holds(Path(folder))


# --- journal to screen ------------------------------------------------------------------------

def _journal_to_screen(folder: Path) -> dict[str, float]:
    run = folder / "runs/run-0001"
    run.mkdir(parents=True)
    header = {"part": "bench", "hoppers": [], "materials": [], "layers": 1, "lines": 1}
    with JournalWriter(run / "journal.jsonl", header, local={"run": "run-0001"}) as journal:
        page, url = _start_page(folder)
        try:
            return asyncio.run(_measure_arrivals(journal, url))
        finally:
            page.kill()
            page.wait()


async def _measure_arrivals(journal: JournalWriter, url: str) -> dict[str, float]:
    arrivals_ms: list[float] = []
    chromium = shutil.which("chromium")
    viewers = [asyncio.create_task(_view(url, arrivals_ms))
               for _ in range(VIEWERS - (chromium is not None))]
    async with _Browser(url, chromium) as browser:
        await asyncio.sleep(2.0)
        arrivals_ms.clear()
        for number in range(_RECORDS):
            journal.append(number * _EVERY_S, "warning", active=True, hint="",
                           what=f"{time.time() * 1000:.3f}")
            journal.flush()
            await asyncio.sleep(_EVERY_S)
        await asyncio.sleep(1.0)
        drawn_ms = await browser.delays_ms()
    for viewer in viewers:
        viewer.cancel()
    expected = _RECORDS * len(viewers)
    if len(arrivals_ms) != expected or (drawn_ms and len(drawn_ms) < _RECORDS // 2):
        raise SystemExit(f"{len(arrivals_ms)} of {expected} records arrived, "
                         f"{len(drawn_ms)} of {_RECORDS} were drawn")
    return {"journal_to_viewer_p99_ms": round(_p99(arrivals_ms), 1)} | (
        {"journal_to_screen_p99_ms": round(_p99(drawn_ms), 1)} if drawn_ms else {})


async def _view(url: str, arrivals_ms: list[float]) -> None:
    host, port = url.split("/")[2].split(":")
    reader, writer = await asyncio.open_connection(host, int(port), limit=1 << 22)
    writer.write(b"GET /api/runs/run-0001/events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
    while line := await reader.readline():
        if line.startswith(b"data: ["):  # events
            now_ms = time.time() * 1000
            arrivals_ms += [now_ms - float(one["what"]) for one in json.loads(line[6:])]


class _Browser:
    """The page in Chromium; nothing where there is none."""

    def __init__(self, url: str, chromium: str | None) -> None:
        self._url, self._chromium = url, chromium

    async def __aenter__(self) -> _Browser:
        if self._chromium is not None:
            from playwright.async_api import async_playwright

            self._driver = await async_playwright().start()
            self._browser = await self._driver.chromium.launch(
                executable_path=self._chromium, args=["--no-sandbox"])
            self._page = await self._browser.new_page(viewport={"width": 1440, "height": 1000})
            await self._page.goto(self._url)
            await self._page.wait_for_timeout(3000)
            await self._page.evaluate("""() => {
              window.seen = new Map();
              new MutationObserver(() => requestAnimationFrame(() => {
                for (const item of document.querySelectorAll("#events li")) {
                  const sent = item.textContent.split("warning: ")[1];
                  if (sent && !window.seen.has(sent))
                    window.seen.set(sent, performance.timeOrigin + performance.now() - sent);
                }
              })).observe(document.getElementById("events"), { childList: true });
            }""")
        return self

    async def delays_ms(self) -> list[float]:
        if self._chromium is None:
            return []
        found: list[float] = await self._page.evaluate("[...window.seen.values()]")
        return found

    async def __aexit__(self, *exception: object) -> None:
        if self._chromium is not None:
            await self._browser.close()
            await self._driver.stop()


# --- holds ------------------------------------------------------------------------------------

def _holds(folder: Path) -> dict[str, float]:
    runs = folder / "runs"
    run = subprocess.Popen([sys.executable, str(FAR_END / "held_run.py"), str(runs), str(_SPEED)],
                           stdout=subprocess.PIPE, text=True)
    page = load = None
    try:
        _wait_for(runs / "run-0001", "depositing")
        page, url = _start_page(folder)
        load = subprocess.Popen(
            [sys.executable, str(FAR_END / "page_load.py"), url, str(VIEWERS), str(FLOOD_S)],
            stdout=subprocess.PIPE, text=True)
        assert load.stdout is not None
        load.stdout.readline()
        delays_ms: tuple[list[_Delay], list[_Delay]] = ([], [])
        for block in range(2 * _HOLDS // _BLOCK):
            is_watched = block % 2
            for one in (page, load):
                one.send_signal(signal.SIGCONT if is_watched else signal.SIGSTOP)
            time.sleep(1.0)
            delays_ms[is_watched].extend(
                _hold_delay(runs / "run-0001", run) for _ in range(_BLOCK))
        load.send_signal(signal.SIGCONT)
        load.terminate()
        flood_s, events = load.communicate(timeout=30)[0].split()
    finally:
        for one in (run, page, load):
            if one is not None:
                one.kill()
                one.wait()
    found: dict[str, float] = {}
    for of, at in (("hold", 0), ("operator_hold", 1)):
        alone, watched = ([one[at] for one in those] for those in delays_ms)
        found |= {
            f"{of}_p99_ms": round(_p99(alone), 2), f"{of}_watched_p99_ms": round(_p99(watched), 2),
            f"{of}_p99_ratio": round(_p99(watched) / _p99(alone), 2),
            f"{of}_median_ratio": round(statistics.median(watched) / statistics.median(alone), 2),
        }
    return found | {"hold_samples": len(delays_ms[0]), "flood_requests_s": round(float(flood_s)),
                    "viewer_events": int(events)}


def _hold_delay(folder: Path, run: subprocess.Popen[str]) -> _Delay:
    assert run.stdout is not None
    began_s = time.monotonic()
    connection = connect_to_run(folder)
    assert connection is not None
    with connection:
        sent_s = time.monotonic()
        connection.sendall(b'{"do": "hold"}\n')
        connection.recv(1 << 16)
    held_s = float(run.stdout.readline())
    delay_ms = _Delay((held_s - sent_s) * 1000.0, (held_s - began_s) * 1000.0)
    _wait_for(folder, "held")
    send_request(folder, "resume")
    _wait_for(folder, "depositing")
    time.sleep(_MOMENTS.uniform(0.02, 0.12))  # no hold at the same moment of a path as the last
    return delay_ms


def _wait_for(folder: Path, state: str) -> None:
    for _ in range(3000):
        try:
            if send_request(folder, "status")["state"] == state:
                return
        except LmctlError:  # not begun yet
            pass
        time.sleep(0.02)
    raise SystemExit(f"the run was not {state} within a minute")


def _start_page(folder: Path) -> tuple[subprocess.Popen[str], str]:
    page = subprocess.Popen([sys.executable, "-m", "lmctl.cli", "dash", "--port", "0"],
                            cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                            text=True)
    assert page.stdout is not None
    return page, page.stdout.readline().split()[-1]


def _p99(values: list[float]) -> float:
    return sorted(values)[min(len(values) - 1, int(0.99 * len(values)))]
