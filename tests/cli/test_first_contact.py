"""What a new user meets first: files that are not there, and how much is imported to say so."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.conftest import Lmctl

Refused = Callable[..., str]

#: Prints the names of all modules that a command has imported.
_IMPORTED = """
import json, sys
from lmctl.cli.__main__ import main
code = main(sys.argv[1:])
print(json.dumps([code, sorted(sys.modules)]))
"""


# --- files that are not there -------------------------------------------------------------------


@pytest.mark.parametrize("command", [
    ("check", "none.toml"), ("check", "none.stl"), ("check", "none.lmj"), ("check", "none"),
    ("check", "part.toml"), ("check", "two.toml"), ("check", "cell.toml/none.toml"),
    ("check", "part.toml", "-m", "none.toml"), ("check", "no folder/none.stl"),
    ("plan", "none.toml"), ("plan", "none.xyz"), ("plan", "part.toml", "-m", "none.toml"),
    ("plan", "part.toml"), ("show", "none.lmj"), ("show", "none.stl"), ("show", "part.toml"),
    ("run", "none.lmj", "--sim"), ("run", "none.lmj"), ("run", "cell.toml", "-m", "none.toml"),
    ("run", "cell.toml", "--sim", "--bench", "none.toml"),
    ("run", "cell.toml", "--sim", "--faults", "none.toml"),
    ("log", "run-0001"), ("log", "none/journal.jsonl"), ("recover", "run-0001", "--sim"),
    ("status", "run-0001"), ("hold", "run-0001"), ("resume", "run-0001"), ("stop", "run-0001"),
    ("override", "80", "run-0001"),
    ("machine", "status", "-m", "none.toml"), ("machine", "doctor", "-m", "none.toml"),
    ("machine", "home", "--sim", "--bench", "none.toml"), ("machine", "unlock", "-m", "none.toml"),
    ("machine", "jog", "X1", "-m", "none.toml"), ("machine", "offset", "X1", "-m", "none.toml"),
], ids=" ".join)
def test_what_is_not_there_has_one_exit_code_everywhere(
    command: tuple[str, ...], lmctl: Lmctl, refused: Refused, tmp_path: Path
) -> None:
    lmctl("init", "box", ".")
    body = '[[body]]\nkind = "mesh"\nunits = "mm"\nfile = "{}"\n'
    head = 'name = "p"\n{}[[material]]\nname = "316L"\n'
    (tmp_path / "part.toml").write_text(head.format("") + body.format("none.stl"))
    (tmp_path / "two.toml").write_text(
        head.format('combine = "union"\n') + body.format("none.stl") + body.format("no.obj"))
    assert "there is no " in refused(*command, code=2) or command[1] == "two.toml"


def test_a_name_that_is_nearly_right_is_guessed(
    lmctl: Lmctl, refused: Refused, tmp_path: Path
) -> None:
    lmctl("init", "box")
    assert "did you mean box/box.toml?" in refused("check", "box/bax.toml", code=2)
    assert "there is no folder bix" in refused("check", "bix/box.toml", code=2)


# --- what is imported ---------------------------------------------------------------------------


def imported(folder: Path, *arguments: str) -> tuple[int, set[str]]:
    """The exit code of a command in a process of its own, and the modules it has imported."""
    done = subprocess.run([sys.executable, "-c", _IMPORTED, *arguments], cwd=folder, check=True,
                          capture_output=True, text=True)
    code, modules = json.loads(done.stdout.splitlines()[-1])
    return code, set(modules)


def of(modules: set[str], *packages: str) -> list[str]:
    return sorted(name for name in modules if name.split(".")[0] in packages)


def test_help_imports_no_library_but_the_one_that_prints_it(tmp_path: Path) -> None:
    code, modules = imported(tmp_path, "--help")
    assert code == 0
    assert of(modules, "numpy", "pydantic", "numba", "scipy", "asyncio", "rich") == []
    assert len(modules) <= 140


@pytest.mark.parametrize("name", ["none.toml", "none.stl", "none.lmj"])
def test_a_missing_file_is_found_missing_before_anything_large_is_imported(
    name: str, tmp_path: Path
) -> None:
    code, modules = imported(tmp_path, "check", name)
    assert code == 2
    assert of(modules, "numpy", "numba", "scipy") == []
    assert len(modules) <= 300


def test_a_list_of_templates_needs_no_numbers(tmp_path: Path) -> None:
    code, modules = imported(tmp_path, "init", "--list")
    assert code == 0
    assert of(modules, "numpy", "pydantic") == []
    assert len(modules) <= 160
