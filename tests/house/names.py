"""Prints public names without code, for a reader who does not know the project to say what each is.

python -m tests.house.names [SEED] [COUNT]
"""

from __future__ import annotations

import ast
import random
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("lmctl", "simulators", "firmware_protocol")


def public_names() -> list[str]:
    """Dotted names of all public classes, functions, methods, fields and constants, sorted."""
    found: set[str] = set()
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            if path.name == "__init__.py":
                continue
            module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            found |= {f"{module}.{name}" for name in _names_in(ast.parse(path.read_text("utf-8")))}
    return sorted(found)


def _names_in(tree: ast.Module) -> Iterator[str]:
    for node in tree.body:
        for name in _bound(node):
            yield name
            if isinstance(node, ast.ClassDef):
                for member in node.body:
                    yield from (f"{name}.{inner}" for inner in _bound(member))


def _bound(node: ast.stmt) -> list[str]:
    """The public names a statement binds."""
    names: list[str] = []
    if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        names = [node.name]
    elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
        names = [node.target.id]
    elif isinstance(node, ast.Assign):
        names = [target.id for target in node.targets if isinstance(target, ast.Name)]
    return [name for name in names if not name.startswith("_")]


def main(arguments: list[str]) -> None:
    seed = int(arguments[0]) if arguments else 0
    count = int(arguments[1]) if len(arguments) > 1 else 100
    print("\n".join(random.Random(seed).sample(public_names(), count)))


if __name__ == "__main__":
    main(sys.argv[1:])
