"""A plan under an alloy rule keeps it in a run too, also after holds next to its jumps."""

import numpy as np
import pytest

from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind
from lmctl.part.load import part_from_text
from lmctl.plan.planner import plan_job

PART = """
name = "ruled"
[[material]]
name = "316L"
[[material]]
name = "WC-12Co"
[[body]]
kind = "box"
low_mm = [0, 0, 0]
high_mm = [30, 6, 1.6]
[composition]
feature = { kind = "coordinate", along = "x" }
[composition.profile]
kind = "linear"
near = { "316L" = 0.9, "WC-12Co" = 0.1 }
far = { "316L" = 0.2, "WC-12Co" = 0.8 }
over_mm = [0, 30]
[[alloy_rule]]
name = "eta phase"
powders = ["316L", "WC-12Co"]
forbidden = [{ "WC-12Co" = [0.3, 0.5] }]
reason = "brittle"
"""


@pytest.fixture
def ruled_job(tmp_path, profile):
    plan_job(part_from_text(PART, tmp_path, "ruled"), profile, tmp_path / "job.lmj")
    return tmp_path / "job.lmj"


def jump_s(job):
    """Program times, from the first bead, at which a path of the other side begins."""
    with JobReader(job) as reader:
        lines = np.concatenate([layer.lines for layer in reader.iterate_layers()])
    beads = lines["kind"] == LineKind.BEAD
    carbide, path, begin = (lines["fractions"][beads, 1], lines["path"][beads],
                            np.concatenate([[0], lines["end_s"][:-1]])[beads])
    other = (path[1:] != path[:-1]) & ((carbide[1:] > 0.4) != (carbide[:-1] > 0.4))
    return begin[1:][other] - begin[0]


def is_forbidden(path):
    carbide = path.fractions[:, path.materials.index("WC-12Co")]
    return (carbide >= 0.3) & (carbide <= 0.5)


def test_no_forbidden_mixture_is_laid_also_after_holds_beside_the_jump(run, ruled_job):
    jump = float(jump_s(ruled_job)[0])
    for later_s in (-0.4, 0.3, 1.2):
        one = run(ruled_job, acts=[
            (jump + later_s, lambda r: r.executor.state == "depositing" and r.executor.hold()),
            (jump + later_s + 20.0, lambda r: r.executor.state == "held" and r.executor.resume()),
        ])
        assert one.error is None
        assert one.states.count("held") == 1
        assert len(one.path.line) > 1000
        assert not is_forbidden(one.path).any()
        fractions = one.path.fractions[:, one.path.materials.index("WC-12Co")]
        assert fractions.min() < 0.2
        assert fractions.max() > 0.7


def test_the_journal_and_so_the_log_name_the_rule(run, ruled_job):
    header = run(ruled_job).records("header")[0]
    assert [(rule["name"], rule["reason"]) for rule in header["alloy_rules"]] == [
        ("eta phase", "brittle")]
