"""Running `lmctl` as a user does: arguments in; exit code, data and talk out."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from lmctl.cli.__main__ import main


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
