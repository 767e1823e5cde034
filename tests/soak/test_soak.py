"""A few random parts and cells; `make soak` does many."""

from __future__ import annotations

import pytest

from tests.soak.cells import run_a_cell
from tests.soak.parts import PARTS, random_part_down_the_road


@pytest.mark.parametrize("kind", PARTS)
@pytest.mark.parametrize("seed", [5, 7])
def test_a_random_part_is_planned_and_deposited_as_designed(kind, seed, tmp_path):
    assert random_part_down_the_road(kind, seed, tmp_path).shortfalls == []


@pytest.mark.parametrize("seed", range(12))
def test_whatever_happens_to_a_cell_it_ends_safely(seed, tmp_path):
    outcome = run_a_cell(seed, tmp_path)
    assert outcome.shortfalls == [], outcome.happened
