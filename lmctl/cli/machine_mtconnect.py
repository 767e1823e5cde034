"""`lmctl machine devices-xml`: the description of a cell that an MTConnect agent reads."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import click

from lmctl.cli.console import print_data
from lmctl.cli.paths import InputFile
from lmctl.cli.profiles import load_profile_or_default
from lmctl.errors import UsageError


@click.command(name="devices-xml")
@click.option("--machine", type=InputFile(), metavar="FILE",
              help="Machine profile [the cell that ships].")
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="File to write [standard output].")
def devices_xml(machine: Path | None, output: Path | None) -> None:
    """Write Devices.xml of a cell: what an MTConnect agent gets from `lmctl dash --shdr PORT`.

    No device is asked. Write it anew when hoppers or the name of the cell change.
    """
    from lmctl.web.mtconnect_devices import devices_xml as made_of

    profile = load_profile_or_default(machine, calibrated=False)
    text = made_of(profile.name, [hopper.name for hopper in profile.hopper], datetime.now(UTC))
    if output is None:
        print_data(text.rstrip("\n"))
        return
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError.cannot_write(output, error) from None
    print_data(str(output))
