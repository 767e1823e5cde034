"""Modules of the code as they are parsed: functions, what they are given, what their names hold."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)
_LEAST_LETTERS = 6

Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Scope:
    """A function (None: the module itself) in its module and, where it is a method, its class."""

    module: SourceModule
    function: Function | None
    outer: Scope | None


class SourceModule:
    """One parsed file. constants : texts that it names at its top"""

    def __init__(self, path: Path, root: Path) -> None:
        self.path = path.relative_to(root).as_posix()
        self.tree = ast.parse(path.read_text(encoding="utf-8"))
        self.constants = {
            target.id: node.value
            for node in self.tree.body if isinstance(node, ast.Assign | ast.AnnAssign)
            for target in ([node.target] if isinstance(node, ast.AnnAssign) else node.targets)
            if isinstance(target, ast.Name) and is_text(node.value)}
        self.scope_of: dict[ast.AST, Scope] = {}
        self.classes: list[ast.ClassDef] = []
        self._enter(self.tree, Scope(self, None, None))

    def _enter(self, node: ast.AST, scope: Scope) -> None:
        self.scope_of[node] = scope
        if isinstance(node, ast.ClassDef):
            self.classes.append(node)
        inner = Scope(self, node, scope) if isinstance(node, FUNCTION) else scope
        for child in ast.iter_child_nodes(node):
            self._enter(child, inner)


def values_of(name: str, scope: Scope) -> Iterator[tuple[ast.expr, int]]:
    """What a function puts into a variable of its own, and which item of it, -1 for all."""
    assert scope.function is not None
    for node in ast.walk(scope.function):
        if isinstance(node, ast.Assign | ast.AnnAssign | ast.AugAssign | ast.NamedExpr):
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                if isinstance(target, ast.Name) and target.id == name and node.value:
                    yield node.value, -1
                elif isinstance(target, ast.Tuple) and node.value:
                    for place, one in enumerate(target.elts):
                        if isinstance(one, ast.Name) and one.id == name:
                            yield node.value, place
        elif isinstance(node, ast.For) and isinstance(node.target, ast.Name):
            if node.target.id == name:
                yield node.iter, -1
        elif (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
              and node.func.attr in ("append", "extend", "add")
              and isinstance(node.func.value, ast.Name) and node.func.value.id == name):
            yield node.args[0], -1


def parameter_of(function: Function, name: str) -> ast.arg | None:
    arguments = function.args
    return next((one for one in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)
                 if one.arg == name), None)


def is_text(node: ast.expr | None) -> bool:
    return isinstance(node, ast.JoinedStr) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str))


def is_sentence(pattern: str) -> bool:
    said = re.sub(r"\\(.)", r"\1", pattern.replace(".*", ""))
    return " " in said.strip() and len(re.sub(r"[^A-Za-z]", "", said)) >= _LEAST_LETTERS


def pattern_of(module: SourceModule, node: ast.expr) -> str:
    """A regular expression for what a text says: what is put in at run time may be anything."""
    if isinstance(node, ast.Name):
        return pattern_of(module, module.constants[node.id])
    if isinstance(node, ast.Call):  # "...".format(...)
        assert isinstance(node.func, ast.Attribute)
        return re.sub(r"\\\{.*?\\\}", ".*", pattern_of(module, node.func.value))
    if isinstance(node, ast.Constant):
        return re.escape(str(node.value))
    assert isinstance(node, ast.JoinedStr)
    return "".join(re.escape(str(part.value)) if isinstance(part, ast.Constant) else ".*"
                   for part in node.values)


def called_name(node: ast.expr) -> str:
    return node.id if isinstance(node, ast.Name) else (
        node.attr if isinstance(node, ast.Attribute) else "")
