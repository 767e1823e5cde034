"""A part of the matrix of faults and states; `make faults` does all of it."""

from __future__ import annotations

import pytest

from lmctl.run.state.transitions import RunState
from simulators.faults.kinds import FAULT_KINDS
from tests.faults.expected import EXPECTED
from tests.faults.freshness import ADVICE, MATRIX, rows_of, staleness, stamp
from tests.faults.matrix import STATES, faults_of, try_one, write_job

#: One of each sort while beads are laid.
WHILE_LAYING = (
    "controller_reboots", "controller_silent", "controller_lies", "panel_hold", "ok_doubled",
    "link_closed", "bytes_flipped", "device_silent", "feeder_restarts", "disc_stalls",
    "flow_readback_off", "disc_limited", "oxygen_high", "safety_stuck", "laser_enable_stuck",
    "laser_enable_drops", "passing_exceptions", "half_open", "stray_bytes", "requests_echoed",
)
IN_EVERY_STATE = ("estop", "door")


def test_every_kind_of_fault_has_its_words():
    assert set(EXPECTED) == set(FAULT_KINDS) - {"host_killed"}


@pytest.mark.parametrize(("kind", "state"), [
    *[(kind, RunState.DEPOSITING) for kind in WHILE_LAYING],
    ("laser_enable_stuck", RunState.GAS), ("laser_enable_stuck", RunState.HOLDING),
    ("laser_enable_drops", RunState.RESUMING),
    *[(kind, state) for kind in IN_EVERY_STATE for state in STATES if state != RunState.DEPOSITING],
])
def test_a_fault_ends_safely_and_is_named(kind, state, tmp_path):
    cell = try_one(faults_of(kind)[0], state, tmp_path, write_job(tmp_path))
    assert cell.came
    assert cell.shortfalls == []


def test_the_table_in_the_tree_is_what_its_generator_makes(tmp_path):
    assert staleness(MATRIX.read_text(), tmp_path) == [], ADVICE


def test_a_cell_edited_by_hand_is_found_and_so_is_a_row_that_is_missing(tmp_path):
    text = MATRIX.read_text()
    edited = text.replace("| done | done |", "| done | stopped |", 1)
    assert edited != text
    assert staleness(edited, tmp_path) == ["its rows were edited by hand"]
    rows = rows_of(text)
    cut = text.replace(rows[3] + "\n", "")
    cut = cut.replace(stamp(rows), stamp(rows_of(cut)))
    assert staleness(cut, tmp_path) == ["its rows are not those of the faults there are"]


def test_a_cell_that_would_come_out_otherwise_is_found(tmp_path):
    """All cells changed alike, with a stamp to fit: the sample finds it."""
    text = MATRIX.read_text()
    rows = rows_of(text)
    changed = [row.replace("done", "stopped").replace("faulted", "done") for row in rows]
    for row, other in zip(rows, changed, strict=True):
        text = text.replace(row, other)
    text = text.replace(stamp(rows), stamp(changed))
    assert any("it says" in one for one in staleness(text, tmp_path, sampled=2))
