"""Where the code writes its error messages: texts that end up in an error, finding or mistake.

A text is followed from where it is written to where it is said: through variables, choices, lists
that are joined, functions that return it, and functions that are given it. Texts are literals and
f-strings of at least two words; hints belong to their messages and are not counted by themselves.
"""

from __future__ import annotations

import ast
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from tests.house.source_modules import (
    FUNCTION,
    ROOT,
    Function,
    Scope,
    SourceModule,
    called_name,
    is_sentence,
    is_text,
    parameter_of,
    pattern_of,
    values_of,
)

PACKAGES = ("lmctl", "firmware_protocol")
#: Texts of bugs in lmctl itself: no user is to see them, and no test can bring them about. The
#: last ones are told in other words: of a connection by what it showed, of normals as a warning.
_BUGS = frozenset({"AssertionError", "NotImplementedError", "RuntimeError", "KeyError",
                   "IndexError", "AttributeError", "TypeError", "UnicodeDecodeError",
                   "ConnectionError", "TimeoutError", "UnusableNormalsError"})
#: Where the message is among the arguments, by the name that is called, and its keyword.
_ARGUMENT = {"Finding": (1, "reason"), "report_mistake": (1, "reason")}


class Site(NamedTuple):
    """path : of the module, from the root; line : of the text; pattern : of what it says

    number : which one with this pattern it is in the module, from 1
    """

    path: str
    line: int
    pattern: str
    number: int

    @property
    def key(self) -> str:
        """What it is called wherever else in the module lines come and go."""
        return f"{self.path} {self.number} {self.pattern}"


