"""Output of commands: data on standard output, messages and progress on standard error."""

from __future__ import annotations

import json
import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import click

from lmctl.errors import UsageError


def print_message(text: str = "") -> None:
    """A line of message text, on standard error."""
    click.echo(text, err=True)


def wrapped(text: str) -> str:
    """A long sentence in lines of a terminal's least width, those after the first indented."""
    return textwrap.fill(text, 79, subsequent_indent="  ", break_long_words=False,
                         break_on_hyphens=False)


def print_data(text: str = "") -> None:
    """A line of data, on standard output."""
    click.echo(text)


def print_json(data: Any) -> None:
    """One JSON value on standard output."""
    click.echo(json.dumps(data, ensure_ascii=False, allow_nan=False))


def ask_confirmation(question: str, yes: bool) -> bool:
    """Whether the operator confirms, or `yes` is set. Raises UsageError without a terminal."""
    if yes:
        return True
    if not sys.stdin.isatty():
        raise UsageError("there is no terminal to ask at", hint="--yes, if you are sure")
    return click.confirm(question, err=True)


def format_duration(seconds: float) -> str:
    """A duration as people read it: 1:02:03, 2:03, or 4.5 s below a minute."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


@dataclass(frozen=True)
class ProgressBar:
    """A progress bar, or none. Call it with (done, total, note): that costs nothing without one.

    notice : prints a line, above the bar where there is one; see the function of that name
    """

    update: Callable[[float, float, str], None]
    notice: Callable[[str], None]

    def __call__(self, done: float, total: float, note: str) -> None:
        self.update(done, total, note)


def print_notice(line: str) -> None:
    """A message from a machine at work, which goes on even if standard error is closed."""
    with suppress(OSError, ValueError):
        print_message(line)


@contextmanager
def progress_bar(label: str, unit: str = "") -> Iterator[ProgressBar]:
    """A bar on standard error while the block runs, only where that is a terminal."""
    if not sys.stderr.isatty():
        yield ProgressBar(lambda done, total, note: None, print_notice)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (
        TextColumn("{task.description}"), BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"), TextColumn("{task.fields[note]}"),
    )
    console = Console(stderr=True)

    def above(line: str) -> None:
        with suppress(OSError, ValueError):
            console.print(line, markup=False, highlight=False, soft_wrap=True)

    with Progress(*columns, console=console, transient=True) as bars:
        task = bars.add_task(label, total=None, note="")

        def update(done: float, total: float, note: str) -> None:
            bars.update(task, completed=done, total=total, note=note)

        yield ProgressBar(update, above)
