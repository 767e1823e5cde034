"""How commands speak: data on standard output, talk and progress on standard error."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import click

from lmctl.errors import UsageError


def say(text: str = "") -> None:
    """A line of talk, on standard error."""
    click.echo(text, err=True)


def put(text: str = "") -> None:
    """A line of data, on standard output."""
    click.echo(text)


def put_json(data: Any) -> None:
    """One JSON value on standard output."""
    click.echo(json.dumps(data, ensure_ascii=False, allow_nan=False))


def confirmed(question: str, yes: bool) -> bool:
    """Whether somebody says yes, or has said so before. Raises UsageError where nobody is there."""
    if yes:
        return True
    if not sys.stdin.isatty():
        raise UsageError("nobody is there to be asked", hint="--yes, if you are sure")
    return click.confirm(question, err=True)


def clock(seconds: float) -> str:
    """A duration as people read it: 1:02:03, 2:03, or 4.5 s below a minute."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


@contextmanager
def progress_bar(label: str, unit: str = "") -> Iterator[Callable[[float, float, str], None]]:
    """A bar on standard error while the block runs, only where that is a terminal.

    Yields update(done, total, note); calls cost nothing where no bar is shown.
    """
    if not sys.stderr.isatty():
        yield lambda done, total, note: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (
        TextColumn("{task.description}"), BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"), TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(label, total=None, note="")

        def update(done: float, total: float, note: str) -> None:
            bars.update(task, completed=done, total=total, note=note)

        yield update
