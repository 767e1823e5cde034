"""What of a part was deposited, and how often, by the record of the simulated cell."""

from __future__ import annotations

#: Beam off within so much of a feed hold [s]: the controller's step buffer, then slowing down.
BEAM_OFF_S = 0.13
#: Bead deposited twice where a path is entered again at 10 mm/s, and how exact places are [mm].
OVERLAP_MM, EXACT_MM = 0.15, 0.1


def acts(one):
    return [record["do"] for record in one.records("act")]


def laid_again_mm(one, whole):
    return one.path.length_mm.sum() - whole.path.length_mm.sum()


def check_all_is_laid(one, whole):
    """Every bead that an undisturbed run lays, by line and by length."""
    assert set(one.path.line) == set(whole.path.line)
    for line in set(whole.path.line):
        mine, wanted = (p.length_mm[p.line == line].sum() for p in (one.path, whole.path))
        assert mine > wanted - EXACT_MM
