"""Beads as they are laid: jumps of the field, what powder makes of them, the axes' speed."""

from dataclasses import replace

import numpy as np
import pytest

from lmctl.config.part_file import ProcessSettings
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind
from lmctl.plan.geometry.strategies import choice
from lmctl.plan.planner import plan_job
from lmctl.plan.sequence import mixture_cuts


def layers_of(path):
    with JobReader(path) as job:
        return list(job.iterate_layers())


def stepped(make_part, shapes):
    """Of 30 % carbide left of x = 0.1, 70 % right of it, along every track."""
    return make_part(shapes["rectangle"], lambda p: np.where(p[:, 0] > 0.1, 0.7, 0.3))


def test_a_jump_of_the_field_is_one_of_the_plan(tmp_path, make_part, shapes, profile):
    plan_job(stepped(make_part, shapes), profile, tmp_path / "a.lmj")
    for layer in layers_of(tmp_path / "a.lmj"):
        row = layer.lines[layer.lines["kind"] == LineKind.BEAD]
        local = row["x_mm"] - 150.0
        away = np.abs(local - 0.1) > 0.2  # the points of a track are a tenth of a bead apart
        assert away.mean() > 0.7
        assert row["fractions"][away, 1] == pytest.approx(np.where(local > 0.1, 0.7, 0.3)[away])


def test_the_verdict_compares_what_is_deposited_with_the_part(
        tmp_path, make_part, shapes, profile, recipe, monkeypatch):
    """Hoses take seconds to change powders: the share of the path that is off, and why.

    As it is on tracks that cross a jump and are not cut there.
    """
    monkeypatch.setattr(choice, "tracks_cross_jump", lambda tracks: False)
    monkeypatch.setattr(mixture_cuts, "LEAST_PIECE_BEADS", 1e9)
    manifest = plan_job(stepped(make_part, shapes), profile, tmp_path / "a.lmj")
    right = []
    for layer in layers_of(tmp_path / "a.lmj"):
        lines = layer.lines
        begin_s = np.concatenate([layer.flow_s[:1], lines["end_s"][:-1]])
        bead = np.flatnonzero(lines["kind"] == LineKind.BEAD)
        for i in bead:
            middle_s = (begin_s[i] + lines["end_s"][i]) / 2
            flow = np.array([np.interp(middle_s, layer.flow_s, layer.flow_g_s[:, m])
                             for m in (0, 1)])
            x = (lines["x_mm"][i - 1] + lines["x_mm"][i]) / 2 - 150.0
            off = abs(recipe.deposited_fractions(flow)[1] - (0.7 if x > 0.1 else 0.3))
            right.append([off <= 0.02, lines["end_s"][i] - begin_s[i]])
    share = float(np.prod(right, axis=1).sum() / np.sum(right, axis=0)[1])
    assert 0.2 < share < 0.8
    assert manifest.totals["mixture_share"] == pytest.approx(share, abs=0.02)
    found = next(f for f in manifest.verdict if "of the path within" in f["text"])
    assert found["level"] == "warning"
    assert "changes faster than powder can follow" in found["text"]
    assert not any("slowed to" in f["text"] for f in manifest.verdict)


def test_a_plan_in_coarse_steps_is_said_to_differ_from_the_part(
        tmp_path, make_part, shapes, profile):
    part = make_part(shapes["rectangle"], lambda p: 0.5 + 0.005 * p[:, 0],
                     process=ProcessSettings(fraction_step=0.25))
    found = plan_job(part, profile, tmp_path / "a.lmj").verdict
    assert any("the plan differs from the part file" in f["text"] for f in found)


def test_at_the_axes_limit_no_more_is_deposited_than_below_it(
        tmp_path, make_part, profile, materials):
    """A wall of 1.25 beads is levelled by going faster; where axes cannot, all goes slower."""
    hoppers = tuple(hopper.model_copy(update={"max_flow_g_min": 600.0})
                    for hopper in profile.hopper)
    cell = profile.model_copy(update={"hopper": hoppers})
    wall = np.array([[0, 0], [2.5, 0], [2.5, 40], [0, 40], [0, 0.0]])
    laid = {}
    for speed in (50.0, 100.0):
        part = make_part([wall], lambda p: 0.0, materials=tuple(
            replace(material, speed_mm_s=speed) for material in materials))
        totals = plan_job(part, cell, tmp_path / "a.lmj").totals
        rows = np.concatenate([layer.lines for layer in layers_of(tmp_path / "a.lmj")])
        assert rows["speed_mm_s"].max() <= 100.0
        laid[speed] = totals["deposited_volume_mm3"]
    assert laid[100.0] == pytest.approx(laid[50.0], rel=1e-3)
