"""Time for powder between beads, with a way between them and without."""

import numpy as np
import pytest

from lmctl.errors import PlanError
from lmctl.job.schema import LineKind
from lmctl.plan.sequence.beads import Beads
from lmctl.plan.sequence.line_timing import (
    gap_line_ranges,
    split_long_lines,
    with_time_for_powder,
)
from lmctl.plan.sequence.moves import rounded_to_program_steps
from lmctl.plan.sequence.travel import TravelSettings, layer_moves
from lmctl.plan.sequence.velocity_profile import line_durations

START = np.array([0.0, 0.0, 5.0])


def corner(lead_in_mm):
    """Two beads of different powders, the second beginning where the first ends."""
    beads = Beads(
        points_mm=np.array([[0, 0], [10, 0], [10, 0], [10, 8.0]]),
        fractions=np.array([[1, 0], [1, 0], [0, 1], [0, 1.0]]),
        along_mm=np.array([0, 10, 11, 19.0]), starts=np.array([0, 2, 4]),
        speed_mm_s=np.full(4, 10.0), power_W=np.full(4, 1500.0), width_mm=np.full(4, 2.0),
        speed_factor=np.ones(2),
        rounded_mixture_mm=0.0, rounded_by=0.0)
    settings = TravelSettings(50, 5, lead_in_mm, 2.0, 0.0, 0.02)
    return rounded_to_program_steps(
        layer_moves(beads, 1.0, np.zeros(3), START, settings, np.array([1.0, 0])), START)


def test_lines_shorter_than_the_steps_of_the_program_are_refused(profile):
    with pytest.raises(PlanError, match=r"cannot be split into lines of 0\.001 s") as refused:
        split_long_lines(corner(1.0), START, profile.motion, 1e-3)
    assert "the longest lasts" in refused.value.where[0]
    assert "send_horizon_s" in refused.value.hint


def gap_lines(moves, path):
    return np.arange(*gap_line_ranges(moves)[path])


@pytest.mark.parametrize("lead_in_mm", [0.0, 2.0])
def test_powder_is_waited_for_between_adjoining_beads(profile, lead_in_mm):
    moves = corner(lead_in_mm)
    assert (len(gap_lines(moves, 1)) == 0) == (lead_in_mm == 0)
    slowed = with_time_for_powder(moves, START, profile.motion, np.array([0.0, 3.0]))
    gap = gap_lines(slowed, 1)
    assert line_durations(slowed, START, profile.motion)[gap].sum() == pytest.approx(3.0, abs=0.05)
    lines = slowed.kind == LineKind.BEAD
    assert slowed.target_mm[lines] == pytest.approx(moves.target_mm[moves.kind == LineKind.BEAD])
