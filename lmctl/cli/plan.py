"""`lmctl plan`: a part file, a bare mesh or a cloud becomes a job file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lmctl.cli.console import print_data, print_json, print_message
from lmctl.cli.paths import InputFile
from lmctl.cli.planning import (
    check_target_writable,
    job_summary,
    open_part,
    plan_to_file,
    units_option,
    up_option,
)
from lmctl.cli.profiles import load_profile_or_default
from lmctl.errors import UsageError

if TYPE_CHECKING:
    from lmctl.plan.planner import PlanOptions


class LayerRange(click.ParamType):
    """Layer numbers from 1: "3-5", or one alone."""

    name = "FIRST-LAST"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        said = re.fullmatch(r"(\d{1,9})(?:-(\d{1,9}))?", str(value))
        first, last = (int(said[1]), int(said[2] or said[1])) if said else (0, 0)
        if not 1 <= first <= last:
            self.fail(f"{value!r} are no layers; say 3-5, or one number, from 1", param, ctx)
        return first, last


@click.command()
@click.argument("part", type=InputFile())
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Job file [PART.lmj].")
@click.option(
    "-m", "--machine", type=InputFile(),
    help="Machine profile to plan for [the bench cell].",
)
@units_option
@up_option
@click.option("-j", "--jobs", type=click.IntRange(1, 1024), metavar="N",
              help="Processes that plan layers at a time [one a core].")
@click.option("--scheduler", metavar="tcp://HOST:PORT",
              help="Plan layers on a Dask cluster instead of processes here.")
@click.option("--layers", type=LayerRange(),
              help="Plan only these layers, for looking; no machine takes such a job.")
@click.option("--allow-incomplete", is_flag=True,
              help="Plan also where pieces of the part are not deposited. The job says so.")
@click.option("--allow-overhang", is_flag=True,
              help="Plan also where walls lean out too far or start in the air. The job says so.")
@click.option("--json", "as_json", is_flag=True, help="Print the totals as one JSON object.")
def plan(
    part: Path, output: Path | None, machine: Path | None, units: str | None, up: str | None,
    jobs: int | None, scheduler: str | None, layers: tuple[int, int] | None, allow_incomplete: bool,
    allow_overhang: bool, as_json: bool,
) -> None:
    """Plan PART (a part file, or an STL, PLY, OBJ, OFF, 3MF, XYZ or CSV file) into a job file.

    A bare mesh or cloud is planned with defaults, and they are named. The job is the same wherever
    its layers are planned.
    """
    if scheduler is not None and jobs is not None:
        raise UsageError("--jobs is for processes here, --scheduler for a cluster", where="plan",
                         hint="leave one of them out")
    profile = load_profile_or_default(machine)
    if machine is None:
        print_message(f"no --machine given: planning for the {profile.name}")
    target = output or Path(part.name).with_suffix(".lmj")
    check_target_writable(target)
    manifest = plan_to_file(open_part(part, units, up), profile, target, _options(
        jobs, scheduler, layers, allow_incomplete, allow_overhang))
    if as_json:
        print_json({"job": str(target), **manifest.totals})
    else:
        print_data(job_summary(manifest, target))


def _options(
    jobs: int | None, scheduler: str | None, layers: tuple[int, int] | None,
    allow_incomplete: bool, allow_overhang: bool,
) -> PlanOptions:
    from lmctl.plan.execution import usable_cores
    from lmctl.plan.planner import PlanOptions

    cluster = None
    if scheduler is not None:
        from lmctl.plan.execution.dask_cluster import cluster_workers

        cluster = cluster_workers(scheduler)
    return PlanOptions(jobs=jobs or usable_cores(), cluster=cluster, layers=layers,
                       allow_incomplete=allow_incomplete, allow_overhang=allow_overhang)
