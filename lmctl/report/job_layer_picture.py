"""One layer of a job as a picture, with its title."""

from __future__ import annotations

from pathlib import Path

from lmctl.errors import UsageError
from lmctl.job.reader import JobReader
from lmctl.job.schema import JobLayer
from lmctl.report.layer_picture import LayerView, draw_layer

#: Endings of files that a layer can be drawn as.
PICTURES = (".png", ".svg", ".pdf")

#: A layer whose heights differ by less is level.
_LEVEL_MM = 0.005


def draw_job_layer(
    reader: JobReader, index: int, target: Path, frame: str = "machine"
) -> None:
    """Draw layer `index` (from 0) of an open job. Raises UsageError for a format we cannot draw.

    frame : "machine" or "part", whose coordinates the picture shows
    """
    if target.suffix.lower() not in PICTURES:
        raise UsageError(f"cannot draw a picture as {target.suffix or 'a file with no ending'}",
                         where=str(target), hint=f"choose one of {', '.join(PICTURES)}")
    if not target.parent.is_dir():
        raise UsageError(f"there is no folder {target.parent}", hint="make it first")
    manifest = reader.manifest
    layer = reader.read_layer(index)
    before = reader.read_layer(index - 1).lines[-1] if index else layer.lines[0]
    entry = manifest.layers[index]
    lasting_s = entry.end_s - entry.start_s
    number, last = index + 1, f" of {len(manifest.layers)}"
    if manifest.excerpt is not None:
        number, last = index + manifest.excerpt[0], ", planned for looking"
    x, y, z = manifest.part_offset_mm if frame == "part" else (0.0, 0.0, 0.0)
    height = _height_text(layer, entry.z_mm, z)
    draw_layer(layer, manifest.materials, LayerView(
        start_mm=(float(before["x_mm"]), float(before["y_mm"])), origin_mm=(x, y), frame=frame,
        title=f"{manifest.part_name}: layer {number}{last}, {frame} z = {height} mm, "
              f"{entry.n_paths} path{'s' * (entry.n_paths != 1)}, {lasting_s:.0f} s"), target)


def _height_text(layer: JobLayer, nozzle_mm: float, origin_mm: float) -> str:
    """The height of a layer, or where it follows a substrate, from where to where it goes."""
    heights = layer.lines["z_mm"][layer.lines["bead_width_mm"] > 0]
    if len(heights) == 0 or float(heights.max() - heights.min()) < _LEVEL_MM:
        return f"{nozzle_mm - origin_mm:.2f}"
    return f"{heights.min() - origin_mm:.2f} to {heights.max() - origin_mm:.2f}"
