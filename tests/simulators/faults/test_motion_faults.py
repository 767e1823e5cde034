"""What each fault of the motion controller does: on the wire, and to beam and axes."""

import asyncio
import re

import pytest

from firmware_protocol.status import parse_status

GRBL = [('dialect = "grblhal"', 'dialect = "grbl"'), ("\n10 = 511\n", "\n10 = 3\n"),
        ("rx_bytes = 1024", "rx_bytes = 128"), ("planner_blocks = 100", "planner_blocks = 15")]


async def under_way(cell, length_mm=100.0):
    """The beam draws a long line, since one second."""
    await cell.send("G21 G90 G94\nM4 S0\n", then_s=0.5)
    await cell.send(f"N5 G1 X{length_mm} F600 S500\n", then_s=1.0)


def reports(data: bytes) -> list[str]:
    return re.findall(r"<[^>]*>", data.decode("latin-1"))


def test_a_reboot_ends_motion_says_nothing_while_booting_and_starts_at_zero(play):
    async def scene(cell):
        await under_way(cell)
        at_s = cell.now_s
        cell.inject("controller_reboots", boot_s=1.5)
        booting = await cell.send("?", then_s=1.4)
        up = await cell.send("", then_s=0.2)
        later = await cell.send("?$I\n", then_s=0.1)
        return at_s, booting, up, later, cell.judge, cell.bench.motion.trace.sample(
            [cell.now_s]).position_mm[0]

    at_s, booting, up, later, judge, place_mm = play(scene)
    assert booting == b""
    assert up == b"\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n"
    assert later.startswith(b"<Idle|MPos:0.000,0.000,0.000|")
    assert later.endswith(b"ok\r\n")
    assert judge.beam_off_at_s(at_s) == pytest.approx(at_s, abs=1e-6)
    # the axes are where they were, whatever the controller takes them to be
    assert place_mm == pytest.approx([9.9, 0, 0])


def test_after_a_reboot_the_axes_move_from_where_they_really_are(play):
    async def scene(cell):
        await under_way(cell)
        cell.inject("controller_reboots")
        await asyncio.sleep(2.0)
        await cell.send("G21 G90 G94\nM4 S0\nN9 G1 X2 F600 S500\n", then_s=2.0)
        return cell.judge.executed_lines()[-1], reports(await cell.send("?"))

    line, (report,) = play(scene)
    assert line.start_mm == pytest.approx((9.9, 0, 0))
    assert line.end_mm == pytest.approx((11.9, 0, 0))
    assert "MPos:2.000,0.000,0.000" in report


def test_homing_after_a_reboot_finds_the_true_place_again(play):
    async def scene(cell):
        await cell.send("$H\n", then_s=30.0)
        await cell.send("G21 G90 G94\nM4 S0\nG1 X-50 F3000\n", then_s=6.0)
        before_mm = cell.bench.motion.trace.sample([cell.now_s]).position_mm[0]
        cell.inject("controller_reboots")
        await asyncio.sleep(2.0)
        await cell.send("$X\n$H\n", then_s=30.0)
        return before_mm, cell.bench.motion.trace.sample([cell.now_s]).position_mm[0], (
            reports(await cell.send("?")))

    before_mm, after_mm, (report,) = play(scene, ("\n32 = 1\n", "\n22 = 1\n32 = 1\n"))
    assert before_mm[0] == pytest.approx(-50)
    believed = [float(word) for word in re.search(r"MPos:([^|]*)", report)[1].split(",")]
    assert after_mm == pytest.approx(believed, abs=0.01)


@pytest.mark.parametrize("receives", [False, True])
def test_silent_it_says_nothing_and_goes_on_with_what_it_has(play, receives):
    async def scene(cell):
        await under_way(cell)
        cell.inject("controller_silent", receives=receives, for_s=3.0)
        at_s = cell.now_s
        said = await cell.send("?!", then_s=3.1)
        after = await cell.send("?", then_s=0.2)
        return at_s, said, after, cell.judge

    at_s, said, after, judge = play(scene)
    assert said == b""
    assert reports(after)[0].startswith("<Hold:0" if receives else "<Run")
    assert (judge.beam_off_at_s(at_s) < at_s + 0.2) is receives


def test_stalled_it_takes_nothing_and_gets_it_all_later(play):
    async def scene(cell):
        await under_way(cell)
        cell.inject("controller_stalls", for_s=2.0)
        stalled = await cell.send("?" + "$\n", then_s=1.9)
        return stalled, await cell.send("", then_s=0.3)

    stalled, after = play(scene)
    assert stalled == b""
    assert reports(after)
    assert after.endswith(b"ok\r\n")


