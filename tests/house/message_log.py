"""A pytest plugin that writes down every error message that the tests bring about.

    python -m pytest -p tests.house.message_log tests/config

Each process of the run adds its messages to a file of its own in the folder that the variable
LMCTL_MESSAGES names; `tests.house.messages` compares them with the code.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from firmware_protocol.table_reader import TableReader
from lmctl.errors import LmctlError

#: Messages of all kinds, of this process.
_seen: set[str] = set()


def _note_texts_of(error: LmctlError) -> None:
    _seen.update((error.what, error.hint, *error.where))


def _noting_init(original: Any) -> Any:
    def init(self: LmctlError, what: str, *arguments: Any, **keywords: Any) -> None:
        original(self, what, *arguments, **keywords)
        _note_texts_of(self)

    return init


def _noting_mistake(original: Any) -> Any:
    def report_mistake(self: TableReader, key: str, reason: str) -> None:
        _seen.add(reason)
        original(self, key, reason)

    return report_mistake


def _noting_exit(original: Any) -> Any:
    """Errors that a test catches by itself, with what they are made of."""
    def leave(self: Any, kind: Any, error: BaseException | None, trace: Any) -> bool:
        if error is not None:
            _seen.add(str(error))
        return bool(original(self, kind, error, trace))

    return leave


def pytest_configure(config: pytest.Config) -> None:
    LmctlError.__init__ = _noting_init(LmctlError.__init__)  # type: ignore[method-assign]
    TableReader.report_mistake = (  # type: ignore[method-assign]
        _noting_mistake(TableReader.report_mistake))
    pytest.RaisesExc.__exit__ = _noting_exit(  # type: ignore[method-assign]
        pytest.RaisesExc.__exit__)


def pytest_unconfigure(config: pytest.Config) -> None:
    folder = Path(os.environ.get("LMCTL_MESSAGES", ".messages"))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{os.getpid()}.json").write_text(json.dumps(sorted(_seen)), encoding="utf-8")
