"""Going on with a job from any place: nothing left out, little laid twice, and a safe way in."""

from __future__ import annotations

import re
from importlib.resources import files
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmctl.config.machine import load_profile
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind
from lmctl.run.program.job_window import JobWindow
from lmctl.run.program.place import JOB_START, ProgramPlace
from lmctl.run.program.reentry import (
    OVERLAP_MM,
    RUN_UP_MM,
    overlap_mm,
    plan_reentry,
)

PROFILE = load_profile(Path(str(files("lmctl.examples") / "cell.toml")))
FLOW = [(0.0, (0.1, 0.0)), (8.0, (0.1, 0.0)), (9.0, (0.0, 0.1)), (1e3, (0.0, 0.1))]


@pytest.fixture(scope="module")
def whole(job_file, tmp_path_factory):
    path = tmp_path_factory.mktemp("reentry") / "job.lmj"
    job_file(path, PROFILE, job_file.squares(layers=3, per_layer=2), flow=FLOW)
    with JobReader(path) as reader:
        yield reader


def rows(whole):
    return np.concatenate([layer.lines for layer in whole.iterate_layers()])


def points(whole, lines):
    ends = np.column_stack([lines["x_mm"], lines["y_mm"], lines["z_mm"]])
    return np.concatenate([[PROFILE.motion.purge_mm], ends])


def go(whole, place):
    return plan_reentry(whole.manifest, whole.read_layer, place, PROFILE.motion)


def spoken(program, start):
    """What a controller makes of a program: (beam on, from, to, feed) of each motion."""
    at, feed, power, made = np.array(start, dtype=float), None, None, []
    for line in program:
        words = dict(re.findall(r"([FSXYZ])(-?[0-9.]+)", line))
        feed, power = float(words.get("F", feed or 0)), float(words.get("S", power or 0))
        to = np.array([float(words.get(axis, old)) for axis, old in zip("XYZ", at, strict=True)])
        if " G1 " in line:
            made.append((power > 0, at, to, feed))
        at = to
    return made


def lit_mm(motions):
    return sum(float(np.linalg.norm(to - at)) for beam_on, at, to, _ in motions if beam_on)


def beads_mm(whole, since=JOB_START):
    lines = rows(whole)
    length = np.linalg.norm(np.diff(points(whole, lines), axis=0), axis=1)
    length[: since.line] = 0.0
    length[since.line] *= 1.0 - since.line_fraction
    return float(length[lines["kind"] == LineKind.BEAD].sum())


def the_rest(whole, entry):
    after = [whole.read_layer(i) for i in range(entry.layer.index + 1, len(whole.manifest.layers))]
    return [line for layer in (entry.layer, *after) for line in layer.program]


def n_lines(whole):
    return sum(entry.n_lines for entry in whole.manifest.layers)


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_from_any_place_the_rest_is_deposited_and_no_more_than_the_overlap_twice(whole, data):
    line = data.draw(st.integers(0, n_lines(whole) - 1))
    place = ProgramPlace(line, data.draw(st.floats(0, 1)))
    entry = go(whole, place)
    left_mm = beads_mm(whole, place)
    if entry is None:
        assert left_mm < 0.02
        return
    laid_mm = lit_mm(spoken(the_rest(whole, entry), PROFILE.motion.purge_mm))
    assert laid_mm == pytest.approx(left_mm + entry.repeated_mm, abs=0.03)
    assert 0.0 <= entry.repeated_mm <= OVERLAP_MM + 1e-9


@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_the_approach_is_beam_off_continuous_and_never_longer_than_a_quarter_horizon(whole, data):
    place = ProgramPlace(data.draw(st.integers(0, n_lines(whole) - 60)),
                         data.draw(st.floats(0, 0.9)))
    entry = go(whole, place)
    n = entry.beam_on_line - entry.layer.first_line
    layer = entry.layer
    motions = spoken(layer.program, PROFILE.motion.purge_mm)
    beam_off = next(i for i, (beam_on, *_) in enumerate(motions) if beam_on)
    dwells = [line for line in layer.program[:n] if " G4 " in line]
    assert beam_off == n - 1 - len(dwells)
    for (_, _, before, _), (_, after, _, _) in pairwise(motions):
        assert np.array_equal(before, after)
    start_s = np.concatenate([layer.flow_s[:1], layer.lines["end_s"][:-1]])
    lasting_s = layer.lines["end_s"] - start_s
    assert (lasting_s[:n] <= 0.25 + 1e-9).all()
    assert (lasting_s >= 0).all()
    assert np.all(np.diff(layer.flow_s) > 0)
    # Across only at clearance height: never beside the part at its own height.
    for _, at, to, _ in motions[:beam_off]:
        if np.hypot(*(to - at)[:2]) > RUN_UP_MM + 0.01:
            assert at[2] >= layer.z_mm + PROFILE.motion.clearance_mm - 1e-9


def test_a_bead_is_entered_before_the_place_reached_with_its_own_feed_and_power(whole):
    lines = rows(whole)
    bead = int(np.flatnonzero(lines["kind"] == LineKind.BEAD)[6])
    entry = go(whole, ProgramPlace(bead, 0.5))
    motions = spoken(entry.layer.program, PROFILE.motion.purge_mm)
    first = next(i for i, motion in enumerate(motions) if motion[0])
    _, at, _, feed = motions[first]
    way = points(whole, lines)
    reached = (way[bead] + way[bead + 1]) / 2
    assert entry.repeated_mm == pytest.approx(overlap_mm(10.0, 500.0))
    assert np.linalg.norm(reached - at) == pytest.approx(entry.repeated_mm, abs=2e-3)
    assert feed == pytest.approx(600.0)
    assert "S500" in entry.layer.program[entry.beam_on_line - entry.layer.first_line]
    assert entry.layer.program[entry.beam_on_line - entry.layer.first_line].startswith(
        f"N{entry.beam_on_line} ")


