"""`lmctl init`: an example part to start from, with the simulated cell's files beside it."""

from __future__ import annotations

import shlex
from difflib import get_close_matches
from pathlib import Path

import click

from lmctl.cli.console import print_data
from lmctl.errors import UsageError


@click.command()
@click.argument("template", required=False)
@click.argument("folder", required=False, type=click.Path(path_type=Path))
@click.option("--list", "listed", is_flag=True, help="List the templates and stop.")
@click.option("--force", is_flag=True, help="Replace files of the same names.")
def init(template: str | None, folder: Path | None, listed: bool, force: bool) -> None:
    """Write the example TEMPLATE into FOLDER, by default a new one of the template's name.

    It is a part file, with a machine profile (cell.toml) and a simulated cell (bench.toml).
    """
    from lmctl.examples.templates import CELL_FILES, TEMPLATES, write_template

    if listed:
        for name, text in TEMPLATES.items():
            print_data(f"{name:20} {text}")
        return
    if template is None:
        raise UsageError("which template?", where=_listing(TEMPLATES),
                         hint="`lmctl init gear` makes a folder gear with the first of them in it")
    if template not in TEMPLATES:
        raise _unknown(template, TEMPLATES)
    folder = Path(template) if folder is None else folder
    make_folder(folder)
    there = [name for name in (f"{template}.toml", *CELL_FILES) if (folder / name).exists()]
    if there and not force:
        raise UsageError(f"{folder} already has {', '.join(there)}",
                         hint="name another folder after the template, or replace them with "
                              "--force")
    for path in write_template(template, folder):
        print_data(str(path))
    part = folder / f"{template}.toml"
    words = ["lmctl", "plan", str(part), "--machine", str(folder / "cell.toml")]
    print_data(f"hint: {shlex.join(words)}")


def _listing(templates: dict[str, str]) -> list[str]:
    return [f"{name:20} {text}" for name, text in templates.items()]


def _unknown(name: str, templates: dict[str, str]) -> UsageError:
    near = get_close_matches(name, templates, n=1)
    if near:
        return UsageError(f"there is no template {name!r}", hint=f"did you mean {near[0]!r}?")
    return UsageError(f"there is no template {name!r}", where=_listing(templates),
                      hint="the template comes first, then the folder: "
                           + shlex.join(["lmctl", "init", "gear", name]))


def make_folder(folder: Path) -> None:
    """Make a folder and those above it. Raises UsageError where that cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise UsageError(f"{folder} is a file, not a folder", hint="name another folder") from None
    except OSError as error:
        raise UsageError(f"cannot make the folder {folder}", where=str(error.strerror),
                         hint="name a folder where you may write") from None
