"""`lmctl help`, `lmctl schema`, `lmctl completion`: what keys and commands there are."""

from __future__ import annotations

import sys
import textwrap

import click
from click.shell_completion import CompletionItem

from lmctl.cli.console import print_data
from lmctl.reference.key_row import FILE_KINDS, KIND_OF_TABLE, KeyRow

SHELLS = ("bash", "zsh", "fish")


def _known_paths(
    context: click.Context, parameter: click.Parameter, begun: str
) -> list[CompletionItem]:
    """Paths of keys that begin so, one step further."""
    from lmctl.reference.key_rows import load_key_rows

    paths = [*FILE_KINDS, *(row.path for row in load_key_rows())]
    dots = begun.count(".")
    found = dict.fromkeys(
        ".".join(path.split(".")[: dots + 1]) for path in paths if path.startswith(begun))
    return [CompletionItem(path) for path in found]


@click.command(name="help")
@click.argument("what", required=False, shell_complete=_known_paths)
@click.pass_context
def help(context: click.Context, what: str | None) -> None:
    """Explain a key (part.process.overlap), the keys of a table (part.process), or a command."""
    if what is None:
        print_data("lmctl help KEY explains a key or a table of:")
        for kind, title in FILE_KINDS.items():
            print_data(f"  {kind:10} {title}")
        print_data("lmctl help COMMAND explains a command; `lmctl --help` lists them.")
        return
    group = context.find_root().command
    if isinstance(group, click.Group) and what in group.list_commands(context):
        command = group.get_command(context, what)
        assert command is not None
        with click.Context(command, info_name=what, parent=context.find_root()) as inner:
            print_data(command.get_help(inner))
        return
    from lmctl.reference.key_rows import load_key_rows, rows_under

    rows = load_key_rows()
    found = rows_under(rows, what)
    if len(found) == 1 or found[0].path == what.strip("."):
        print_data(_in_full(found[0]))
        found = found[1:]
        if found:
            print_data("")
    wide = max((len(row.path) for row in found), default=0) + 4
    for row in found:
        print_data(textwrap.fill(row.text, 100, initial_indent=f"  {row.path:{wide - 2}}",
                                 subsequent_indent=" " * wide))


def _in_full(row: KeyRow) -> str:
    """Everything known of one key."""
    default = row.default or ("none: it must be given" if row.is_required else "left out")
    lines = [row.path, textwrap.fill(row.text, 98, initial_indent="  ", subsequent_indent="  ")]
    if row.type == KIND_OF_TABLE:
        return "\n".join(lines)
    lines += [f"  type      {row.type}"]
    lines += [f"  unit      {row.unit}"] * bool(row.unit)
    lines += [f"  default   {default}"]
    lines += [f"  range     {row.allowed}"] * bool(row.allowed)
    lines += [f"  example   {row.key} = {row.example}"] * (row.type != "list of tables")
    lines += [f"  keys      as of {row.same_as}"] * bool(row.same_as)
    return "\n".join(lines)


@click.command()
@click.argument("kind", type=click.Choice(list(FILE_KINDS)))
def schema(kind: str) -> None:
    """Print the JSON schema of a kind of file, for editors that complete and check keys."""
    from lmctl.reference.schema_files import schema_file

    print_data(schema_file(kind).read_text(encoding="utf-8").rstrip("\n"))


@click.command()
@click.argument("shell", type=click.Choice(SHELLS))
@click.pass_context
def completion(context: click.Context, shell: str) -> None:
    """Print what makes a shell complete commands, options, files and keys.

    Add `source <(lmctl completion bash)` to ~/.bashrc; for fish, write it to
    ~/.config/fish/completions/lmctl.fish.
    """
    from click.shell_completion import get_completion_class

    maker = get_completion_class(shell)
    assert maker is not None, "click knows every one of them"
    made = maker(context.find_root().command, {}, "lmctl", "_LMCTL_COMPLETE")
    sys.stdout.write(made.source_template % made.source_vars())
