"""Powers in the program's text."""

import re
from dataclasses import replace

import pytest

from lmctl.errors import PlanError
from lmctl.job.reader import JobReader
from lmctl.plan.planner import plan_job
from lmctl.preflight.program_check import check_program


@pytest.mark.parametrize(("s_max", "power_W"), [(1, 1400.0), (1, 140.0), (255, 77.0), (65_535, 9)])
def test_the_controller_is_sent_the_power_whatever_its_full_scale(
        tmp_path, make_part, shapes, profile, materials, s_max, power_W):
    laser = profile.laser.model_copy(update={"s_max": s_max})
    cell = profile.model_copy(update={"laser": laser})
    part = make_part(shapes["small disc"], lambda p: 0.0, materials=tuple(
        replace(material, power_W=power_W) for material in materials))
    plan_job(part, cell, tmp_path / "a.lmj")
    with JobReader(tmp_path / "a.lmj") as job:
        check_program(job, cell)
        text = "\n".join(line for layer in job.iterate_layers() for line in layer.program)
    said = set(re.findall(r" S([\d.]+)$", text, re.MULTILINE)) - {"0"}
    assert len(said) == 1
    assert float(said.pop()) / s_max * laser.max_power_W == pytest.approx(power_W, rel=0.01)


def test_a_power_below_a_step_of_s_words_is_refused(
        tmp_path, make_part, shapes, profile, materials):
    part = make_part(shapes["small disc"], lambda p: 0.0, materials=tuple(
        replace(material, power_W=0.1) for material in materials))
    with pytest.raises(PlanError, match=r"0\.1 W is too weak.* steps of 0\.3 W"):
        plan_job(part, profile, tmp_path / "a.lmj")
