"""Time for powder between beads, with a way between them and without."""

import numpy as np
import pytest

from lmctl.job.schema import LineKind
from lmctl.plan.assemble import Way, layer_moves
from lmctl.plan.beads import Bead
from lmctl.plan.moves import on_raster
from lmctl.plan.time_law import line_durations
from lmctl.plan.timing import gap_lines, with_time_for_powder

START = np.array([0.0, 0.0, 5.0])


def bead(first, last, mixture):
    return Bead(np.array([first, last], dtype=float), np.array([mixture, mixture], dtype=float),
                np.array([10.0]), np.array([1500.0]), 1.0, 0.0, 0.0)


def corner(lead_in_mm):
    """Two beads of different powders, the second beginning where the first ends."""
    beads = [bead((0, 0), (10, 0), (1, 0)), bead((10, 0), (10, 8), (0, 1))]
    way = Way(50, 5, lead_in_mm, 2.0, 0.0, 0.02)
    return on_raster(
        layer_moves(beads, 1.0, np.zeros(3), START, way, np.array([1.0, 0])), START)


@pytest.mark.parametrize("lead_in_mm", [0.0, 2.0])
def test_powder_is_waited_for_between_adjoining_beads(profile, lead_in_mm):
    moves = corner(lead_in_mm)
    assert (len(gap_lines(moves, 1)) == 0) == (lead_in_mm == 0)
    slowed = with_time_for_powder(moves, START, profile.motion, lambda path: 3.0 * path)
    gap = gap_lines(slowed, 1)
    assert line_durations(slowed, START, profile.motion)[gap].sum() == pytest.approx(3.0, abs=0.05)
    lines = slowed.kind == LineKind.BEAD
    assert slowed.target_mm[lines] == pytest.approx(moves.target_mm[moves.kind == LineKind.BEAD])