def test_lying_it_reports_one_place_for_ever_while_it_moves(play):
    async def scene(cell):
        await under_way(cell)
        cell.inject("controller_lies", for_s=3.0)
        lies = [reports(await cell.send("?", then_s=1.0))[0] for _ in range(2)]
        await asyncio.sleep(1.5)
        return lies, reports(await cell.send("?")), cell.bench.motion.position_mm

    (first, second), (truth,), place_mm = play(scene)
    assert first == second
    assert first.startswith("<Run|")
    assert first != truth
    assert place_mm[0] > 40


def test_lying_idle(play):
    async def scene(cell):
        await under_way(cell)
        cell.inject("controller_lies", state="Idle")
        return reports(await cell.send("?"))[0]

    assert play(scene).startswith("<Idle|")


@pytest.mark.parametrize("dialect", [(), GRBL])
def test_a_limit_switch_stops_dead_and_locks(play, dialect):
    async def scene(cell):
        await under_way(cell)
        at_s = cell.now_s
        cell.inject("hard_limit")
        said = await cell.send("G1 X0 F600\n", then_s=0.5)
        return at_s, said, cell.judge

    at_s, said, judge = play(scene, *dialect)
    assert b"ALARM:1\r\n[MSG:Reset to continue]" in said
    assert judge.beam_off_at_s(at_s) == judge.axes_stopped_at_s(at_s) == pytest.approx(at_s)


@pytest.mark.parametrize("dialect", [(), GRBL])
def test_a_soft_limit_brakes_and_locks(play, dialect):
    async def scene(cell):
        await under_way(cell)
        at_s = cell.now_s
        cell.inject("soft_limit")
        return at_s, await cell.send("", then_s=0.5), cell.judge

    at_s, said, judge = play(scene, *dialect)
    assert b"ALARM:2" in said
    assert 0.02 < judge.axes_stopped_at_s(at_s) - at_s < 0.2


@pytest.mark.parametrize(("dialect", "alarm", "pin"), [((), b"ALARM:10", "E"), (GRBL, b"ALARM:3",
                                                                                   "R")])
def test_the_estop_input_stops_dead_and_shows_at_the_pin(play, dialect, alarm, pin):
    async def scene(cell):
        await under_way(cell)
        at_s = cell.now_s
        number = cell.inject("motion_estop")
        said = await cell.send("?", then_s=0.5)
        cell.board.clear(number)
        return at_s, said, reports(await cell.send(b"\x18?")), cell.judge

    at_s, said, after, judge = play(scene, *dialect)
    assert alarm in said
    assert re.search(rf"\|Pn:{pin}\b", reports(said)[-1])
    assert "|Pn:" not in after[-1]
    assert judge.beam_off_at_s(at_s) == judge.axes_stopped_at_s(at_s) == pytest.approx(at_s)


def test_with_the_chain_open_a_reset_does_not_unlock(play):
    async def scene(cell):
        number = cell.inject("motion_estop")
        locked = await cell.send(b"\x18$X\nG1 X1 F600\n")
        cell.board.clear(number)
        return locked, await cell.send(b"\x18") + await cell.send("$X\nG1 X1 F600\n")

    locked, free = play(scene)
    assert b"ALARM:10" in locked
    assert b"ok" not in locked.replace(b"unlock", b"")
    assert free.endswith(b"ok\r\nok\r\n")


def test_the_door_input_stops_and_closes_again(play):
    async def scene(cell):
        await under_way(cell)
        at_s = cell.now_s
        number = cell.inject("motion_door")
        opened = reports(await cell.send("", then_s=0.5) + await cell.send("?"))
        cell.board.clear(number)
        return at_s, opened, reports(await cell.send("?")), cell.judge

    at_s, opened, closed, judge = play(scene)
    assert opened[-1].startswith("<Door:1")
    assert closed[-1].startswith("<Door:0")
    assert 0.0 < judge.beam_off_at_s(at_s) - at_s < 0.2


def test_hold_and_start_at_the_panel(play):
    async def scene(cell):
        await under_way(cell)
        at_s = cell.now_s
        cell.inject("panel_hold")
        await asyncio.sleep(1.0)
        held = reports(await cell.send("?"))
        cell.inject("panel_start")
        started_s = cell.now_s
        await asyncio.sleep(1.0)
        return at_s, held, started_s, cell.judge

    at_s, (held,), started_s, judge = play(scene)
    assert held.startswith("<Hold:0")
    assert judge.beam_on_again_at_s(at_s) == pytest.approx(started_s, abs=0.01)


