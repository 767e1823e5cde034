"""Names of the trade, one definition of each array type, and the form of decision records."""

from __future__ import annotations

import ast
import re

from tests.house.names import PACKAGES, ROOT, public_names

#: Everyday words that a reader of a name cannot place, where the trade has its own.
EVERYDAY = frozenset({
    "lit", "dark", "told", "tell", "tells", "hear", "hears", "heard", "nobody", "somebody", "feet",
    "foot", "wish", "wished", "befall", "vouch", "heed", "stands", "standing",
})

_WORD = re.compile(r"[A-Z]?[a-z]+")
_ALIAS = re.compile(r"^(\w+) = NDArray\[np\.(?:float64|int64|intp|bool_)\]$", re.MULTILINE)


def test_public_names_are_words_of_the_trade() -> None:
    assert [
        name for name in public_names()
        if EVERYDAY & {word.lower() for word in _WORD.findall(name.rpartition(".")[2])}
    ] == []


def test_array_types_are_defined_once() -> None:
    """`lmctl.array_types` has them; the simulators, which import no lmctl, have their own."""
    twice = {
        path.relative_to(ROOT).as_posix(): found
        for package in PACKAGES for path in (ROOT / package).rglob("*.py")
        if path.name != "array_types.py" and (found := _ALIAS.findall(path.read_text("utf-8")))
    }
    assert twice == {}


def test_a_decision_says_what_and_why_and_is_in_the_index() -> None:
    folder = ROOT / "docs/decisions"
    records = {path.name: path.read_text("utf-8") for path in folder.glob("[0-9]*.md")}
    index = (folder / "index.md").read_text("utf-8")
    assert records
    for name, text in records.items():
        title = text.partition("\n")[0].removeprefix("# ")
        assert f"- [{title}]({name})" in index, name
        headings = [line for line in text.splitlines() if line.startswith("## ")]
        assert headings in (["## What", "## Why"], ["## What", "## Why", "## Measured"]), name
        assert len(text.splitlines()) <= 50, f"{name} is longer than a screen"


#: Doors for programs: what they say of a wrong request is what a right one looks like.
DOORS = ("lmctl/run/control/server.py", "lmctl/web/rest.py", "lmctl/web/operator_seat.py")


def test_every_error_says_what_to_do_next() -> None:
    """An error without a hint leaves its reader alone with what went wrong."""
    kinds = {"UsageError", "InputError", "MachineError", "JournalError", "ConfigError", "JobError",
             "PlanError", "MissingFileError", "RunFailedError", "RunInterruptedError",
             "RunStoppedError"}
    silent = []
    for path in sorted((ROOT / "lmctl").rglob("*.py")):
        name = path.relative_to(ROOT).as_posix()
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and (
                    call.func.id in kinds) and name not in DOORS:
                keys = {keyword.arg for keyword in call.keywords}
                if not keys & {"hint", "findings", None}:
                    silent.append(f"{name}:{call.lineno}")
    assert silent == []
