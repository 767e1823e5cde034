"""`lmctl design`: a part file's numbers moved in a page, with the part redrawn while they move."""

from __future__ import annotations

from pathlib import Path

import click

from lmctl.cli.console import print_data, print_message
from lmctl.cli.paths import InputFile
from lmctl.cli.profiles import load_profile_or_default
from lmctl.errors import UsageError


@click.command()
@click.argument("part", type=InputFile())
@click.option("-m", "--machine", type=InputFile(),
              help="Machine profile that a layer's verdict is for [the bench cell].")
@click.option("--port", type=click.IntRange(0, 65535), default=8441, show_default=True,
              help="0 for any free port.")
def design(part: Path, machine: Path | None, port: int) -> None:
    """Open PART, a part file, in a page of this machine, until Ctrl-C.

    Bodies, features, profile points, weights and shares of materials are moved with sliders or
    typed; a section and the surface follow. Saving writes the part file, its comments kept. The
    page changes nothing that the file could not say.
    """
    if part.suffix.lower() != ".toml":
        raise UsageError(f"{part} is no part file",
                         hint="`lmctl init` writes one to start from; it names your mesh or cloud")
    try:
        from lmctl.designer import run_designer
    except ImportError as error:
        raise UsageError("the designer is not installed", where=str(error),
                         hint="`pip install 'lmctl[web]'`") from None

    def say_where(address: str) -> None:
        print_data(f"{part} is open at {address}")
        print_message("Ctrl-C ends the page; what is not saved is lost then.")

    run_designer(part, load_profile_or_default(machine), port, say_where)
