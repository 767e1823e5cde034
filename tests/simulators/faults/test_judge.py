"""The judge against motion and powder whose truth is known on paper."""

import asyncio

import pytest

from simulators.fault_outcome import judge_fault, record_as_json

# The bench accelerates at 500 mm/s²: 10 mm/s takes 0.02 s and 0.1 mm.
SPEED, ACCELERATION = 10.0, 500.0
RAMP_S, RAMP_MM = SPEED / ACCELERATION, SPEED**2 / 2 / ACCELERATION
START = "G21 G90 G94\nM4 S0\n"


async def ready(cell, mode="M4"):
    await cell.send(f"G21 G90 G94\n{mode} S0\n", then_s=1.0)


def test_the_beam_is_on_exactly_while_a_move_lasts(play):
    async def scene(cell):
        await ready(cell)
        began = cell.now_s
        await cell.send("N7 G1 X20 F600 S500\nN8 G1 X30 S0\n", then_s=10.0)
        return began, cell.judge.beam_on_intervals(), cell.judge.executed_lines(), cell.judge

    began, beam, lines, judge = play(scene)
    (beam_on,) = beam
    # N7 is left at full speed
    assert beam_on.begin_s == pytest.approx(began)
    assert beam_on.duration_s == pytest.approx(RAMP_S + (20 - RAMP_MM) / SPEED)
    assert [(one.line, one.executed_fraction) for one in lines] == [(7, 1.0), (8, 1.0)]
    assert [one.beam_on_mm for one in lines] == [pytest.approx(20.0), 0.0]
    assert judge.beam_on_without_motion() == ()
    assert judge.beam_off_at_s(began + 1.0) == beam_on.end_s == judge.beam_last_on_s()
    assert judge.beam_off_at_s(began - 0.5) == began - 0.5
    assert judge.beam_on_again_at_s(began - 0.5) == beam_on.begin_s
    assert judge.beam_on_again_at_s(began + 1.0) is None
    assert judge.axes_stopped_at_s(
        began + 0.5) == pytest.approx(began + 2 * RAMP_S + (30 - 2 * RAMP_MM) / 10)


def test_slow_motion_with_the_beam_on_is_timed_from_below_the_speed(play):
    async def scene(cell):
        await ready(cell)
        await cell.send("N1 G1 X20 F600 S500\n", then_s=10.0)
        return cell.judge

    judge = play(scene)
    assert judge.beam_on_without_motion() == ()
    first, last = judge.beam_on_without_motion(below_mm_s=1.0, longer_than_s=0.0)
    assert first.duration_s == pytest.approx(1.0 / ACCELERATION)
    assert last.duration_s == pytest.approx(1.0 / ACCELERATION)
    (all_of_it,) = judge.beam_on_without_motion(below_mm_s=10.5)
    assert all_of_it.duration_s == pytest.approx(2 * RAMP_S + (20 - 2 * RAMP_MM) / SPEED)


def test_a_constant_beam_that_is_on_at_standstill_is_found(play):
    async def scene(cell):
        await ready(cell, "M3")
        began = cell.now_s
        await cell.send("N1 G1 X20 F600 S500\n", then_s=5.0)
        return began, cell.now_s, cell.judge.beam_on_without_motion(
            ), cell.judge.beam_on_intervals()

    began, now_s, active, beam = play(scene)
    arrived_s = began + 2 * RAMP_S + (20 - 2 * RAMP_MM) / SPEED
    assert active[-1].begin_s == pytest.approx(arrived_s - 1.0 / ACCELERATION)
    assert active[-1].end_s == pytest.approx(now_s)
    assert beam[-1].end_s == pytest.approx(now_s)


def test_nothing_is_said_of_what_has_not_happened_yet(play):
    async def scene(cell):
        await ready(cell)
        began = cell.now_s
        await cell.send("N1 G1 X20 F600 S500\n", then_s=1.0)
        (beam_on,) = cell.judge.beam_on_intervals()
        (line,) = cell.judge.executed_lines()
        assert beam_on.end_s == pytest.approx(began + 1.0)
        assert line.beam_on_mm == pytest.approx(RAMP_MM + (1.0 - RAMP_S) * SPEED)

    play(scene)


def test_a_hold_in_the_middle_is_one_line_and_two_stretches(play):
    async def scene(cell):
        await ready(cell)
        began = cell.now_s
        await cell.send("N3 G1 X20 F600 S500\n", then_s=1.0)
        await cell.send("!", then_s=2.0)
        await cell.send("~", then_s=5.0)
        return began, cell.judge

    began, judge = play(scene)
    assert len(judge.beam_on_intervals()) == 2
    dark_s = judge.beam_off_at_s(began + 1.0)
    assert 0.02 < dark_s - began - 1.0 < 0.2
    assert judge.beam_on_again_at_s(began + 1.0) == pytest.approx(began + 3.0, abs=0.05)
    (line,) = judge.executed_lines()
    assert (line.executed_fraction, line.beam_on_mm) == (pytest.approx(1.0), pytest.approx(20.0))
    assert judge.beam_on_length_by_line()[0].repeated_mm == 0.0