def test_overrides_at_the_panel(play):
    async def scene(cell):
        await under_way(cell)
        cell.inject("panel_override", feed=120, rapid=50, beam=90)
        await asyncio.sleep(0.5)
        return reports(await cell.send("??") + await cell.send("?"))

    said = "".join(play(scene))
    assert "Ov:120,50,90" in said
    assert "FS:720" in said


@pytest.mark.parametrize(("kind", "times"), [("ok_lost", 0), ("ok_doubled", 2)])
def test_an_answer_is_lost_or_doubled_and_the_next_ones_are_right(play, kind, times):
    async def scene(cell):
        cell.inject(kind)
        return await cell.send("G21\nG90\n"), await cell.send("G94\n")

    first, second = play(scene)
    assert first == b"ok\r\n" * (times + 1)
    assert second == b"ok\r\n"


def test_only_answers_are_lost(play):
    async def scene(cell):
        cell.inject("ok_lost", count=2)
        return await cell.send("?$G\nG21\nG90\n")

    said = play(scene)
    assert reports(said)
    assert b"[GC:" in said
    assert said.count(b"ok\r\n") == 1


@pytest.mark.parametrize(("letter", "percent", "there"), [
    ("S", 10.0, b"G1 X10 F600 S050\n"), ("F", 150.0, b"G1 X10 F900 S500\n"),
    ("F", 300.0, b"G1 X10 F999 S500\n"), ("X", 0.0, b"G1 X00 F600 S500\n"),
    ("Z", 50.0, b"G1 X10 F600 S500\n"),
])
def test_one_word_is_garbled_and_still_a_number(play, letter, percent, there):
    async def scene(cell):
        got = []
        receive = cell.bench.motion.receive
        cell.bench.motion.receive = lambda data: (got.append(data), receive(data))
        cell.inject("word_garbled", letter=letter, percent=percent)
        await cell.send("G21 G90\nM4 S0\n")
        await cell.send("G1 X10 F600 S500\n")
        await cell.send("G1 X20 F600 S500\n")
        return got

    assert play(scene) == [b"G21 G90\nM4 S0\n", there, b"G1 X20 F600 S500\n"]


@pytest.mark.parametrize("how", ["digit", "byte", "cut", "any"])
def test_one_report_in_so_many_is_garbled_and_a_changed_digit_still_parses(play, how):
    async def scene(cell):
        for _ in range(3):
            await cell.send("?")  # offset and overrides come with the first ones
        sound = [await cell.send("?") for _ in range(60)]
        cell.inject("reports_garbled", probability=0.5, how=how, seed=3)
        return sound, [await cell.send("?") for _ in range(60)]

    sound, said = play(scene)
    struck = [one for one in said if one not in sound]
    assert 18 <= len(struck) <= 42
    parsed = [parse_status(one.decode().strip()) is not None for one in struck]
    assert all(parsed) if how == "digit" else not all(parsed)


def test_the_same_seed_strikes_the_same_reports(play):
    async def scene(cell):
        cell.inject("reports_lost", probability=0.3, seed=5)
        return [bool(await cell.send("?")) for _ in range(30)]

    first = play(scene)
    assert first == play(scene)
    assert 12 <= sum(first) <= 27


def test_so_many_reports_get_lost_and_then_none(play):
    async def scene(cell):
        cell.inject("reports_lost", probability=1.0, count=3)
        return [await cell.send("?G21\n") for _ in range(5)]

    said = play(scene)
    assert said[:3] == [b"ok\r\n"] * 3  # answers are no reports
    assert all(b"<Idle" in one for one in said[3:])


def test_reports_of_a_newer_firmware_carry_more_fields(play):
    async def scene(cell):
        cell.inject("reports_extended")
        return await cell.send("?")

    report = parse_status(play(scene).decode().strip())
    assert report is not None
    assert report.state == "Idle"
    assert len(report.unknown_fields) >= 2


def test_a_reset_takes_an_open_question_with_it(play):
    async def scene(cell):
        cell.inject("reports_slow", look_s=0.05)
        answered = await cell.send("?", then_s=0.1)
        return answered, await cell.send("?\x18", then_s=0.2), await cell.send("?", then_s=0.1)

    answered, swallowed, after = play(scene)
    assert b"<Idle" in answered
    assert b"<" not in swallowed
    assert b"for help]" in swallowed
    assert b"<Idle" in after
