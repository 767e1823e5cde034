"""`lmctl show`: a layer of a job as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from lmctl.cli.console import put
from lmctl.errors import UsageError

if TYPE_CHECKING:
    from lmctl.job.reader import JobReader

PICTURES = (".png", ".svg", ".pdf")


@click.command()
@click.argument("job", type=click.Path(path_type=Path))
@click.option("-l", "--layer", type=int, help="Layer number, from 1 [the middle one].")
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="Picture file: .png, .svg or .pdf [JOB-layer-N.png].")
def show(job: Path, layer: int | None, output: Path | None) -> None:
    """Draw a layer of JOB, its paths coloured by composition."""
    from lmctl.job.reader import JobReader

    with JobReader(job) as reader:
        count = len(reader.manifest.layers)
        number = layer if layer is not None else count // 2 + 1
        if not 1 <= number <= count:
            raise UsageError(f"{job} has no layer {number}", hint=f"layers go from 1 to {count}")
        target = output or Path(f"{job.stem}-layer-{number}.png")
        draw_job_layer(reader, number - 1, target)
    put(str(target))


def draw_job_layer(reader: JobReader, index: int, target: Path) -> None:
    """Draw layer `index` (from 0) of an open job. Raises UsageError for a format we cannot draw."""
    from lmctl.config.part_file import PartFile
    from lmctl.config.toml_file import parse
    from lmctl.report.layer_picture import draw_layer

    if target.suffix.lower() not in PICTURES:
        raise UsageError(f"cannot draw a picture as {target.suffix or 'a file with no ending'}",
                         where=str(target), hint=f"choose one of {', '.join(PICTURES)}")
    if not target.parent.is_dir():
        raise UsageError(f"there is no folder {target.parent}", hint="make it first")
    manifest = reader.manifest
    layer = reader.layer(index)
    process = parse(reader.part_text, PartFile, name="the job's part file").process
    before = reader.layer(index - 1).lines[-1] if index else layer.lines[0]
    entry = manifest.layers[index]
    lasting_s = entry.end_s - entry.start_s
    draw_layer(
        layer, manifest.materials,
        start_mm=(float(before["x_mm"]), float(before["y_mm"])),
        track_pitch_mm=process.bead_width_mm * (1 - process.overlap),
        title=f"{manifest.part_name}: layer {index + 1} of {len(manifest.layers)}, "
              f"z = {entry.z_mm:.2f} mm, {entry.n_paths} paths, {lasting_s:.0f} s",
        target=target,
    )
