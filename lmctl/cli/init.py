"""`lmctl init`: an example part to start from, with the simulated cell's files beside it."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from lmctl.cli.console import put
from lmctl.errors import UsageError


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), default=Path())
@click.option("-t", "--template", default="gear", show_default=True,
              help="Which example; --list names them.")
@click.option("--list", "listed", is_flag=True, help="List the templates and stop.")
@click.option("--force", is_flag=True, help="Replace files of the same names.")
def init(folder: Path, template: str, listed: bool, force: bool) -> None:
    """Write an example part, its cell profile and its bench into FOLDER [this one]."""
    from lmctl.examples.templates import CELL_FILES, TEMPLATES, write_template

    if listed:
        for name, text in TEMPLATES.items():
            put(f"{name:20} {text}")
        return
    if template not in TEMPLATES:
        raise UsageError(
            f"there is no template {template!r}",
            where=[f"{name}: {text}" for name, text in TEMPLATES.items()],
            hint="choose one with --template",
        )
    make_folder(folder)
    there = [name for name in (f"{template}.toml", *CELL_FILES) if (folder / name).exists()]
    if there and not force:
        raise UsageError(f"{folder} already has {', '.join(there)}",
                         hint="choose another folder, or replace them with --force")
    for path in write_template(template, folder):
        put(str(path))
    part = folder / f"{template}.toml"
    words = ["lmctl", "plan", str(part), "--machine", str(folder / "cell.toml")]
    put(f"hint: {shlex.join(words)}")


def make_folder(folder: Path) -> None:
    """Make a folder and those above it. Raises UsageError where that cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"cannot make the folder {folder}", where=str(error.strerror)) from None
