"""Whether a machine's position is proven, and what it then says of how far a job has come."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from lmctl.config.machine import SafetySettings
from lmctl.job.reader import JobReader
from lmctl.run.journal.format import read_records
from lmctl.run.journal.recovery import doubt_in_words, find_recovery_place, stated_by_operator
from lmctl.run.journal.replay import replay_run
from lmctl.run.program.job_lines import bead_between_mm
from lmctl.run.program.place import (
    Known,
    PlaceReached,
    ProgramPlace,
    known_place,
    unknown_place,
)
from tests.run.whole.broken_off import broken_off, seen

AT_REST_MM = (30.0, 33.0, 0.5)


@pytest.fixture
def killed(whole, tmp_path):
    """The aftermath of a host killed in the middle of the part, and the lines of its job."""
    records = list(read_records(whole.journal))
    cut = [i for i, record in enumerate(records) if record["kind"] == "sent"][40] + 1
    return replay_run(broken_off(tmp_path / "run-0001", whole, cut))


@pytest.fixture
def job(killed):
    with JobReader(killed.run.job) as reader:
        yield reader


def end_mm(job, line):
    (rows,) = [layer.lines for layer in job.iterate_layers() if layer.first_line <= line
               < layer.first_line + len(layer.lines)]
    (first,) = [layer.first_line for layer in job.iterate_layers() if layer.first_line <= line
                < layer.first_line + len(layer.lines)]
    row = rows[line - first]
    return np.array([row["x_mm"], row["y_mm"], row["z_mm"]])


def test_a_machine_that_has_run_dry_stands_at_the_end_of_what_was_sent(killed, job, profile):
    found = find_recovery_place(job, killed, seen(end_mm(job, killed.sent_line)), profile)
    assert found.lost == ""
    assert found.reached.known is Known.REPORTED
    assert bead_between_mm(job, ProgramPlace(killed.sent_line, 1.0), found.reached.place) == 0.0
    assert bead_between_mm(job, found.reached.place, ProgramPlace(killed.sent_line, 1.0)) < 0.06


@pytest.mark.parametrize(("evidence", "words"), [
    ({"restarted": True}, "welcome message"),
    ({"at_zero": True}, "switched off and on"),
    ({"uptimes_s": {"F1": 60.0}}, "F1 of its cell restarted"),
])
def test_a_controller_that_may_have_restarted_proves_nothing_wherever_it_stands(
    killed, job, profile, evidence, words
):
    after = replace(killed, ended_wall=datetime.now(UTC) - timedelta(hours=2))
    found = find_recovery_place(job, after, seen(end_mm(job, after.sent_line), **evidence), profile)
    assert words in found.lost
    assert found.reached.is_doubtful
    assert found.reached.place == after.proven_place
    assert found.reached.until == ProgramPlace(after.sent_line + 1)


@pytest.mark.parametrize("off_mm", [(0, 0, 0.1), (0, 0, -0.1), (-148, 0, 0)])
def test_a_machine_that_stands_off_every_line_sent_proves_nothing(killed, job, profile, off_mm):
    found = find_recovery_place(job, killed, seen(end_mm(job, killed.sent_line) + off_mm), profile)
    assert "nothing that run-0001 sent has brought it" in found.lost
    assert found.reached.is_doubtful


def test_a_place_reported_at_rest_is_kept_through_whatever_restarted_in_the_cell(
    killed, job, profile
):
    reached = known_place(killed.proven_place, Known.REPORTED, 12.0)
    after = replace(killed, reached=reached, standstill_mm=AT_REST_MM, moving=False, to_purge=False,
                    ended_wall=datetime.now(UTC) - timedelta(days=1))
    stays = find_recovery_place(job, after, seen(AT_REST_MM, uptimes_s={"F1": 5.0}), profile)
    assert (stays.lost, stays.reached) == ("", reached)
    # It was sent away since, so standing there again is no proof any more.
    left = find_recovery_place(job, replace(after, to_purge=True),
                               seen(AT_REST_MM, uptimes_s={"F1": 5.0}), profile)
    assert left.lost
    assert left.reached == reached  # which was reported, and stays so


def test_on_its_way_to_the_purge_position_a_machine_has_lost_nothing(killed, job, profile):
    reached = known_place(killed.proven_place, Known.REPORTED, 12.0)
    after = replace(killed, reached=reached, standstill_mm=AT_REST_MM, moving=False, to_purge=True)
    x, y, z = profile.motion.purge_mm
    for at_mm in ((30.0, 33.0, 11.0), (20.0, (33.0 + y) / 2, z), (x, y, z), (x, y, z + 3.0)):
        found = find_recovery_place(job, after, seen(at_mm), profile)
        assert (found.lost, found.reached) == ("", reached), at_mm


def test_where_a_path_comes_by_the_same_point_again_the_operator_is_asked(killed, job, profile):
    """A square smaller than the send horizon, whose end is its beginning."""
    mine = np.flatnonzero(next(job.iterate_layers()).lines["path"] == 1)
    lead, last = int(mine[0]), int(mine[-2])
    corner_mm = end_mm(job, lead)
    after = replace(
        killed, proven_place=ProgramPlace(lead - 1), sent_line=last, last_line=last, beam_on_line=0,
        reached=PlaceReached(ProgramPlace(lead - 1), Known.UNKNOWN, ProgramPlace(lead - 1),
                             ProgramPlace(last + 1)))
    found = find_recovery_place(job, after, seen(corner_mm), profile)
    assert found.lost == ""
    assert found.reached.is_doubtful
    assert bead_between_mm(job, found.reached.place, found.reached.until) == pytest.approx(
        32.0, abs=0.2)
    (words,) = doubt_in_words(job, found.reached)
    assert words.startswith("path 2 of layer 1: 32.0 mm, from X40.0 Y30.0")
    stated = stated_by_operator(job, found.reached, 10.0)
    assert stated.known is Known.STATED
    assert bead_between_mm(job, found.reached.place, stated.place) == pytest.approx(10.0)


def test_what_was_inferred_from_motion_going_on_needs_a_machine_that_shows_it(
    killed, job, profile
):
    inferred = ProgramPlace(killed.sent_line, 0.5)
    reached = PlaceReached(inferred, Known.INFERRED, killed.proven_place, inferred)
    after = replace(killed, reached=reached)
    beyond = find_recovery_place(job, after, seen(end_mm(job, killed.sent_line)), profile)
    assert beyond.reached.place == inferred
    stopped = find_recovery_place(job, after, seen(end_mm(job, killed.proven_place.line)), profile)
    assert stopped.reached.known is Known.REPORTED
    assert stopped.reached.place < inferred
    restarted = find_recovery_place(job, after, seen((0, 0, 0), at_zero=True), profile)
    assert restarted.reached.known is Known.UNKNOWN
    assert (restarted.reached.place, restarted.reached.until) == (killed.proven_place, inferred)


def test_with_a_laser_enable_output_the_bead_ends_before_the_machine_stands(killed, job, profile):
    safe = profile.model_copy(update={"safety": SafetySettings(
        endpoint="modbus-tcp://127.0.0.1:1", relay_timeout_s=0.3, laser_enable=True)})
    line = killed.sent_line
    middle_mm = (end_mm(job, line - 1) + end_mm(job, line)) / 2
    (plain,
     early) = (find_recovery_place(job, killed, seen(middle_mm), one) for one in (profile, safe))
    assert plain.reached.known is Known.REPORTED
    assert early.reached.known is Known.INFERRED
    # 90 ms of prepared motion less 20 ms of the laser, and 0.1 mm of braking, at 10 mm/s.
    assert bead_between_mm(job, early.reached.place, plain.reached.place) == pytest.approx(0.8)
    dry = find_recovery_place(job, killed, seen(end_mm(job, line)), safe)
    assert dry.reached.known is Known.REPORTED


def test_a_machine_that_stands_beyond_the_end_of_a_bead_has_deposited_all_of_it(
    killed, job, profile
):
    """With a laser-enable output motion ends later than the beam: here on the way out."""
    safe = profile.model_copy(update={"safety": SafetySettings(
        endpoint="modbus-tcp://127.0.0.1:1", relay_timeout_s=0.3, laser_enable=True)})
    mine = np.flatnonzero(next(job.iterate_layers()).lines["path"] == 0)
    last_bead, way_out = int(mine[-2]), int(mine[-1])
    after = replace(killed, proven_place=ProgramPlace(last_bead), sent_line=way_out + 2,
                    reached=unknown_place(ProgramPlace(last_bead), ProgramPlace(way_out + 3)))
    at_mm = end_mm(job, last_bead) + 0.9 * (end_mm(job, way_out) - end_mm(job, last_bead))
    found = find_recovery_place(job, after, seen(at_mm), safe)
    assert bead_between_mm(job, found.reached.place, ProgramPlace(way_out)) == pytest.approx(0.0)
