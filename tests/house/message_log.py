"""A pytest plugin that notes which error messages the tests bring about, and misses the others.

    python -m pytest -p tests.house.message_log
    LMCTL_MESSAGES=FOLDER python -m pytest -p tests.house.message_log tests/config

The modules that write messages are compiled so that each text is noted when it is made. A message
is reached if one of its texts was said, too: by an error of lmctl, a finding, a mistake in a table,
or an exception that a test expects. A run of all tests fails where a message is not reached. With
LMCTL_MESSAGES set to a folder, a run of any tests writes what it reached into a file there;
`tests.house.messages` compares such files with the code.
"""

from __future__ import annotations

import ast
import builtins
import importlib.abc
import importlib.machinery
import importlib.util
import json
import os
import sys
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import pytest

from tests.house.message_sites import PACKAGES, MessageSites, Site
from tests.house.source_modules import ROOT

_NOTE = "_note_message_made"
#: As many different texts of one message are kept.
_MOST_TEXTS = 500

#: Texts that were made, by message, and texts that were said, of this process.
_made: dict[str, set[str]] = defaultdict(set)
_said: set[str] = set()


def _note_made(key: str, text: Any) -> Any:
    if isinstance(text, str) and len(texts := _made[key]) < _MOST_TEXTS:
        texts.add(text)
    return text


class _Noting(ast.NodeTransformer):
    """Puts a call around each text, which returns it."""

    def __init__(self, sites: Mapping[ast.expr, Site]) -> None:
        self._sites = sites

    def visit(self, node: ast.AST) -> Any:
        visited = self.generic_visit(node)
        if not isinstance(node, ast.expr) or node not in self._sites:
            return visited
        key = ast.Constant(self._sites[node].key)
        call = ast.Call(ast.Name(_NOTE, ast.Load()), [key, node], [])
        return ast.fix_missing_locations(ast.copy_location(call, node))


def _noting_codes() -> dict[str, CodeType]:
    """The code of every module that has messages, by its path; trees take too much to keep."""
    return {
        str(ROOT / module.path): compile(
            _Noting(sites).visit(module.tree), str(ROOT / module.path), "exec", dont_inherit=True)
        for module, sites in MessageSites().by_module()}


class _Loader(importlib.machinery.SourceFileLoader):
    def __init__(self, name: str, path: str, codes: Mapping[str, CodeType]) -> None:
        super().__init__(name, path)
        self._codes = codes

    def get_code(self, fullname: str) -> CodeType | None:
        return self._codes.get(str(self.path)) or super().get_code(fullname)


class _Finder(importlib.abc.MetaPathFinder):
    """Finds the modules of the packages whose messages are noted."""

    def __init__(self, codes: Mapping[str, CodeType]) -> None:
        self._codes = codes

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if name.partition(".")[0] not in PACKAGES:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path or [str(ROOT)], target)
        if spec is not None and isinstance(spec.loader, importlib.machinery.SourceFileLoader):
            spec.loader = _Loader(name, spec.loader.path, self._codes)
        return spec


def _after(original: Any, note: Any) -> Any:
    """The function, with its arguments noted once it has come back."""
    def noting(*arguments: Any, **keywords: Any) -> Any:
        try:
            return original(*arguments, **keywords)
        finally:
            note(*arguments, **keywords)

    return noting


def _note_error(error: Any, *_: Any, **__: Any) -> None:
    _said.update((error.what, error.hint, *error.where))


def _note_finding(finding: Any, *_: Any, **__: Any) -> None:
    _said.add(finding.reason)


def _note_mistake(_: Any, key: str, reason: str) -> None:
    _said.add(reason)


def _note_expected(_: Any, kind: Any, error: BaseException | None, trace: Any) -> None:
    if error is not None:
        _said.add(str(error))


@pytest.hookimpl(tryfirst=True)
def pytest_load_initial_conftests(early_config: pytest.Config) -> None:
    """Before any conftest imports what is to be noted, in the processes that run tests."""
    has_workers = getattr(early_config.known_args_namespace, "numprocesses", None)
    if has_workers and "PYTEST_XDIST_WORKER" not in os.environ:
        return
    early = sorted(name for name in sys.modules if name.partition(".")[0] in PACKAGES)
    assert not early, f"imported before their messages could be noted: {early}"
    setattr(builtins, _NOTE, _note_made)
    sys.meta_path.insert(0, _Finder(_noting_codes()))

    from firmware_protocol.table_reader import TableReader
    from lmctl.errors import Finding, LmctlError

    for kind, name, note in (
        (LmctlError, "__init__", _note_error), (Finding, "__init__", _note_finding),
        (TableReader, "report_mistake", _note_mistake),
        (pytest.RaisesExc, "__exit__", _note_expected),
    ):
        setattr(kind, name, _after(getattr(kind, name), note))


def _reached() -> list[str]:
    said = "\n".join(sorted(_said))
    return sorted(key for key, texts in _made.items() if any(text in said for text in texts))


class _Tally:
    """What all processes of a run have reached. session : of the process that started them"""

    def __init__(self) -> None:
        self.reached: set[str] = set()
        self.missing: list[Site] = []

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any, error: object) -> None:
        self.reached.update(getattr(node, "workeroutput", {}).get("messages", ()))

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> None:
        self.reached.update(_reached())
        if folder := os.environ.get("LMCTL_MESSAGES"):
            Path(folder).mkdir(parents=True, exist_ok=True)
            (Path(folder) / f"{os.getpid()}.json").write_text(
                json.dumps(sorted(self.reached)), encoding="utf-8")
        if exitstatus == 0 and _is_of_all_tests(session.config):
            self.missing = [site for site in MessageSites().all() if site.key not in self.reached]
            if self.missing:
                session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        if self.missing:
            terminalreporter.section("messages that no test brings about")
            for site in self.missing:
                terminalreporter.line(f"{site.path}:{site.line}: {site.pattern}")


def _is_of_all_tests(config: pytest.Config) -> bool:
    chosen = config.option
    return config.args_source is pytest.Config.ArgsSource.TESTPATHS and not (
        chosen.keyword or chosen.markexpr or chosen.deselect or chosen.collectonly
        or getattr(chosen, "lf", False))


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(_Tally(), "message tally")


def pytest_sessionfinish(session: pytest.Session) -> None:
    output = getattr(session.config, "workeroutput", None)
    if output is not None:
        output["messages"] = _reached()