def test_what_is_drawn_again_is_measured_along_the_line(play):
    async def scene(cell):
        await ready(cell)
        await cell.send(
            "N5 G1 X20 F600 S500\nN5 G1 X15 S0\nN5 G1 X25 S500\nN6 G1 Y10 S500\n"
            "N6 G1 Y0 S0\nN6 G1 Y10 S500\n", then_s=20.0,
        )
        return cell.judge.beam_on_length_by_line()

    five, six = play(scene)
    assert (five.line, five.beam_on_mm, five.repeated_mm) == (
        5, pytest.approx(25.0), pytest.approx(5.0))
    assert (six.line, six.beam_on_mm, six.repeated_mm) == (
        6, pytest.approx(10.0), pytest.approx(10.0))


def test_a_move_cut_short_shows_how_much_of_it_was_done(play):
    async def scene(cell):
        await ready(cell)
        await cell.send("N5 G1 X20 F600 S500\n", then_s=1.0)
        await cell.send(b"\x18", then_s=1.0)
        return cell.judge.executed_lines()

    (line,) = play(scene)
    moved_mm = RAMP_MM + (1.0 - RAMP_S) * SPEED
    assert line.executed_fraction == pytest.approx(moved_mm / 20)
    assert line.end_mm[0] == pytest.approx(moved_mm)


def test_powder_is_lacking_until_it_is_stable_and_after_it_stops(play):
    async def scene(cell):
        await ready(cell)
        cell.feed("F1")
        start_s = cell.now_s
        await cell.send("N1 G1 X290 F600 S500\n", then_s=25.0)
        cell.bench.feeders["F1"].raise_alarm(102)
        await asyncio.sleep(5.0)
        return start_s, cell.judge

    start_s, judge = play(scene)
    lacks = judge.powder_deficits()
    before, after = (lack for lack in lacks if lack.reason == "not stable")
    stable_s = start_s + 3.0 + 8.0  # gas first, then the time to stabilise
    assert before.end_s == pytest.approx(stable_s, abs=0.02)
    assert after.begin_s == pytest.approx(start_s + 25.0, abs=0.05)
    stop = judge.powder_stop("F1")
    assert stop.commanded_s == stop.stopped_s == pytest.approx(start_s + 25.0)
    assert judge.powder_stop("F2") is None
    assert judge.powder_stop("F1", after_s=stop.commanded_s + 1.0) is None
    assert not judge.is_powder_on("F1")
    assert judge.gas_off_at_s("F1") is None


def test_a_flow_that_is_off_is_found_a_dead_time_after_the_disc(play):
    async def scene(cell):
        await ready(cell)
        cell.feed("F1")
        await asyncio.sleep(20.0)
        await cell.send("N1 G1 X290 F600 S500\n", then_s=5.0)
        at_s = cell.now_s
        cell.inject("disc_stalls", "F1", noticed=False)
        await asyncio.sleep(15.0)
        return at_s, cell.judge

    at_s, judge = play(scene)
    (lack,) = judge.powder_deficits(off_by=0.5)
    assert lack.reason == "flow off"
    # 3 s of dead time, then ln 2 of a lag of 1 s until half is gone
    assert lack.begin_s == pytest.approx(at_s + 3.0 + 0.693, abs=0.03)
    assert judge.powder_deficits(off_by=0.5) == judge.powder_deficits(0.5)


def test_gas_goes_off_after_the_postflow(play):
    async def scene(cell):
        cell.feed("F1")
        await asyncio.sleep(20.0)
        cell.bench.feeders["F1"].write(0, [1])  # remote, and nothing else
        at_s = cell.now_s
        await asyncio.sleep(20.0)
        return at_s, cell.judge

    at_s, judge = play(scene)
    assert judge.powder_stop("F1").commanded_s == pytest.approx(at_s)
    assert judge.gas_off_at_s("F1") == pytest.approx(at_s + 10.0)
    assert judge.gas_off_at_s("F1", after_s=at_s + 11.0) is None


def test_a_verdict_says_what_is_wrong_in_words(play):
    async def scene(cell):
        await ready(cell)
        cell.feed("F1")
        await asyncio.sleep(20.0)
        await cell.send("N1 G1 X50 F600 S500\n", then_s=1.0)
        at_s = cell.now_s
        await asyncio.sleep(10.0)
        outcome = judge_fault(cell.bench, at_s)
        return outcome, record_as_json(cell.bench, cell.board.injected)

    outcome, record = play(scene)
    assert outcome.beam_off_after_s == pytest.approx(4.04 - 0.02, abs=0.01)
    assert outcome.powder_on == ("F1",)
    assert outcome.safety_shortfalls(beam_off_within_s=5.0) == ["F1 still feeds"]
    first, *_ = outcome.safety_shortfalls(beam_off_within_s=0.1)
    assert first.startswith("the beam stayed on for 4.0")
    assert record["host"]["motion"] == [(0.0, True)]
    assert len(record["beam"]) == len(record["lines"]) == 1
