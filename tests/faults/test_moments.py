"""A few random moments; `tests/benchmarks/disturbances.py recovery` takes 300."""

from __future__ import annotations

import random

import pytest

from tests.faults.moments import run_scenario, scenario, shortfalls, undisturbed

SEEDS = 8


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """What lies on an undisturbed part, by cell."""
    return {
        (dialect, safe): undisturbed(dialect, has_laser_enable=safe,
                                     folder=tmp_path_factory.mktemp("whole"))
        for dialect in ("grbl", "grblhal") for safe in (False, True)
    }


def test_after_any_cut_kill_or_restart_every_millimetre_lies_once_and_in_its_place(
    whole, tmp_path
):
    first = random.SystemRandom().randrange(10**6)
    wrong = []
    for seed in range(first, first + SEEDS):
        one = scenario(seed)
        reported = run_scenario(one, tmp_path / str(seed))
        found = list(shortfalls(reported, whole[one.dialect, one.has_laser_enable]))
        wrong += [f"python -m tests.faults.moments {seed}: {one}: {what}" for what in found]
    assert wrong == []


def test_reports_that_come_again_prove_no_line_that_was_only_inferred(whole, tmp_path):
    """A cable is broken for two seconds. By the clock the part was executed up to line 106; the
    controller, which reports again, stands at line 103, the last that it had received."""
    one = scenario(355445)
    reported = run_scenario(one, tmp_path)
    assert list(shortfalls(reported, whole[one.dialect, one.has_laser_enable])) == []


def test_a_host_killed_as_the_machine_leaves_the_part_leaves_no_unmoved_machine(whole, tmp_path):
    """Touched off after a lost place, its program zero makes the machine's zero the place on the
    path; killed on the way to the purge position and switched off, it says that place again."""
    one = scenario(510520)
    reported = run_scenario(one, tmp_path)
    assert list(shortfalls(reported, whole[one.dialect, one.has_laser_enable])) == []
    assert reported.lost == 2
