"""The reference page of commands: what each prints with --help."""

from __future__ import annotations

from collections.abc import Iterator

import click

from lmctl.cli.__main__ import program

_WIDTH = 100


def command_page() -> str:
    """docs/reference/commands.md."""
    text = ("<!-- Made from the commands by `python -m tests.house.reference`: change their "
            "docstrings. -->\n# Commands\n\n`lmctl help COMMAND` prints the same. Exit codes: 0 "
            "done, 1 job or check failed, 2 usage, or a file or run that is not there, 3 "
            "configuration, 4 machine unreachable or in alarm, 5 stopped but resumable, 130 "
            "interrupted.\n")
    root = click.Context(program, info_name="lmctl", terminal_width=_WIDTH,
                         max_content_width=_WIDTH, help_option_names=["-h", "--help"])
    for name, help_text in _helps(program, root):
        text += f"\n## `{name}`\n\n```text\n{help_text}\n```\n"
    return text


def _helps(group: click.Group, context: click.Context) -> Iterator[tuple[str, str]]:
    for name in sorted(group.list_commands(context)):
        command = group.get_command(context, name)
        assert command is not None
        own = click.Context(command, info_name=name, parent=context, terminal_width=_WIDTH,
                            max_content_width=_WIDTH)
        yield own.command_path, "\n".join(
            line.rstrip() for line in command.get_help(own).splitlines())
        if isinstance(command, click.Group):
            yield from _helps(command, own)
