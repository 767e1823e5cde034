"""`lmctl init`: every template listed, written, and one of the paper's cases run to its end."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lmctl.examples.templates import TEMPLATES


def test_templates_are_listed_and_written(lmctl: Callable[..., Any]) -> None:
    listed = lmctl("init", "--list")
    assert listed.code == 0
    assert [line.split()[0] for line in listed.data.splitlines()] == list(TEMPLATES)
    for name in TEMPLATES:
        outcome = lmctl("init", name)
        assert outcome.code == 0
        assert (Path(name) / f"{name}.toml").is_file()
        assert (Path(name) / "cell.toml").is_file()


def test_an_unknown_template_is_refused_with_those_there_are(refused: Callable[..., str]) -> None:
    assert "fig8-union" in refused("init", "xyz", code=2)
    assert "did you mean 'box'?" in refused("init", "boxx", code=2)
    assert "lmctl init gear ." in refused("init", ".", code=2)
    assert "which template?" in refused("init", code=2)


def test_a_template_goes_into_the_folder_that_is_named(
    lmctl: Callable[..., Any], tmp_path: Path
) -> None:
    assert lmctl("init", "box", "a/b").code == 0
    assert sorted(path.name for path in (tmp_path / "a" / "b").iterdir()) == [
        "bench.toml", "box.toml", "cell.toml", "schemas"]
    assert lmctl("init", "box").code == 0
    assert (tmp_path / "box" / "box.toml").is_file()


def test_the_first_line_of_a_template_names_its_schema(
    lmctl: Callable[..., Any], tmp_path: Path
) -> None:
    assert lmctl("init", "box", ".").code == 0
    for name, title in (("box", "the part file"), ("cell", "the machine profile"),
                        ("bench", "the simulated cell")):
        first = (tmp_path / f"{name}.toml").read_text().partition("\n")[0]
        marker, path = first.split()
        assert marker == "#:schema"
        assert json.loads((tmp_path / path).read_text())["title"] == title


@pytest.mark.parametrize("name", ["two-bodies", "three-powders"])
def test_a_template_is_planned_and_run_with_the_cell_beside_it(
    lmctl: Callable[..., Any], name: str
) -> None:
    assert lmctl("init", name, ".").code == 0
    part = Path(f"{name}.toml")
    for high, low in (("0, 8]", "0, 1.6]"), ("0, 3.2]", "0, 0.8]"), ("0, 4]", "0, 1.6]")):
        part.write_text(part.read_text().replace(high, low))  # layers enough
    planned = lmctl("plan", part, "--machine", "cell.toml", "--json")
    assert planned.code == 0, planned.talk
    assert json.loads(planned.data)["mixture_share"] > 0.98  # a template shows what is good
    run = lmctl("run", f"{name}.lmj", "--sim", "--machine", "cell.toml", "--bench", "bench.toml")
    assert run.code == 0, run.talk


def test_a_case_of_the_paper_runs_to_its_end(lmctl: Callable[..., Any]) -> None:
    assert lmctl("init", "fig9-intersection", ".").code == 0
    checked = lmctl("check", "fig9-intersection.toml", "--machine", "cell.toml")
    assert checked.code == 0
    assert "nothing wrong" in checked.data
    assert lmctl("plan", "fig9-intersection.toml", "--machine", "cell.toml").code == 0
    run = lmctl("run", "fig9-intersection.lmj", "--sim")
    assert run.code == 0
    assert ": done" in run.data
