"""Twenty hosts killed at random moments; `make kills` kills a hundred."""

from __future__ import annotations

import random

import pytest

from tests.faults.kills import run_kills, write_small_job

KILLS = 20


@pytest.mark.timeout(600)
def test_after_any_kill_the_part_is_completed_and_nothing_is_claimed_or_lost(tmp_path):
    first = random.SystemRandom().randrange(10**6)
    outcomes = run_kills(write_small_job(tmp_path), range(first, first + KILLS), tmp_path / "kills")
    wrong = [outcome for outcome in outcomes if outcome.shortfalls]
    assert not wrong, "\n".join(f"{outcome.row()}\n  to repeat: {outcome.repeat}"
                                for outcome in wrong)
    assert any(outcome.recovered == "done" for outcome in outcomes)
