"""`lmctl init`: every template listed, written, and one of the paper's cases run to its end."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from lmctl.examples.templates import TEMPLATES


def test_templates_are_listed_and_written(lmctl: Callable[..., Any]) -> None:
    listed = lmctl("init", "--list")
    assert listed.code == 0
    assert [line.split()[0] for line in listed.data.splitlines()] == list(TEMPLATES)
    for name in TEMPLATES:
        outcome = lmctl("init", name, "-t", name)
        assert outcome.code == 0
        assert (Path(name) / f"{name}.toml").is_file()
        assert (Path(name) / "cell.toml").is_file()


def test_an_unknown_template_is_refused_with_those_there_are(refused: Callable[..., str]) -> None:
    assert "fig8-union" in refused("init", "-t", "fig5", code=2)


def test_a_case_of_the_paper_runs_to_its_end(lmctl: Callable[..., Any]) -> None:
    assert lmctl("init", "-t", "fig9-intersection").code == 0
    checked = lmctl("check", "fig9-intersection.toml", "--machine", "cell.toml")
    assert checked.code == 0
    assert "nothing wrong" in checked.data
    assert lmctl("plan", "fig9-intersection.toml", "--machine", "cell.toml").code == 0
    run = lmctl("run", "fig9-intersection.lmj", "--sim")
    assert run.code == 0
    assert ": done" in run.data
