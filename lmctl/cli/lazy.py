"""A click group that imports a command's module only when that command is called."""

from __future__ import annotations

import importlib
from difflib import get_close_matches
from typing import Any

import click

from lmctl.errors import UsageError


class LazyGroup(click.Group):
    """commands : {name: (module, one line of help)}; the module holds a click command of that name,
    with _ for each - in it.

    `--help` shows the table without importing anything, which keeps it below 0.15 s.
    """

    def __init__(self, *args: Any, table: dict[str, tuple[str, str]], **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._table = table

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self._table)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self._table:
            return None
        module = importlib.import_module(self._table[cmd_name][0])
        command = getattr(module, cmd_name.replace("-", "_"))
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Raises UsageError with a guess for a command that there is not."""
        name = args[0]
        if name not in self._table and not name.startswith("-"):
            near = get_close_matches(name, self._table, n=1)
            raise UsageError(
                f"there is no command {name!r}",
                hint=f"did you mean `{ctx.command_path} {near[0]}`?" if near
                else f"`{ctx.command_path} --help` lists the commands",
            )
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in self._table.items()])
