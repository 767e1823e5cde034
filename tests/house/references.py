"""Dotted names that documents put in backticks, held against the tree."""

from __future__ import annotations

import ast
import re
from pathlib import Path

PACKAGES = ("lmctl", "simulators", "firmware_protocol")
_DOTTED = re.compile(r"`([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)+)(?:\(\))?`")
_FILE_ENDINGS = frozenset(
    ["asc", "c", "csv", "h", "html", "json", "jsonl", "lmj", "lock", "md", "pdf", "ply", "png",
     "pts", "py", "rels", "sock", "stl", "toml", "vti", "xyz"])


def stale_references(root: Path, documents: list[Path]) -> list[str]:
    """What documents name that is no module, class, function or member of the tree."""
    tree = _Tree(root)
    return [
        f"{document.relative_to(root).as_posix()}: {name}"
        for document in documents
        for name in _DOTTED.findall(document.read_text(encoding="utf-8"))
        if name.rpartition(".")[2] not in _FILE_ENDINGS and tree.lacks(name)
    ]


class _Tree:
    """The names of the packages below `root`: those of each module, and members of each class."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._rooms = {path.name for path in (root / "lmctl").iterdir() if path.is_dir()}
        self._modules = {
            path: _definitions(
                path) for package in PACKAGES for path in (root / package).rglob("*.py")
        }
        self._classes = {
            name: members
            for names in self._modules.values() for name, members in names.items()
            if members is not None
        }

    def lacks(self, dotted: str) -> bool:
        """Whether a name claims to be of this tree and is not there."""
        first, *rest = dotted.split(".")
        if first in self._classes:
            return rest[0] not in (self._classes[first] or ())
        if first not in PACKAGES and first not in self._rooms:
            return False
        place = self._root / (first if first in PACKAGES else f"lmctl/{first}")
        while rest and (place / rest[0]).is_dir():
            place /= rest.pop(0)
        if not rest:
            return False
        names = self._modules.get((place / rest.pop(0)).with_suffix(".py"))
        if names is None:
            return True
        if not rest:
            return False
        members = names.get(rest[0])
        return rest[0] not in names or (len(rest) > 1 and rest[1] not in (members or ()))


def _definitions(path: Path) -> dict[str, set[str] | None]:
    """The names a module defines; of classes, their members."""
    found: dict[str, set[str] | None] = {}
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        match node:
            case ast.ClassDef(name=name):
                found[name] = {
                    getattr(inner, "name", None) or getattr(inner, "attr", None) or inner.id
                    for inner in ast.walk(node)
                    if isinstance(inner, ast.FunctionDef | ast.AsyncFunctionDef | ast.Attribute)
                    or (isinstance(inner, ast.Name) and isinstance(inner.ctx, ast.Store))
                }
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                found[name] = None
            case ast.Assign(targets=targets):
                found |= {one.id: None for one in targets if isinstance(one, ast.Name)}
            case ast.AnnAssign(target=ast.Name(id=name)):
                found[name] = None
    return found
