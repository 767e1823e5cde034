"""`lmctl plan`: a part file, a bare mesh or a cloud becomes a job file."""

from __future__ import annotations

from pathlib import Path

import click

from lmctl.cli.console import put, put_json, say
from lmctl.cli.paths import InputFile
from lmctl.cli.planning import open_part, plan_to_file, summary, units_option
from lmctl.cli.profiles import profile_or_bench_cell


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
    profile = profile_or_bench_cell(machine)
    if machine is None:
        say(f"no --machine given: planning for the {profile.name}")
    target = output or Path(part.name).with_suffix(".lmj")
    manifest = plan_to_file(open_part(part, units), profile, target)
    if as_json:
        put_json({"job": str(target), **manifest.totals})
    else:
        put(summary(manifest, target))
