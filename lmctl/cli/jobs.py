"""`lmctl jobs`: the runs of a folder, and the job files beside it."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from lmctl.cli.console import format_duration, print_data, print_json


@click.command()
@click.option("--runs", "runs_dir", type=click.Path(path_type=Path), default=Path("runs"),
              show_default=True, help="Folder of runs.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def jobs(runs_dir: Path, as_json: bool) -> None:
    """List job files in this folder and runs in the runs folder."""
    from lmctl.errors import JobError, MissingFileError
    from lmctl.job.reader import JobReader
    from lmctl.run.journal.run_folders import list_runs

    files: list[dict[str, object]] = []
    for path in sorted(Path().glob("*.lmj")):
        try:
            with JobReader(path) as job:
                totals = job.manifest.totals
                files.append({
                    "job": str(path), "part": job.manifest.part_name,
                    "machine": job.manifest.machine, "layers": len(job.manifest.layers),
                    "duration_s": totals.get("duration_s"), "error": "",
                })
        except (JobError, MissingFileError) as error:
            files.append({"job": str(path), "error": error.what})
    runs = list_runs(runs_dir)
    if as_json:
        print_json({"jobs": files, "runs": [asdict(run) for run in runs]})
        return
    for file in files:
        if file["error"]:
            print_data(f"{file['job']}: {file['error']}")
        else:
            print_data(
                f"{file['job']}: {file['part']}, {file['layers']} layers for {file['machine']}")
    if files and runs:
        print_data()
    for run in runs:
        lasted = format_duration(run.machine_s) if run.machine_s is not None else ""
        print_data(f"{run.run}  {run.state:<11} {run.started:<24} {lasted:>9}  {run.part}"
                   + (f"  ({run.operator})" if run.operator else ""))
    if not files and not runs:
        print_data(f"no job files here and no runs in {runs_dir}")
        print_data("hint: `lmctl plan PART` makes a job, `lmctl run JOB --sim` runs it")
