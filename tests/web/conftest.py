"""Folders of runs to look at, one made on the bench and one that a process drives."""

from __future__ import annotations

import asyncio
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import pytest

from lmctl.config.machine import load_profile
from lmctl.run.journal.run_folders import RunFolder
from lmctl.web.access import AccessPolicy
from lmctl.web.application import dash_application
from lmctl.web.run_catalogue import RunCatalogue
from tests.part_files import block_file
from tests.run.conftest import squares, write_job
from tests.run.whole.conftest import EXAMPLES, BenchRun

GRADED = block_file(
    (10, 10, 2), 'feature = { kind = "surface" }\n[composition.profile]\nkind = "power"\nk = 1\n'
    'near = { "316L" = 0.4, "WC-12Co" = 0.6 }\nfar = { "316L" = 1, "WC-12Co" = 0 }\n')
OPERATOR, VIEWER = "operator-token-0123456789", "viewer-token-0123456789"


@pytest.fixture(scope="session")
def bench_profile():
    return load_profile(EXAMPLES / "cell.toml")


@pytest.fixture(scope="session")
def ended_run(tmp_path_factory, bench_profile) -> RunFolder:
    """A run of two powders at a steady flow, held once and done."""
    folder = tmp_path_factory.mktemp("ended")
    write_job(folder / "job.lmj", bench_profile, squares(1, 4), text=GRADED)
    ran = BenchRun(folder, bench_profile, folder / "job.lmj", acts=[
        (3.0, lambda one: one.executor.hold()), (6.0, lambda one: one.executor.resume())])
    assert ran.error is None
    return RunFolder(ran.journal.parent)


@pytest.fixture
def runs_dir(tmp_path, ended_run) -> Path:
    """A folder with a copy of that run."""
    shutil.copytree(ended_run.path, tmp_path / "runs" / ended_run.run)
    return tmp_path / "runs"


@pytest.fixture
def asking(runs_dir) -> Callable[..., list[httpx.Response]]:
    """Answers of a page to requests (method, path, options), one after the other."""

    def ask(*requests, access=None, base="http://127.0.0.1:8440"):
        async def main():
            async with RunCatalogue(runs_dir) as catalogue:
                app = dash_application(catalogue, access or AccessPolicy(OPERATOR))
                transport = httpx.ASGITransport(app=app)
                async with httpx.AsyncClient(transport=transport, base_url=base) as client:
                    return [await client.request(method, path, **options)
                            for method, path, options in requests]

        return asyncio.run(main())

    ask.runs_dir = runs_dir
    return ask


def bearer(token: str, **more: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}", "Content-Type": "application/json", **more}


def eventually(condition: Callable[[], object], for_s: float = 60.0) -> object:
    """What a condition becomes, once it is something; fails after so long."""
    until = time.monotonic() + for_s
    while time.monotonic() < until:
        try:
            if found := condition():
                return found
        except (httpx.TransportError, OSError, KeyError):
            pass
        time.sleep(0.05)
    raise AssertionError("it never came to that")


class LivePage:
    """A run and a page, each in a process of its own. faults : text of a fault file"""

    def __init__(
        self, folder: Path, *more: str, speed: float = 10.0, faults: str = ""
    ) -> None:
        self.folder = folder
        self._client = httpx.Client(timeout=100.0, verify=False)  # certificates take time to load
        self.processes: list[subprocess.Popen[str]] = []
        (folder / "faults.toml").write_text(faults)
        self.run = self._start("run", "job.lmj", "--sim", "--speed", str(speed), "--machine",
                               str(EXAMPLES / "cell.toml"), "--operator", "Ada",
                               *(("--faults", "faults.toml") if faults else ()))
        self.dash = self.start_dash(*more)

    def start_dash(self, *more: str, port: int = 0) -> subprocess.Popen[str]:
        self.dash = self._start("dash", "--port", str(port), *more)
        assert self.dash.stdout is not None
        self.url = self.dash.stdout.readline().split()[-1]
        self.token = self.dash.stdout.readline().partition("#token=")[2].strip()
        return self.dash

    def get(self, path: str, **options):
        return self._client.get(self.url + path, **options)

    def post(self, path: str, body: dict, **headers: str):
        return self._client.post(self.url + path, json=body,
                                 headers=bearer(self.token, **headers))

    def snapshot(self) -> dict:
        return self.get("api/runs/run-0001").json()

    def state_is(self, *states: str, for_s: float = 60.0) -> dict:
        return eventually(
            lambda: now if (now := self.snapshot()).get("state") in states else None, for_s)

    def close(self) -> None:
        self._client.close()
        for process in self.processes:
            process.kill()
            process.communicate()

    def _start(self, *arguments: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "lmctl.cli", *arguments], cwd=self.folder, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        self.processes.append(process)
        return process


@pytest.fixture
def live_page(tmp_path, bench_profile) -> Iterator[Callable[..., LivePage]]:
    """Starts a run of two powders and a page that watches it: live_page(side_mm=…, speed=…)."""
    made: list[LivePage] = []

    def start(
        *more: str, side_mm: float = 60.0, speed: float = 10.0, faults: str = ""
    ) -> LivePage:
        write_job(tmp_path / "job.lmj", bench_profile, squares(2, 2, side_mm), text=GRADED)
        made.append(LivePage(tmp_path, *more, speed=speed, faults=faults))
        return made[-1]

    yield start
    for one in made:
        one.close()