class MessageSites:
    """Texts of all messages, found once over all packages. root : the folder that holds them"""

    def __init__(self, root: Path = ROOT) -> None:
        self._modules = [SourceModule(path, root) for package in PACKAGES
                         for path in sorted((root / package).rglob("*.py"))]
        self._functions: dict[str, list[Scope]] = defaultdict(list)
        self._calls: dict[str, list[tuple[ast.Call, Scope]]] = defaultdict(list)
        self._base: dict[str, str] = {}
        self._own_init: dict[str, list[Scope]] = defaultdict(list)
        for module in self._modules:
            self._index(module)
        #: Nodes that are texts of messages, with their modules; what was followed already.
        self._found: dict[ast.expr, SourceModule] = {}
        self._followed: set[tuple[int, int]] = set()
        for calls in list(self._calls.values()):
            for call, scope in calls:
                self._say(call, scope)

    def all(self) -> list[Site]:
        """In the order of the code."""
        return [site for _, of_module in self.by_module() for site in of_module.values()]

    def by_module(self) -> Iterator[tuple[SourceModule, dict[ast.expr, Site]]]:
        """Modules that have any, in order, each with the nodes of its tree that are messages."""
        for module, of_module in groupby(
            sorted(self._found.items(), key=lambda item: (
                item[1].path, item[0].lineno, item[0].col_offset)), key=lambda item: item[1]
        ):
            sites: dict[ast.expr, Site] = {}
            seen: Counter[str] = Counter()
            for node, _ in of_module:
                pattern = pattern_of(module, node)
                seen[pattern] += 1
                sites[node] = Site(module.path, node.lineno, pattern, seen[pattern])
            yield module, sites

    def _index(self, module: SourceModule) -> None:
        for node, scope in module.scope_of.items():
            if isinstance(node, FUNCTION):
                self._functions[node.name].append(Scope(module, node, scope))
            elif isinstance(node, ast.Call):
                self._calls[called_name(node.func)].append((node, scope))
        for one in module.classes:
            self._base[one.name] = called_name(one.bases[0]) if one.bases else ""
            self._own_init[one.name] += [
                Scope(module, item, module.scope_of[item]) for item in one.body
                if isinstance(item, FUNCTION) and item.name == "__init__"]

    def _say(self, call: ast.Call, scope: Scope) -> None:
        """Follow the message of a call that makes an error, a finding or a mistake."""
        name = called_name(call.func)
        if name in _ARGUMENT:
            self._follow_argument(call, *_ARGUMENT[name], scope)
        elif name.endswith("Error") and name not in _BUGS:
            self._follow_argument(call, self._place_of_message(name), "what", scope)
            for keyword in call.keywords:
                if keyword.arg == "where" and not is_text(keyword.value):
                    self._follow(keyword.value, scope)  # all that is wrong, one a line
        elif _is_made_by_its_class(call, scope):
            self._follow_argument(call, 0, "what", scope)

    def _place_of_message(self, error: str) -> int:
        """Which argument of an error class is its message: the first, or the one called so."""
        for made in self._own_init[error]:
            assert made.function is not None
            names = [one.arg for one in made.function.args.args[1:]]
            return names.index("what") if "what" in names else 0
        base = self._base.get(error, "")
        return self._place_of_message(base) if base else 0

    def _follow_argument(self, call: ast.Call, at: int, keyword: str, scope: Scope) -> None:
        if at < len(call.args):
            self._follow(call.args[at], scope)
        for given in call.keywords:
            if given.arg == keyword:
                self._follow(given.value, scope)

    def _follow(self, node: ast.expr, scope: Scope, item: int = -1) -> None:
        """Find the texts of an expression. item : which of a tuple of texts, -1 for all"""
        if (id(node), item) in self._followed or _is_compiled(scope):
            return
        self._followed.add((id(node), item))
        match node:
            case ast.Constant(value=str()) | ast.JoinedStr():
                if is_sentence(pattern_of(scope.module, node)):
                    self._found[node] = scope.module
                if isinstance(node, ast.JoinedStr):
                    for part in node.values:
                        if isinstance(part, ast.FormattedValue) and isinstance(
                                part.value, ast.Name | ast.Call):
                            self._follow(part.value, scope)
            case ast.IfExp():
                self._follow(node.body, scope, item)
                self._follow(node.orelse, scope, item)
            case ast.BoolOp():
                for value in node.values:
                    self._follow(value, scope, item)
            case ast.NamedExpr():
                self._follow(node.value, scope, item)
            case ast.Tuple() | ast.List() | ast.Set():
                for value in node.elts if item < 0 else node.elts[item:item + 1]:
                    self._follow(value, scope)
            case ast.ListComp() | ast.GeneratorExp() | ast.SetComp():
                self._follow(node.elt, scope, item)
            case ast.Starred():
                self._follow(node.value, scope)
            case ast.Await():
                self._follow(node.value, scope, item)
            case ast.BinOp(op=ast.Add()):
                self._follow(node.left, scope)
                self._follow(node.right, scope)
            case ast.Call():
                self._follow_call(node, scope, item)
            case ast.Name():
                self._follow_name(node, scope, item)
            case _:
                pass

    def _follow_call(self, call: ast.Call, scope: Scope, item: int) -> None:
        name = called_name(call.func)
        if isinstance(call.func, ast.Attribute) and is_text(call.func.value):
            if name == "join":
                self._follow(call.args[0], scope)
            elif name == "format" and is_sentence(pattern_of(scope.module, call)):
                self._found[call] = scope.module
            return
        if name in ("list", "tuple", "sorted", "set") and call.args:
            self._follow(call.args[0], scope)
            return
        if isinstance(call.func, ast.Attribute) and not (
                isinstance(call.func.value, ast.Name)
                and (call.func.value.id in ("self", "cls") or call.func.value.id[:1].isupper())):
            return  # of what it is a method cannot be told from the text
        for made in self._definitions(name, scope):
            for node in ast.walk(made.function or made.module.tree):
                if (isinstance(node, ast.Return | ast.Yield | ast.YieldFrom) and node.value
                        and _function_of(made.module, node) is made.function):
                    self._follow(node.value, made, item)

    def _follow_name(self, name: ast.Name, scope: Scope, item: int) -> None:
        at: Scope | None = scope
        while at is not None and at.function is not None:
            if parameter_of(at.function, name.id) is not None:
                self._follow_parameter(name.id, at)
                return
            values = list(values_of(name.id, at))
            for value, part in values:
                self._follow(value, at, part if part >= 0 else item)
            if values:
                return
            at = at.outer
        text = scope.module.constants.get(name.id)
        if text is not None and is_sentence(pattern_of(scope.module, text)):
            self._found[name] = scope.module

    def _follow_parameter(self, name: str, scope: Scope) -> None:
        """Find the texts that callers give to a parameter."""
        function = scope.function
        found = None if function is None else parameter_of(function, name)
        if function is None or found is None or (id(found), 0) in self._followed:
            return
        if found.annotation is not None and "str" not in ast.unparse(found.annotation):
            return
        self._followed.add((id(found), 0))
        names = [one.arg for one in (*function.args.posonlyargs, *function.args.args)]
        is_method = names[:1] in (["self"], ["cls"])
        at = names.index(name) - is_method if name in names else 10**6
        called = function.name
        if called == "__init__":
            called = next(one.name for one in scope.module.classes if function in one.body)
        is_own = called.startswith("_") or (  # which of several is called cannot be told
            len(self._functions[called]) > 1 and "error" not in called)
        for call, where in self._calls[called]:
            if not is_own or where.module is scope.module:
                self._follow_argument(call, at, name, where)

    def _definitions(self, name: str, scope: Scope) -> Iterable[Scope]:
        return [made for made in self._functions[name]
                if made.module is scope.module
                or (not name.startswith("_") and len(self._functions[name]) == 1)]


def _function_of(module: SourceModule, node: ast.AST) -> Function | None:
    return module.scope_of[node].function


def _is_compiled(scope: Scope) -> bool:
    """Whether numba compiles it: nothing of it can be watched."""
    return scope.function is not None and any(
        "jit" in ast.unparse(one) for one in scope.function.decorator_list)


def _is_made_by_its_class(call: ast.Call, scope: Scope) -> bool:
    """Whether an error class calls itself, or what it is derived from."""
    own = next((one.name for one in scope.module.classes if scope.function in one.body), "")
    if not own.endswith("Error"):
        return False
    return called_name(call.func) == "cls" or (
        isinstance(call.func, ast.Attribute) and call.func.attr == "__init__"
        and isinstance(call.func.value, ast.Call) and called_name(call.func.value.func) == "super")