def test_a_place_in_a_travel_goes_on_with_the_next_path_from_its_beginning(whole):
    lines = rows(whole)
    second = int(np.flatnonzero(lines["path"] == 1)[0])
    entry = go(whole, ProgramPlace(second - 3, 0.4))
    assert entry.repeated_mm == 0.0
    assert lines["path"][entry.beam_on_line] == 1
    assert lines["kind"][entry.beam_on_line - 1] == LineKind.LEAD


def test_a_path_all_deposited_is_not_entered_again(whole):
    lines = rows(whole)
    last = int(np.flatnonzero((lines["path"] == 0) & (lines["kind"] == LineKind.BEAD))[-1])
    entry = go(whole, ProgramPlace(last, 1.0))
    assert lines["path"][entry.beam_on_line] == 1


def test_after_the_last_bead_there_is_nothing_to_enter(whole):
    lines = rows(whole)
    last = int(np.flatnonzero(lines["kind"] == LineKind.BEAD)[-1])
    assert go(whole, ProgramPlace(last + 1)) is None
    assert go(whole, ProgramPlace(n_lines(whole) - 1, 1.0)) is None


def test_on_the_run_up_the_flow_is_the_program_s_and_before_it_stands_still(whole):
    lines = rows(whole)
    beads = np.flatnonzero(lines["kind"] == LineKind.BEAD)
    changing = beads[np.searchsorted(lines["end_s"][beads], 8.4)]  # FLOW changes from 8 s to 9 s
    for bead in (int(changing), int(beads[30])):
        entry = go(whole, ProgramPlace(bead, 0.5))
        layer = entry.layer
        n = entry.beam_on_line - layer.first_line
        lit_s = layer.lines["end_s"][n - 1]
        original = whole.read_layer(layer.index)
        dwells = np.flatnonzero(layer.lines["kind"][:n] == LineKind.DWELL)
        run_up_s = layer.lines["end_s"][dwells[-1]]
        assert 0.2 <= lit_s - run_up_s < 0.25
        for hopper in range(2):
            def program(s, hopper=hopper, original=original):
                return np.interp(s, original.flow_s, original.flow_g_s[:, hopper])

            def at(s, hopper=hopper, layer=layer):
                return np.interp(s, layer.flow_s, layer.flow_g_s[:, hopper])

            before = at(np.linspace(layer.flow_s[0], run_up_s, 20))
            assert before == pytest.approx(before[0])
            assert before[0] == pytest.approx(program(lit_s - 0.2), abs=1e-4)
            assert at(lit_s) == pytest.approx(program(lit_s))
            later = np.linspace(lit_s, layer.flow_s[-1], 50)
            assert at(later) == pytest.approx(program(later))


def test_every_move_of_the_way_in_begins_and_ends_at_rest_but_for_the_run_up(whole):
    """So its time is known exactly, and with it when powder has to leave its hopper."""
    lines = rows(whole)
    bead = int(np.flatnonzero(lines["kind"] == LineKind.BEAD)[30])
    layer = go(whole, ProgramPlace(bead, 0.5)).layer
    kinds = layer.lines["kind"]
    moves = np.diff(points(whole, layer.lines), axis=0)
    for row in np.flatnonzero(kinds == LineKind.TRAVEL)[1:]:
        before, after = moves[row - 1], moves[row]
        turned = before @ after < 0.9999 * np.linalg.norm(before) * np.linalg.norm(after)
        assert not turned or kinds[row - 1] in (LineKind.DWELL, LineKind.SETUP)


@pytest.mark.parametrize(("speed_mm_s", "acceleration_mm_s2"), [(5, 500), (10, 500), (20, 500)])
def test_two_millimetres_around_an_entry_hold_no_more_than_1_3_of_a_bead(
    speed_mm_s, acceleration_mm_s2
):
    braked_mm = speed_mm_s**2 / (2 * acceleration_mm_s2)  # came more while braking
    again_mm = overlap_mm(speed_mm_s, acceleration_mm_s2)
    assert 0.0 <= again_mm <= OVERLAP_MM
    assert (2.0 + braked_mm + again_mm) / 2.0 <= 1.3


def test_a_job_window_runs_from_an_entry_in_the_jobs_own_line_numbers(whole):
    lines = rows(whole)
    bead = int(np.flatnonzero(lines["path"] == 3)[5])
    entry = go(whole, ProgramPlace(bead))
    index = entry.layer.index

    def read(layer):
        assert layer >= index
        return entry.layer if layer == index else whole.read_layer(layer)

    window = JobWindow(whole.manifest, read, PROFILE.motion.purge_mm, first_layer=index)
    assert window.first_layer().first_line == entry.layer.first_line
    assert window.line_start_s(entry.beam_on_line) == pytest.approx(
        float(entry.layer.lines["end_s"][entry.beam_on_line - entry.layer.first_line - 1]))
    assert window.line_start_s(bead + 3) == pytest.approx(float(lines["end_s"][bead + 2]))
    assert window.line_at_program_time(float(entry.layer.flow_s[0])) <= entry.beam_on_line
    assert window.end_s == pytest.approx(float(lines["end_s"][-1]))
