"""`lmctl demo`: from a scanned gear to a printed job log, on the simulated machine."""

from __future__ import annotations

from pathlib import Path

import click

from lmctl.cli.console import put, say


@click.command()
@click.option("--folder", type=click.Path(path_type=Path), default=Path("lmctl-demo"),
              show_default=True, help="Where everything the demo makes goes.")
def demo(folder: Path) -> None:
    """Plan a graded gear from its noisy scan, run it on the simulated machine, print its log."""
    from lmctl.cli.init import make_folder
    from lmctl.cli.log import job_log_as_text
    from lmctl.cli.planning import open_part, plan_to_file, summary
    from lmctl.cli.run import outcome, run_with_bar
    from lmctl.cli.show import draw_job_layer
    from lmctl.config.machine import load_profile
    from lmctl.examples.templates import write_gear_example
    from lmctl.job.reader import JobReader

    make_folder(folder)
    say("1 of 4: a scan of a spur gear (points without order or normals, 0.02 mm noise)")
    part_file = write_gear_example(folder)
    profile = load_profile(folder / "cell.toml")
    job = folder / "gear.lmj"
    say("2 of 4: planning (the first time, kernels are compiled)")
    manifest = plan_to_file(open_part(part_file), profile, job)
    say(summary(manifest, job))
    say("3 of 4: running it on the simulated machine, in virtual time")
    result = run_with_bar(job, profile, folder / "runs", operator="demo", sim=True,
                          bench=folder / "bench.toml", speed=None)
    say(outcome(result))
    say("4 of 4: the job log")
    picture = folder / "gear-layer.png"
    with JobReader(job) as reader:
        draw_job_layer(reader, len(manifest.layers) // 2, picture)
    put(job_log_as_text(result.journal))
    put(f"picture   {picture}")
    put(f"journal   {result.journal}")
