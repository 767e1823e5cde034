"""What counts as executed, report by report."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.status import StatusReport, parse_status
from lmctl.machine.motion.progress import StreamProgress, makes_planner_block


def stream(
    lines: list[bytes], answered: int, blocks: int = 15, lead_s: float = 0.0
) -> StreamProgress:
    progress = StreamProgress(blocks, lead_s)
    progress.count_sent(lines)
    progress.count_ok(answered)
    return progress


def run(fields: str, state: str = "Run") -> StatusReport:
    report = parse_status(f"<{state}|MPos:0.000,0.000,0.000|{fields}>")
    assert report is not None
    return report


NUMBERED = [b"N%d G1 X1" % n for n in range(100, 120)]


def test_the_line_in_motion_is_the_first_not_executed():
    progress = stream(NUMBERED, 12)
    assert not progress.on_status_report(run("Ln:100"), 0.0)
    assert progress.on_status_report(run("Ln:103"), 0.0)
    assert progress.executed == 3
    assert not progress.on_status_report(run("Ln:103"), 0.0)
    assert not progress.on_status_report(run("Ln:101"), 0.0)  # never back
    assert progress.executed == 3


def test_a_number_that_is_not_in_the_stream_says_nothing():
    progress = stream(NUMBERED, 12)
    for number in (1, 10, 11, 999, 1030):
        assert not progress.on_status_report(run(f"Ln:{number}"), 0.0)
    assert progress.executed == 0


def test_numbers_begin_again_after_ten_million():
    lines = [b"N%d G1 X1" % (n % 10_000_000) for n in range(9_999_995, 10_000_010)]
    progress = stream(lines, 15)
    progress.on_status_report(run("Ln:9999999"), 0.0)
    assert progress.executed == 4
    progress.on_status_report(run("Ln:2"), 0.0)
    assert progress.executed == 7


def test_the_number_of_an_idle_controller_is_that_of_an_old_program():
    progress = stream(NUMBERED, 12)
    assert not progress.on_status_report(run("Bf:15,128|Ln:110", state="Idle"), 0.0)
    assert progress.executed == 0


@pytest.mark.parametrize(("free", "executed"), [(15, 19), (14, 18), (10, 14), (0, 4)])
def test_by_blocks_the_last_ones_and_one_more_are_not_executed(free, executed):
    progress = stream(NUMBERED, 20)
    progress.on_status_report(run(f"Bf:{free},128"), 0.0)
    assert progress.executed == executed


def test_a_planner_fuller_than_the_lines_answered_credits_nothing():
    progress = stream(NUMBERED, 3)
    assert not progress.on_status_report(run("Bf:0,128"), 0.0)


def test_lines_that_make_no_block_go_with_the_motion_before_them():
    progress = stream([b"G1 X1", b"M4 S1", b"M4 S2", b"G1 X2", b"M5", b"G1 Y3", b"G1 Z4"], 7)
    # Y3 and Z4 are planned; X2 may still be in segments
    progress.on_status_report(run("Bf:13,128"), 0.0)
    assert progress.executed == 3
    progress.on_status_report(run("Bf:14,128"), 0.0)
    assert progress.executed == 5


@pytest.mark.parametrize("dwell", [b"N3 G4 P0.25", b"G04P1", b"G4"])
def test_the_answer_to_a_dwell_says_that_all_before_it_is_done(dwell):
    lines = [b"N1 G1 X1", b"N2 G1 X2", dwell, b"N4 G1 X3", dwell]
    progress = stream(lines, 2)
    assert progress.executed == 0
    progress.count_ok(1)
    assert (progress.acknowledged, progress.executed) == (3, 3)
    progress.count_ok(1)
    assert progress.executed == 3
    progress.on_status_report(run("Ln:1"), 0.0)  # a report of before it takes nothing back
    assert progress.executed == 3
    progress.count_ok(1)
    assert progress.executed == 5


@pytest.mark.parametrize("other", [b"G40", b"G4.3", b"G43.1 Z1", b"G14 P1", b"N4 G1 X4"])
def test_the_answer_to_any_other_line_says_only_that_it_was_taken(other):
    assert stream([b"G1 X1", other], 2).executed == 0


def test_a_dwell_that_was_refused_or_stands_behind_a_refused_line_is_not_done():
    for errors in ((0, 20, 0), (20, 0, 0), (0, 0, 20)):
        progress = stream([b"G1 X1", b"G4 P1", b"G4 P1"], 0)
        for error in errors:
            if error:
                progress.count_rejected()
            else:
                progress.count_ok(1)
        assert progress.executed == (2 if errors[1] == errors[0] == 0 else 0)


def test_the_hold_and_the_door_are_read_like_motion():
    for state in ("Hold:1", "Hold:0", "Door:0"):
        progress = stream(NUMBERED, 12)
        progress.on_status_report(run("Ln:105", state=state), 0.0)
        assert progress.executed == 5


def test_idle_with_all_answered_and_the_planner_empty_is_all():
    progress = stream(NUMBERED, 20)
    assert not progress.on_status_report(run("Bf:14,128", state="Idle"), 0.0)
    assert progress.on_status_report(run("Bf:15,128", state="Idle"), 0.0)
    assert progress.executed == progress.acknowledged == 20
    assert progress.is_all_executed


def test_idle_with_an_answer_due_is_not_all():
    progress = stream(NUMBERED, 19)
    assert not progress.on_status_report(run("Bf:15,128", state="Idle"), 0.0)
    assert progress.oldest_unanswered_line() == NUMBERED[19]


def test_without_blocks_idle_must_be_seen_twice_with_no_answer_between():
    progress = stream(NUMBERED, 19)
    assert not progress.on_status_report(run("FS:0,0", state="Idle"), 0.0)
    progress.count_ok(1)
    assert not progress.on_status_report(run("FS:0,0", state="Idle"), 0.0)
    assert progress.on_status_report(run("FS:0,0", state="Idle"), 0.0)
    assert progress.executed == 20


@pytest.mark.parametrize("state", ["Alarm", "Check", "Home", "Jog", "Sleep", "Tool"])
def test_other_states_credit_nothing(state):
    progress = stream(NUMBERED, 20)
    assert not progress.on_status_report(run("Bf:15,128|Ln:110", state=state), 0.0)
    assert not progress.on_status_report(run("Bf:15,128|Ln:110", state=state), 0.0)


def test_nothing_at_or_behind_a_rejected_line_is_acknowledged_or_executed():
    progress = stream(NUMBERED, 4)
    assert progress.count_rejected()
    assert not progress.count_rejected()
    progress.count_ok(1)
    assert (progress.acknowledged, progress.first_rejected_line,
            progress.lines_unanswered) == (4, 4, 13)
    progress.on_status_report(run("Ln:106"), 0.0)
    assert progress.executed == 4
    for _ in range(13):
        progress.count_ok(1)
    progress.on_status_report(run("Bf:15,128", state="Idle"), 0.0)
    assert progress.executed == 4
    assert not progress.is_all_executed


def test_a_rejected_line_is_in_no_block_count():
    progress = stream([b"G1 X%d" % n for n in range(6)], 2)
    progress.count_rejected()
    for _ in range(3):
        progress.count_ok(1)
    # four blocks: X1, X3, X4, X5; X0 may be in segments
    progress.on_status_report(run("Bf:11,128"), 0.0)
    assert progress.executed == 0
    progress.on_status_report(run("Bf:12,128"), 0.0)
    assert progress.executed == 1


def test_what_has_left_the_planner_is_executed_a_segment_buffer_later():
    progress = stream(NUMBERED, 12, lead_s=0.09)
    assert not progress.on_status_report(run("Ln:103"), 1.0)
    assert not progress.on_status_report(run("Ln:105"), 1.05)
    assert progress.on_status_report(run("Ln:106"), 1.1)
    assert progress.executed == 3
    progress.on_status_report(run("Ln:106"), 1.3)
    assert progress.executed == 6
    progress.on_status_report(run("Ln:109", state="Hold:1"), 1.4)
    assert progress.executed == 6
    # the segment buffer is empty in a hold
    progress.on_status_report(run("Ln:109", state="Hold:0"), 1.41)
    assert progress.executed == 9


def test_an_alarm_kills_what_is_in_the_segment_buffer():
    progress = stream(NUMBERED, 12, lead_s=0.09)
    progress.on_status_report(run("Ln:105"), 1.0)
    progress.on_status_report(run("Bf:15,128", state="Alarm"), 1.1)
    progress.on_status_report(run("Bf:15,128", state="Alarm"), 1.2)
    assert progress.executed == 0


@pytest.mark.parametrize(("head", "executed"), [(103, 3), (119, 19), (104, 4), (112, 12)])
def test_a_line_is_found_wherever_it_stands(head, executed):
    """Also where one report was damaged, and another took it far ahead."""
    progress = stream(NUMBERED, 2)  # answers that are late: nothing is executed yet
    progress.on_status_report(run("Ln:110"), 0.0)
    progress.on_status_report(run("Ln:118"), 0.0)
    progress.count_ok(18)
    progress.on_status_report(run(f"Ln:{head}"), 0.0)
    assert progress.executed == executed


def test_a_line_is_found_where_numbers_do_not_count_on():
    lines = [b"N%d G1 X1" % n for n in (9_000_000, 9_000_001, 5, 6, 70, 8)]
    progress = stream(lines, 6)
    for number, executed in ((9_000_001, 1), (5, 2), (70, 4), (8, 5)):
        progress.on_status_report(run(f"Ln:{number}"), 0.0)
        assert progress.executed == executed


@given(st.lists(st.booleans(), min_size=1, max_size=12), st.data())
def test_what_the_planner_holds_has_been_planned(kinds, data):
    lines = [b"N%d %s" % (n, b"G1 X1" if k else b"M4 S1") for n, k in enumerate(kinds)]
    done = data.draw(st.integers(0, len(lines) - 1))
    progress = stream(lines, len(lines))
    progress.on_status_report(run(f"Ln:{done}"), 0.0)
    head = data.draw(st.integers(done, len(lines) - 1))
    free = data.draw(st.integers(0, 15))
    makers = [n for n in range(head, len(lines)) if kinds[n]][: 15 - free]
    planned = len(lines) if len(makers) < 15 - free else makers[-1] + 1 if makers else 0
    assert progress.min_planned_lines(head, free) == planned


@given(st.data())
def test_counts_never_run_ahead_of_a_random_machine(data):
    """A machine that takes, plans and finishes lines at random; reports fall anywhere between."""
    blocks = data.draw(st.integers(2, 8))
    kinds = data.draw(st.lists(st.booleans(), min_size=1, max_size=40))
    lines = [b"N%d %s" % (n, b"G1 X1" if k else b"M4 S1") for n, k in enumerate(kinds)]
    by_number = data.draw(st.booleans())
    progress = StreamProgress(blocks, 0.0)
    planner: list[int] = []
    planned = 0
    for line in lines:
        progress.count_sent([line])
    for step in data.draw(st.lists(st.sampled_from(["plan", "move", "ask"]), max_size=150)):
        if step == "plan" and planned < len(lines) and len(planner) < blocks:
            if makes_planner_block(lines[planned]):
                planner.append(planned)
            planned += 1
            progress.count_ok(1)
        elif step == "move" and planner:
            planner.pop(0)
        elif step == "ask":
            fields = f"Bf:{blocks - len(planner)},128"
            if by_number and planner:
                fields += f"|Ln:{planner[0]}"
            progress.on_status_report(run(fields, "Run" if planner else "Idle"), 0.0)
            done = planner[0] if planner else planned
            assert progress.executed <= done
            assert progress.executed <= progress.acknowledged
            if not planner and planned == len(lines):
                assert progress.is_all_executed


def test_a_dwell_that_a_reset_breaks_off_is_answered_and_proves_nothing():
    """Firmwares answer the dwell they were in as they obey a reset: it is not over, nor are the
    lines before it that a hold kept from being executed."""
    progress = StreamProgress(planner_blocks=15, lead_s=0.0)
    progress.count_sent([b"N1 G1 X1", b"N2 G1 X2", b"N3 G4 P1"])
    progress.count_ok(2)
    progress.count_ok(1, dwells_end=False)
    assert (progress.acknowledged, progress.executed) == (3, 0)
