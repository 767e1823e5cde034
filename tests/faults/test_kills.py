"""Twenty hosts killed at random moments; `make kills` kills a hundred."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from lmctl.config.machine import load_profile
from lmctl.run.journal.manual_journal import MachineJournal
from tests.faults import kills
from tests.faults.kills import run_kills, write_small_job

KILLS = 20


@pytest.mark.timeout(600)
def test_after_any_kill_the_part_is_completed_and_nothing_is_claimed_or_lost(tmp_path):
    first = random.SystemRandom().randrange(10**6)
    outcomes = run_kills(write_small_job(tmp_path), range(first, first + KILLS), tmp_path / "kills")
    wrong = [outcome for outcome in outcomes if outcome.shortfalls]
    assert not wrong, "\n".join(f"{outcome.row()}\n  to repeat: {outcome.repeat}"
                                for outcome in wrong)
    assert any(outcome.recovered.startswith("done") for outcome in outcomes)


def test_a_host_killed_just_before_its_first_motion_leaves_a_question(tmp_path, monkeypatch):
    """That the run moves the machine is on the disk, and nothing has moved: a random kill meets
    this moment, of some 20 ms, once in a few hundred."""
    run_and_kill = kills._run_and_kill

    def just_before(job: Path, cell: Path, folder: Path, at_s: float) -> str:
        state = run_and_kill(job, cell, folder, at_s)
        profile = load_profile(cell)
        MachineJournal(folder / "runs", profile).append(
            "act", do="run", run="run-0001", from_mm=[0.0, 0.0, 0.0],
            way_mm=[[0.0, 0.0, 0.0], [0.0, 0.0, 20.0], list(profile.motion.purge_mm)])
        return state

    monkeypatch.setattr(kills, "_run_and_kill", just_before)
    moment = next(seed for seed in range(10**6) if random.Random(seed).uniform(0.0, 10.0) < 0.02)
    (outcome,) = run_kills(write_small_job(tmp_path), range(moment, moment + 1), tmp_path / "kills")
    assert (outcome.recovered, outcome.shortfalls) == ("done after a question", [])
