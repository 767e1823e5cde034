"""Which error messages of the code a run of the tests has brought about.

    LMCTL_MESSAGES=FOLDER python -m pytest -p tests.house.message_log
    python -m tests.house.messages FOLDER

Messages are the texts that `lmctl` and `firmware_protocol` give to errors, findings and mistakes,
each as a pattern: what is put in at run time may be anything. A message counts as tested where a
text of the run matches its pattern. Prints how many there are, and those that no test reaches.
"""

from __future__ import annotations

import ast
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("lmctl", "firmware_protocol")
#: Which argument of a call is the message, by the name that is called.
_ARGUMENT = {"Finding": 1, "report_mistake": 1, "error": 0}
#: Lists of mistakes that are joined into one error.
_LISTS = frozenset({"wrong", "mistakes", "findings", "missing", "reasons"})
#: Texts of bugs in lmctl itself: no user is to see them, and no test can bring them about.
_BUGS = frozenset({"AssertionError", "NotImplementedError", "RuntimeError", "KeyError",
                   "AttributeError", "TypeError"})
_LEAST_LETTERS = 6


class Message(NamedTuple):
    """place : file and line; pattern : of its text"""

    place: str
    pattern: str


def messages() -> list[Message]:
    """Every message of the code."""
    found = []
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = path.relative_to(ROOT).as_posix()
            for node in _texts(ast.parse(path.read_text(encoding="utf-8"))):
                pattern = _pattern(node)
                if len(re.sub(r"\\.|[^A-Za-z]|\.\*", "", pattern)) >= _LEAST_LETTERS:
                    found.append(Message(f"{name}:{node.lineno}", pattern))
    return list(dict.fromkeys(found))


def untested(texts: set[str]) -> list[Message]:
    """Messages that none of the texts matches."""
    joined = "\n".join(sorted(texts))
    return [one for one in messages() if not re.search(one.pattern, joined)]


def _texts(tree: ast.Module) -> Iterator[ast.expr]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            name = _called(node.func)
            is_error = name.endswith("Error") and name not in _BUGS
            at = _ARGUMENT.get(name, 0 if is_error else None)
            if at is not None and at < len(node.args):
                yield from _strings(node.args[at])
            if name == "append" and _called(getattr(node.func, "value", node)) in _LISTS:
                yield from _strings(node.args[0])
        elif isinstance(node, ast.AugAssign | ast.Assign):
            target = node.target if isinstance(node, ast.AugAssign) else node.targets[0]
            if _called(target) in _LISTS:
                yield from _strings(node.value)


def _strings(node: ast.expr) -> Iterator[ast.expr]:
    """The texts of an expression: itself, both sides of a choice, items of a list."""
    if isinstance(node, ast.JoinedStr) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str)
    ):
        yield node
    elif isinstance(node, ast.IfExp):
        yield from _strings(node.body)
        yield from _strings(node.orelse)
    elif isinstance(node, ast.List | ast.Tuple):
        for item in node.elts:
            yield from _strings(item)
    elif isinstance(node, ast.ListComp | ast.GeneratorExp):
        yield from _strings(node.elt)
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        yield from _strings(node.left)


def _pattern(node: ast.expr) -> str:
    """A regular expression for the texts of a literal or an f-string."""
    if isinstance(node, ast.Constant):
        return re.escape(str(node.value))
    assert isinstance(node, ast.JoinedStr)
    return "".join(re.escape(str(part.value)) if isinstance(part, ast.Constant) else ".*"
                   for part in node.values)


def _called(node: ast.expr) -> str:
    return node.id if isinstance(node, ast.Name) else (
        node.attr if isinstance(node, ast.Attribute) else "")


def main(arguments: list[str]) -> int:
    if not arguments:
        print(__doc__)
        return 2
    texts: set[str] = set()
    for folder in map(Path, arguments):
        for path in folder.glob("*.json"):
            texts |= set(json.loads(path.read_text(encoding="utf-8")))
    known, missing = messages(), untested(texts)
    for one in missing:
        print(f"{one.place}: {one.pattern}")
    print(json.dumps({"messages": len(known), "untested": len(missing),
                      "messages_tested": round(1 - len(missing) / len(known), 3)}))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
