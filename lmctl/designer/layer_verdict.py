"""The plan's verdict on one layer of a part as it is being edited."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

from lmctl.config.machine import MachineProfile
from lmctl.errors import UsageError
from lmctl.job.reader import JobReader
from lmctl.part.load import part_from_text
from lmctl.plan.layer_range import place_layers
from lmctl.plan.planner import PlanOptions, plan_job
from lmctl.report.job_layer_picture import draw_job_layer


@dataclass(frozen=True)
class LayerVerdict:
    """A layer as it would be planned alone.

    layer, layers : its number from 1, and how many the part has
    findings, warnings : what the plan says: {"level": "ok" or "warning", "text": ...}, and texts
    built_fraction : volume deposited inside the surface, over that of the layer
    picture : its tracks, PNG
    """

    layer: int
    layers: int
    findings: tuple[dict[str, str], ...]
    warnings: tuple[str, ...]
    built_fraction: float
    surplus_fraction: float
    duration_s: float
    picture: bytes


def layer_verdict(
    text: str, folder: Path, name: str, profile: MachineProfile, layer: int | None
) -> LayerVerdict:
    """Plan one layer of the part that a text describes.

    layer : its number from 1; None is the middle one
    Raises ConfigError, InputError, PlanError as planning does; UsageError where there is no such
    layer.
    """
    part = part_from_text(text, folder, name)
    layers = place_layers(part, profile).n_layers
    number = layers // 2 + 1 if layer is None else layer
    if not 1 <= number <= layers:
        raise UsageError(f"there is no layer {number}", hint=f"layers go from 1 to {layers}")
    with tempfile.TemporaryDirectory() as kept:
        job, picture = Path(kept) / "layer.lmj", Path(kept) / "layer.png"
        manifest = plan_job(part, profile, job, options=PlanOptions(
            layers=(number, number), allow_incomplete=True, allow_overhang=True))
        with JobReader(job) as reader:
            draw_job_layer(reader, 0, picture, "part")
        totals = manifest.totals
        texts = {found["text"] for found in manifest.verdict}
        return LayerVerdict(
            number, layers, tuple(manifest.verdict),
            tuple(text for text in totals["warnings"] if text not in texts),
            totals["built_fraction"], totals["surplus_fraction"], totals["duration_s"],
            picture.read_bytes())
