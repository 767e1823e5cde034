"""`lmctl plan`: a part file, a bare mesh or a cloud becomes a job file."""

from __future__ import annotations

from pathlib import Path

import click

from lmctl.cli.console import print_data, print_json, print_message
from lmctl.cli.paths import InputFile
from lmctl.cli.planning import job_summary, open_part, plan_to_file, refuse_target, units_option
from lmctl.cli.profiles import load_profile_or_default


@click.command()
@click.argument("part", type=InputFile())
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Job file [PART.lmj].")
@click.option(
    "-m", "--machine", type=InputFile(),
    help="Machine profile to plan for [the bench cell].",
)
@units_option
@click.option("--json", "as_json", is_flag=True, help="Print the totals as one JSON object.")
def plan(
    part: Path, output: Path | None, machine: Path | None, units: str | None, as_json: bool
) -> None:
    """Plan PART (a part file, or an STL, PLY, OBJ, OFF, 3MF, XYZ or CSV file) into a job file.

    A bare mesh or cloud is planned with defaults, and they are named.
    """
    profile = load_profile_or_default(machine)
    if machine is None:
        print_message(f"no --machine given: planning for the {profile.name}")
    target = output or Path(part.name).with_suffix(".lmj")
    refuse_target(target)
    manifest = plan_to_file(open_part(part, units), profile, target)
    if as_json:
        print_json({"job": str(target), **manifest.totals})
    else:
        print_data(job_summary(manifest, target))
