"""Running `lmctl` as a user does: arguments in; exit code, data and talk out."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

from lmctl.cli.__main__ import main

BENCH = (files("lmctl.examples") / "bench.toml").read_text()
CELL = (files("lmctl.examples") / "cell.toml").read_text()
#: Where the shipped cell's devices are; with the quote behind it, none begins another.
SHIPPED = {"motion": "127.0.0.1:2323", "F1": "127.0.0.1:5021", "F2": "127.0.0.1:5022"}
#: The motion link is cut within the first layer of a small part.
LINK_CUT = '[[fault]]\nkind = "link_closed"\ndevice = "motion"\nat_line = 40\nfor_s = 5\n'
HOMING = ("32 = 1", "32 = 1\n20 = 1\n22 = 1\n24 = 6000\n25 = 30000")


@dataclass(frozen=True)
class Outcome:
    """What one command did."""

    code: int
    data: str
    talk: str

    @property
    def json(self) -> Any:
        return json.loads(self.data)


Lmctl = Callable[..., Outcome]


@pytest.fixture
def lmctl(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Lmctl:
    """Runs a command in a folder of its own."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: object) -> Outcome:
        capsys.readouterr()
        code = main([str(argument) for argument in arguments])
        written = capsys.readouterr()
        return Outcome(code, written.out, written.err)

    return call


@pytest.fixture
def refused(lmctl: Lmctl) -> Callable[..., str]:
    """Runs a command that must be refused: the right code, no data, what/where/next, no trace."""

    def call(*arguments: object, code: int, hint: bool = True) -> str:
        outcome = lmctl(*arguments)
        assert outcome.code == code, outcome.talk
        assert outcome.data == ""
        assert "Traceback" not in outcome.talk
        assert "error: " in outcome.talk.lower()
        assert not hint or "hint: " in outcome.talk, outcome.talk
        return outcome.talk

    return call


@pytest.fixture
def box(lmctl: Lmctl, tmp_path: Path) -> Path:
    """A small box, planned."""
    lmctl("init", "box", ".")
    text = (tmp_path / "box.toml").read_text()
    (tmp_path / "box.toml").write_text(text.replace("[30, 20, 8]", "[12, 8, 0.8]"))
    assert lmctl("plan", "box.toml", "--machine", "cell.toml", "-o", "box.lmj").code == 0
    return tmp_path / "box.lmj"


@pytest.fixture
def bench(tmp_path) -> Callable[..., Path]:
    """Writes a bench file: the shipped one with replacements."""

    def write(*replacements: tuple[str, str]) -> Path:
        text = BENCH
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "bench.toml").write_text(text)
        return tmp_path / "bench.toml"

    return write


@pytest.fixture
def active(bench, tmp_path) -> Iterator[Callable[..., Path]]:
    """Starts a bench as a process of its own; returns the profile of the cell it is."""
    running = []

    def start(*replacements: tuple[str, str]) -> Path:
        path = bench(*replacements, *((f'{one}"', '127.0.0.1:0"') for one in SHIPPED.values()))
        process = subprocess.Popen(
            [sys.executable, "-m", "simulators", str(path)], stdout=subprocess.PIPE, text=True
        )
        running.append(process)
        assert process.stdout is not None
        text, served = CELL, json.loads(process.stdout.readline())
        for device, one in SHIPPED.items():
            text = text.replace(f'{one}"', f'{served[device].partition("//")[2]}"')
        (tmp_path / "cell.toml").write_text(text)
        return tmp_path / "cell.toml"

    yield start
    for process in running:
        process.kill()
        process.communicate()


@pytest.fixture(scope="session")
def recovered_part(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small graded block whose first run was cut off and whose second finished it."""
    folder = tmp_path_factory.mktemp("recovered")
    text = (files("lmctl.examples") / "box.toml").read_text()
    text = text.replace("[30, 20, 8]", "[12, 8, 1.6]").replace("graded block", "block <b>&</b>")
    (folder / "part.toml").write_text(
        text + '[traveller]\nserial = "SN-0"\n[traveller.powder.316L]\nlot = "A4711"\n')
    (folder / "faults.toml").write_text(LINK_CUT)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["plan", "part.toml", "-o", "part.lmj"]) == 0
        assert main(["run", "part.lmj", "--sim", "--faults", "faults.toml", "--operator",
                     "Ada"]) == 5
        assert main(["recover", "run-0001", "--sim", "--yes", "--position-restored",
                     "--deposited", "1", "--operator", "Bob"]) == 0
        assert main(["note", "run-0001", "the plug was loose", "--about", "0",
                     "--disposition", "accepted"]) == 0
    return folder
