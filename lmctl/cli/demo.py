"""`lmctl demo`: from a scanned gear to a printed job log, on the simulated machine."""

from __future__ import annotations

from pathlib import Path

import click

from lmctl.cli.console import print_data, print_message


@click.command()
@click.option("--folder", type=click.Path(path_type=Path), default=Path("lmctl-demo"),
              show_default=True, help="Where everything the demo makes goes.")
def demo(folder: Path) -> None:
    """Plan a graded gear from its noisy scan, run it on the simulated machine, print its log."""
    from lmctl.cli.init import make_folder
    from lmctl.cli.log import job_log_as_text
    from lmctl.cli.planning import job_summary, open_part, plan_to_file
    from lmctl.cli.run import outcome_text, run_on_screen
    from lmctl.config.machine import load_profile
    from lmctl.examples.templates import write_gear_template
    from lmctl.job.reader import JobReader
    from lmctl.report.job_layer_picture import draw_job_layer

    make_folder(folder)
    print_message("1 of 4: a scan of a spur gear (points without order or normals, 0.02 mm noise)")
    part_file = write_gear_template(folder)
    profile = load_profile(folder / "cell.toml")
    job = folder / "gear.lmj"
    print_message("2 of 4: planning (the first time, kernels are compiled)")
    manifest = plan_to_file(open_part(part_file), profile, job)
    print_message(job_summary(manifest, job))
    print_message("3 of 4: running it on the simulated machine, in virtual time")
    result = run_on_screen(job, profile, folder / "runs", operator="demo", sim=True,
                           bench=folder / "bench.toml", speed=None)
    print_message(outcome_text(result))
    print_message("4 of 4: the job log")
    picture = folder / "gear-layer.png"
    with JobReader(job) as reader:
        draw_job_layer(reader, len(manifest.layers) // 2, picture)
    print_data(job_log_as_text(result.journal))
    print_data(f"picture   {picture}")
    print_data(f"journal   {result.journal}")
