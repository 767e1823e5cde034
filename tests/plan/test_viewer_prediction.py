"""What the page of a job shows as predicted is what the plan states of the same job."""

from __future__ import annotations

import numpy as np
import pytest

from lmctl.config.part_file import ProcessSettings
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind
from lmctl.plan.planner import plan_job
from lmctl.report.job_viewer.predicted_mixture import MixturePredictor
from lmctl.report.reported_values import PartScales


@pytest.mark.parametrize(("powder", "lag_s"), [("lead", 2.5), ("lead", 5.0), ("dwell", 0.3)])
def test_the_share_that_is_right_is_that_of_the_plan(
    tmp_path, make_part, shapes, profile, materials, powder, lag_s
):
    """On a cell with slow hoses and calibrated discs, steps, ticks and all."""
    cell = profile.model_copy(update={"hopper": tuple(
        one.model_copy(update={"lag_s": lag_s, "slope": 0.9, "offset_g_min": 0.3})
        for one in profile.hopper)})
    part = make_part(shapes["square"], lambda p: 0.5 + 0.3 * np.sin(p[:, 0] / 2.0),
                     process=ProcessSettings(strategy="offset", powder=powder))
    manifest = plan_job(part, cell, tmp_path / "a.lmj")
    scales = PartScales(1.0, manifest.materials, {
        one.name: one.catch_efficiency / one.density_g_mm3 for one in materials})
    right_mm = path_mm = 0.0
    with JobReader(tmp_path / "a.lmj") as job:
        predictor = MixturePredictor(job.manifest, scales)
        for layer, predicted in predictor.predict(job.iterate_layers()):
            lines, bead = layer.lines, layer.lines["kind"] == LineKind.BEAD
            way = np.hypot(*(np.diff(lines[axis], prepend=lines[axis][0])
                             for axis in ("x_mm", "y_mm")))[bead]
            off = np.abs(predicted - lines["designed"]).max(axis=1)[bead]
            right_mm += way[off <= 0.02].sum()
            path_mm += way.sum()
    stated = manifest.totals["mixture_share"]
    assert 0.02 < stated < 0.98
    assert right_mm / path_mm == pytest.approx(stated, abs=0.03)
