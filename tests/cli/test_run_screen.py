"""What the terminal of a run shows, and what Ctrl-C answers."""

from __future__ import annotations

import pytest

from lmctl.cli.run_screen import screen_lines
from lmctl.config.machine import load_profile
from lmctl.report.reported_values import PartScales
from lmctl.run.state.transitions import FINAL_STATES, Effect, RunState
from lmctl.run.status.phase import PhaseClock
from lmctl.run.status.stop_messages import stop_message
from tests.run.whole.conftest import EXAMPLES

SCALES = PartScales(1.0, ("316L", "WC-12Co"), {"316L": 50.0, "WC-12Co": 25.0})
NOW = {
    "run": "run-0001", "state": "held", "doing": "waiting for the operator", "doing_left_s": 1791.0,
    "held_by": "the safety door was opened, and is closed again", "done_s": 120.0,
    "total_s": 480.0, "layer": 3, "layers": 12, "remaining_s": 371.0,
    "materials": ["316L", "WC-12Co"], "set_g_min": [7.0, 6.0],
    "designed": {"316L": 0.702, "WC-12Co": 0.298},
    "levels": [{"hopper": "A", "level_percent": 85.2, "weight_g": 17040.0},
               {"hopper": "B", "level_percent": None, "weight_g": 900.0}],
    "warnings": [], "next": [{"command": "lmctl resume run-0001", "does": "goes on"}],
}


@pytest.fixture
def phase():
    profile = load_profile(EXAMPLES / "cell.toml")
    return PhaseClock(profile, profile.hopper, "lead", held_at_most_s=1800.0)


def test_a_held_run_says_by_what_how_full_hoppers_are_and_what_to_type():
    lines = screen_lines(NOW)
    assert lines[0].startswith("run-0001  HELD")
    assert " 25 %  layer 3 of 12, 6:11 left" in lines[0]
    assert "now     waiting for the operator, 29:51 left" in lines[1]
    assert "held by the safety door was opened" in lines[2]
    assert "powder  A 85 % 17.04 kg, B 0.90 kg" in lines[3]
    assert "next    lmctl resume run-0001: goes on" in lines[4]


def test_the_mixture_is_shown_as_designed_and_as_set_points_stand_for():
    def row(**changed):
        return [line for line in screen_lines(NOW | changed, 80, SCALES) if "mixture" in line]

    assert row() == ["  mixture 316L 0.702/0.700, WC-12Co 0.298/0.300 (designed/commanded)"]
    assert row(designed=None) == ["  mixture 316L –/0.700, WC-12Co –/0.300 (designed/commanded)"]
    assert row(set_g_min=[0.0, 0.0]) == row(set_g_min=None) == []
    assert "mixture" not in "".join(screen_lines(NOW, 80))
    of_one = PartScales(1.0, ("316L",), {"316L": 50.0})
    assert "mixture" not in "".join(screen_lines(NOW | {"materials": ["316L"]}, 80, of_one))


@pytest.mark.parametrize("width", [40, 80])
def test_no_line_is_longer_than_the_terminal_is_wide(width):
    long = NOW | {"held_by": "a word and " * 30, "run": "run-000000001", "layers": 99_999}
    assert all(len(line) <= width for line in screen_lines(long, width, SCALES))


def test_each_effect_says_what_is_done_and_counts_down_where_it_is_known_how_long(phase):
    for do in Effect:
        phase.begin_effect(do, 100.0)
        words, left_s = phase.current_phase(RunState.GAS, 101.0)
        assert words
        assert left_s is None or left_s >= 0.0
    phase.begin_effect(Effect.AWAIT_STABLE, 100.0)
    # stabilise_s
    assert phase.current_phase(RunState.POWDER, 102.5).remaining_s == pytest.approx(8.0 - 2.5)
    assert phase.current_phase(RunState.POWDER, 200.0).remaining_s == 0.0
    assert phase.current_phase(RunState.DEPOSITING, 200.0) == ("depositing", None)


def test_ctrl_c_says_what_happens_and_what_another_one_does(phase):
    said = {state: stop_message(state, phase,
                                is_taken=state not in FINAL_STATES) for state in RunState}
    assert "nothing has been switched on" in said[RunState.CHECKING]
    for state in (RunState.DEPOSITING, RunState.HELD, RunState.PURGING):
        assert said[state].startswith("stopping: beam and motion off now")
        assert "Ctrl-C again skips the post-flow" in said[state]
    assert "post-flow is skipped" in said[RunState.STOPPING]
    assert "Another Ctrl-C changes nothing" in said[RunState.STOPPING]
    assert said[RunState.DONE] == "the run is done: another stop changes nothing"
