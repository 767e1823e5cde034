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


# --- what cannot be meant -----------------------------------------------------------------------


@pytest.mark.parametrize(("command", "code", "words", "next_step"), [
    ("chek", 2, "there is no command 'chek'", "did you mean `lmctl check`?"),
    ("machine doctr", 2, "there is no command 'doctr'", "`lmctl machine doctor`"),
    ("frobnicate", 2, "there is no command", "`lmctl --help` lists"),
    ("plan", 2, "missing argument 'PART'", "`lmctl plan --help`"),
    ("plan box.toml --outpt x.lmj", 2, "no option --outpt", "did you mean --output?"),
    ("check box.toml --units furlong", 2, "'furlong' is not one of", "`lmctl check --help`"),
    ("run box.toml --sim", 2, "box.toml is no job file", "`lmctl plan box.toml`"),
    ("run cell.toml --sim --speed nan", 2, "nan is not a number", "`lmctl run --help`"),
    ("check . ", 2, ". is a folder, not a part", "name a file in it"),
    ("plan box", 2, "box is a folder, not a part", "did you mean box/box.toml?"),
    ("check folder.lmj", 1, "folder.lmj is a folder", None),
    ("check box.toml -m bench.toml", 3, "bench.toml is a description of a simulated cell, and a "
     "machine profile is wanted here", "--sim --bench FILE"),
    ("plan box.toml -m box.toml", 3, "box.toml is a part file, and a machine", "lmctl plan FILE"),
    ("plan cell.toml", 3, "cell.toml is a machine profile, and a part file", "--machine FILE"),
    ("show cell.toml", 3, "cell.toml is a machine profile, and a part file", "--machine FILE"),
    ("machine status --sim --bench cell.toml", 3, "cell.toml is a machine profile, and a "
     "description of a simulated cell is wanted", "--machine FILE"),
    ("run job.lmj --sim --faults cell.toml", 3, "cell.toml is a machine profile, and a fault file",
     "--machine FILE"),
    ("check cell.toml -m cell.toml", 2, "it is checked by itself", "a part or a job"),
    ("plan box.toml -o box", 2, "box is a folder", "give -o a file name"),
    ("plan box.toml -o none/box.lmj", 2, "there is no folder none", "make it first"),
    ("show box.toml -x 999", 2, "x = 999 mm, and the part is from 0 to 30", "leave it out"),
    ("show box.toml -x nan", 2, "nan is not a number", "`lmctl show --help`"),
    ("jobs --runs box.toml", 1, "box.toml is not a folder", "--runs names"),
    ("init box cell.toml", 2, "cell.toml is a file, not a folder", "another folder"),
])
def test_each_mistake_is_answered_with_what_to_do(
    command: str, code: int, words: str, next_step: str | None, lmctl: Lmctl, refused: Refused,
    tmp_path: Path
) -> None:
    lmctl("init", "box", ".")
    lmctl("init", "box", "box")
    (tmp_path / "folder.lmj").mkdir()
    (tmp_path / "job.lmj").touch()
    said = refused(*command.split(), code=code, hint=next_step is not None)
    assert words in said
    assert (next_step or "") in said
    assert max(map(len, said.splitlines())) < 140


def test_every_kind_of_file_can_be_checked(lmctl: Lmctl) -> None:
    lmctl("init", "box", ".")
    assert lmctl("check", "bench.toml").data == (
        "bench.toml: a description of a simulated cell, with 2 feeders: F1, F2; nothing wrong\n")
    assert "a machine profile" in lmctl("check", "cell.toml").data
    assert "graded block" in lmctl("check", "box.toml").data


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


def test_a_plain_part_is_checked_without_scipy_and_without_running_a_compiled_kernel(
    lmctl: Lmctl, tmp_path: Path
) -> None:
    lmctl("init", "box", ".")
    code, modules = imported(tmp_path, "check", "box.toml")
    assert code == 0
    assert len(of(modules, "scipy")) <= 15  # numba asks for its version
    assert not {"numba.np.npyimpl", "lmctl.plan.geometry", "lmctl.plan.planner"} & modules
    assert of(modules, "asyncio", "simulators", "matplotlib", "serial", "pymodbus", "rich") == []
    assert len(modules) <= 760


def test_a_profile_is_checked_without_numbers(lmctl: Lmctl, tmp_path: Path) -> None:
    lmctl("init", "box", ".")
    code, modules = imported(tmp_path, "check", "cell.toml")
    assert code == 0
    assert of(modules, "numpy", "asyncio", "serial", "pymodbus") == []
    assert len(modules) <= 310
