"""The operator's name, for the journal."""

from __future__ import annotations

import getpass
import sys
from collections.abc import Callable
from typing import Any, TypeVar

import click

_Command = TypeVar("_Command", bound=Callable[..., Any])


def operator_option(command: _Command) -> _Command:
    """--operator NAME, or the environment variable LMCTL_OPERATOR; None where neither is given."""
    return click.option(
        "--operator", envvar="LMCTL_OPERATOR", metavar="NAME",
        help="Who you are, for the journal [asked on a terminal].")(command)


def operator_name(given: str | None) -> str:
    """The name given, or asked for at a terminal; "" without a terminal."""
    if given is not None:
        return given.strip()
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return ""
    try:
        answer: str = click.prompt("operator", default=_login_name(), err=True)
    except click.Abort:
        return ""
    return answer.strip()


def _login_name() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return ""
