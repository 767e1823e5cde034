"""The controller as a host sees it: answers, states, real-time bytes, and what the beam did."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.status import parse_status
from simulators.motion.config import MotionConfig
from simulators.motion.controller import Controller
from simulators.motion.settings import SettingError

BOTH = pytest.mark.parametrize("dialect", ["grbl", "grblhal"])
START = {"grbl": "G21 G90 G94\nM4 S600\n", "grblhal": "G21 G90 G94\nM4 S600\n"}
LEAD_S = {"grbl": 0.05, "grblhal": 0.09}
UNLOCK = "[MSG:'$H'|'$X' to unlock]"


def beam(rig, times_s):
    rig.machine.stepper.commit()
    return rig.trace.sample(times_s).power_fraction


@BOTH
def test_ok_means_planned_and_a_full_planner_answers_no_more(rig, dialect):
    controller = rig(dialect, planner_blocks=15)
    lines = "".join(f"G1 X{x} F600\n" for x in range(1, 19))
    assert len(lines) > 127
    said = controller.send(lines[:120])
    count = lines[:120].count("\n")
    assert said == ["ok"] * count
    for line in [*lines[120:].splitlines(keepends=True), "G1 X19\n", "G1 X20\n"]:
        said += controller.send(line)
    assert len(said) == 15
    report = controller.status()
    assert (report.blocks_free, report.state) == (0, "Run")
    assert report.rx_free < (128 if dialect == "grbl" else 1023)
    assert controller.wait(0.2 - LEAD_S[dialect] - 0.1) == []
    assert controller.wait(0.1) == ["ok"]
    assert controller.status().blocks_free == 0
    said += controller.wait(60.0)
    assert controller.machine.position_mm() == (20.0, 0.0, 0.0)


@BOTH
def test_every_line_earns_one_answer_in_order(rig, dialect):
    controller = rig(dialect)
    said = controller.ask("G1 X1 F600\n\n(remark)\n$G\nG4 P0.1\nM3 S5\nG0 X0\n", 20.0)
    assert [line for line in said if line != "ok"] == [
        line for line in said if line.startswith("[GC:")
    ]
    assert said.count("ok") == 7


def test_grbl_runs_on_after_an_error_and_grblhal_does_not(rig):
    lines = "G1 X1 F600\nG1 X2 Q\nG1 X3\nG1 X4\n"
    assert rig("grbl").ask(lines, 5.0) == ["ok", "error:2", "ok", "ok"]
    controller = rig("grblhal")
    assert controller.ask(lines, 5.0) == ["ok", "error:2", "error:2", "error:2"]
    assert controller.machine.position_mm() == (1.0, 0.0, 0.0)
    for cure in ("\n", "$G\n", "\x18"):
        controller.ask("FOO\n", 0.1)
        controller.ask(cure, 0.1)
        assert controller.ask("G0 X5\n", 0.1) == ["ok"]


@BOTH
def test_an_overrun_is_lost_and_counted(rig, dialect):
    controller = rig(dialect, planner_blocks=2)
    controller.send("G1 X1 F60\nG1 X2\nG1 X3\n")
    for _ in range(60):
        controller.send("G1 X4.000 Y1.000 (filler)\n")
    assert controller.controller.device.overruns > 0


@BOTH
def test_too_long_a_line_is_refused_and_not_executed(rig, dialect):
    controller = rig(dialect)
    assert controller.ask("G0 X" + "0" * 300 + "9\n", 1.0) == ["error:11"]
    assert controller.machine.position_mm() == (0.0, 0.0, 0.0)


@BOTH
def test_hold_brakes_and_the_beam_goes_down_with_the_motion(rig, dialect):
    controller = rig(dialect)
    controller.ask(START[dialect] + "G1 X60 F1200\n", 1.0)
    controller.send("!")
    report = controller.status()
    assert (report.state, report.substate) == ("Hold", 1)
    controller.wait(LEAD_S[dialect] + 0.041)
    report = controller.status()
    assert (report.state, report.substate) == ("Hold", 0)
    where = 0.4 + 0.96 * 20 + LEAD_S[dialect] * 20 + 0.4
    assert report.machine_mm[0] == pytest.approx(where, abs=0.004)
    t = np.linspace(1.0, 1.3, 1000)
    sample = controller.trace.sample(t)
    assert sample.power_fraction == pytest.approx(0.6 * sample.speed_mm_s / 20.0)
    assert sample.power_fraction[-1] == 0.0
    assert controller.ask("G1 X61\n", 5.0) == []  # no line is read in a hold
    expected = ["[MSG:Restoring spindle]"] + (["[MSG:]"] if dialect == "grblhal" else []) + ["ok"]
    assert controller.ask("~", 10.0) == expected
    assert controller.status().state == "Idle"
    assert controller.machine.position_mm() == (61.0, 0.0, 0.0)


@BOTH
def test_a_start_in_the_midst_of_a_hold_is_ignored(rig, dialect):
    controller = rig(dialect)
    controller.ask("G1 X60 F1200\n", 0.5)
    controller.send("!")
    controller.send("~")
    controller.wait(1.0)
    assert controller.status().state == "Hold"


@BOTH
def test_cancel_out_of_a_hold_keeps_the_position_and_raises_no_alarm(rig, dialect):
    controller = rig(dialect)
    controller.ask("G1 X60 F1200\nG1 X0\n", 0.5)
    controller.ask("!", 1.0)
    where = controller.status().machine_mm
    said = controller.ask("\x18", 0.1)
    assert said == ["", controller.controller.dialect.banner]
    report = controller.status()
    assert (report.state, report.machine_mm) == ("Idle", where)
    controller.ask("G91\nG1 X1 F600\n", 2.0)
    assert controller.machine.position_mm()[0] == pytest.approx(where[0] + 1.0)


def test_a_reset_in_motion_is_an_alarm_in_grbl(rig):
    controller = rig("grbl")
    controller.ask("M4 S600\nG1 X60 F1200\n", 0.5)
    said = controller.ask("\x18", 0.1)
    assert said == ["ALARM:3", "", "Grbl 1.1h ['$' for help]", UNLOCK]
    assert controller.ask("G0 X0\n", 0.1) == ["error:9"]
    assert controller.ask("$X\n", 0.1) == ["[MSG:Caution: Unlocked]", "ok"]
    assert controller.ask("G0 X0\n", 5.0) == ["ok"]
    assert beam(controller, np.linspace(0.51, 0.7, 50)).max() == 0.0


def test_a_reset_in_motion_leaves_grblhal_idle(rig):
    controller = rig("grblhal")
    controller.ask("G1 X60 F1200\n", 0.5)
    assert controller.ask("\x18", 0.1) == ["", "GrblHAL 1.1f ['$' or '$HELP' for help]"]
    assert controller.status().state == "Idle"


@BOTH
def test_a_line_that_waits_is_answered_before_the_banner(rig, dialect):
    controller = rig(dialect)
    controller.ask("G1 X5 F600\nG4 P10\n", 2.0)
    said = controller.ask("\x18", 0.1)
    assert said[0] == "ok"
    assert said[2] == controller.controller.dialect.banner


@BOTH
def test_a_reset_restores_modes_and_overrides(rig, dialect):
    controller = rig(dialect)
    controller.ask("G20 G91 G55 M3 S5\nM8\nG92 X5\n\x91\x9b\x97", 1.0)
    controller.ask("\x18", 0.1)
    modes, _ = controller.ask("$G\n", 0.1)
    assert modes.startswith("[GC:G0 G54 G17 G21 G90 G94 ")
    assert " M5 M9 " in modes
    assert controller.machine.overrides == (100, 100, 100)
    assert controller.controller.interpreter.work_offset_mm == (0.0, 0.0, 0.0)


@BOTH
def test_overrides_are_summed_and_clipped(rig, dialect):
    controller = rig(dialect)
    controller.ask("M4 S600\nG1 X600 F1200\n", 0.5)
    controller.send("\x91\x91\x93\x9b\x96")
    controller.wait(0.5)
    assert controller.overrides() == (121, 50, 90)
    report = controller.status()
    assert (round(report.feed_mm_min), round(report.spindle)) == (1452, 653)
    controller.send("\x91" * 20 + "\x9b" * 20)
    assert controller.overrides() == (200, 50, 10)
    controller.send("\x92" * 30 + "\x9a" * 30 + "\x95")
    assert controller.overrides() == (10, 100, 200)
    controller.send("\x90\x99\x94\x9c")
    assert controller.overrides() == (99, 100, 101)


@BOTH
def test_the_door_stops_everything_and_opens_the_way_only_when_shut(rig, dialect):
    controller = rig(dialect)
    controller.ask(START[dialect] + "M8\nG1 X60 F1200\n", 0.5)
    controller.machine.settle(controller.now_s)
    opened = controller.controller.set_door(True, controller.now_s)
    assert opened == b"[MSG:Check Door]\r\n"
    report = controller.status()
    assert (report.state, report.substate, report.pins) == ("Door", 2, "D")
    controller.wait(0.5)
    report = controller.status()
    assert (report.state, report.substate) == ("Door", 1)
    assert controller.machine.accessories.letters() == ""
    controller.ask("~", 5.0)
    assert controller.status().state == "Door"
    controller.controller.set_door(False, controller.now_s)
    assert controller.status().substate == 0
    controller.send("~")
    assert controller.status().substate == 3  # coolant first
    controller.wait(0.99)
    assert controller.status().state == "Door"
    controller.wait(0.02)
    assert controller.status().state == "Run"
    controller.wait(10.0)
    assert controller.machine.position_mm() == (60.0, 0.0, 0.0)
    assert controller.machine.accessories.letters().endswith("F")


@BOTH
def test_jogging_and_its_cancellation(rig, dialect):
    controller = rig(dialect)
    assert controller.ask("$J=G91 X20 F1000\n", 0.3) == ["ok"]
    assert controller.status().state == "Jog"
    assert controller.ask("G0 X1\n", 0.0) == ["error:9"]
    controller.ask("\n", 0.0)
    controller.send("\x85")
    controller.wait(0.5)
    report = controller.status()
    assert report.state == "Idle"
    assert 5.0 < report.machine_mm[0] < 8.0
    assert controller.ask("G91\nG0 X1\n", 2.0) == ["ok", "ok"]
    assert controller.machine.position_mm()[0] == pytest.approx(report.machine_mm[0] + 1.0)
    assert controller.ask("$J=X1\n", 0.0) == ["error:22"]


@BOTH
def test_soft_limits_lock_until_a_reset(rig, dialect):
    controller = rig(dialect, settings={22: 1, 20: 1})
    said = controller.ask("$X\n$H\n", 120.0)
    assert said[-1] == "ok"
    assert controller.status().machine_mm == (-1.0, -1.0, -1.0)
    controller.ask("G90\nG1 X-100 F6000\n", 0.5)
    said = controller.ask("G1 X5 F600\n", 3.0)
    assert said == ["ALARM:2", "[MSG:Reset to continue]"]
    assert controller.ask("$X\n", 0.1) == []
    position = controller.machine.position_mm()
    assert controller.ask("\x18", 0.1) == ["ok", "", controller.controller.dialect.banner, UNLOCK]
    assert controller.ask("$X\n", 0.1) == ["[MSG:Caution: Unlocked]", "ok"]
    assert controller.machine.position_mm() == position
    assert controller.ask("$J=G90 X5 F100\n", 0.1) == ["error:15"]


def test_grblhal_minds_soft_limits_only_when_homed(rig):
    controller = rig("grblhal", settings={22: 1, 20: 1})
    assert controller.ask("G1 X5 F600\n", 3.0) == ["ok"]


def test_grbl_is_locked_until_homed_and_answers_homing_when_it_is_done(rig):
    controller = rig("grbl", settings={22: 1})
    assert controller.ask("G0 X1\n", 0.1) == ["error:9"]
    assert controller.ask("$H\n", 0.2) == []
    assert controller.status().state == "Home"
    assert controller.ask("", 60.0) == ["ok"]
    assert controller.status().state == "Idle"
    assert rig("grbl").ask("$H\n", 0.1) == ["error:5"]


@BOTH
def test_check_mode_parses_and_does_not_move(rig, dialect):
    controller = rig(dialect)
    assert controller.ask("$C\n", 0.1) == ["[MSG:Enabled]", "ok"]
    assert controller.ask("G1 X10 F600\nM4 S5\nG4 P9\n", 0.1) == ["ok", "ok", "ok"]
    assert controller.status().state == "Check"
    assert controller.ask("$C\n", 0.1)[:2] == ["[MSG:Disabled]", "ok"]
    assert controller.machine.position_mm() == (0.0, 0.0, 0.0)


@BOTH
def test_a_program_pause_waits_for_a_start(rig, dialect):
    controller = rig(dialect)
    assert controller.ask("G1 X5 F600\nM0\nG1 X0\n", 5.0) == ["ok"]
    assert controller.status().state == "Hold"
    assert controller.ask("~", 5.0).count("ok") == 2
    assert controller.machine.position_mm() == (0.0, 0.0, 0.0)


@BOTH
def test_dwell_and_spindle_wait_for_the_planned_motion(rig, dialect):
    controller = rig(dialect)
    controller.send("G1 X10 F600\nG4 P0.5\nM3 S100\n")
    assert controller.wait(1.019) == []
    assert controller.wait(0.5) == []
    assert controller.wait(0.01) == ["ok", "ok"]


@BOTH
def test_the_beam_burns_only_in_motion_under_m4(rig, dialect):
    controller = rig(dialect)
    controller.ask(START[dialect] + "G1 X5 F1200\nG0 Y5\nG4 P0.3\nG1 X0\n", 10.0)
    t = np.linspace(0.0, 5.0, 20001)
    sample = controller.trace.sample(t)
    lit = sample.power_fraction > 0.0
    assert lit.any()
    assert (sample.speed_mm_s[lit] > 0.0).all()
    assert (controller.trace.blocks().beam[sample.block[lit]] > 0).all()


@BOTH
def test_m3_keeps_burning_when_motion_starves(rig, dialect):
    controller = rig(dialect)
    controller.ask("M3 S600\nG1 X5 F1200\n", 10.0)
    assert beam(controller, [5.0, 9.9]).tolist() == [0.6, 0.6]
    controller.ask("!", 1.0)
    controller.ask("~", 1.0)
    assert beam(controller, [10.5, 11.5]).tolist() == [0.0, 0.6]
    controller.ask("M5\n", 1.0)
    assert beam(controller, [12.5]).tolist() == [0.0]


@BOTH
def test_without_laser_mode_m4_burns_at_standstill(rig, dialect):
    controller = rig(dialect, settings={32: 0})
    controller.ask("M4 S600\n", 5.0)
    assert beam(controller, [4.0]).tolist() == [0.6]
    controller.ask("\x18", 1.0)
    assert beam(controller, [4.0, 5.5]).tolist() == [0.6, 0.0]


def test_outputs_of_grblhal_switch_with_the_next_motion(rig):
    controller = rig("grblhal")
    controller.ask("G1 X10 F600\n", 5.0)
    controller.ask("M63 P0\n", 5.0)
    assert controller.trace.outputs == []
    controller.ask("G0 X20\n", 5.0)
    ((when, *what),) = controller.trace.outputs
    assert (when, what) == (10.0, ["D", 0, 0.0])


def test_grbl_never_reports_line_numbers_and_grblhal_keeps_the_last(rig):
    for dialect, expected in (("grbl", [None, None]), ("grblhal", [120, 130])):
        controller = rig(dialect)
        controller.ask("N120 G1 X10 F600\nN130 G1 X0\n", 0.5)
        first = controller.status().line_number
        controller.wait(10.0)
        assert [first, controller.status().line_number] == expected


@BOTH
def test_a_block_leaves_the_planner_before_its_motion_is_over(rig, dialect):
    controller = rig(dialect)
    blocks = controller.controller.machine.planner.capacity
    controller.ask("G1 X2 F600\n", 0.22 - LEAD_S[dialect] / 2)
    report = controller.status()
    assert (report.state, report.blocks_free) == ("Run", blocks)
    assert report.machine_mm[0] < 2.0


@BOTH
def test_the_work_offset_is_reported_when_it_changes(rig, dialect):
    controller = rig(dialect)
    for _ in range(3):
        controller.status()
    controller.ask("G92 X5 Y-1\n", 0.1)
    assert controller.status().offset_mm == (-5.0, 1.0, 0.0)
    assert controller.status().offset_mm is None


@BOTH
def test_work_position_is_reported_where_the_mask_says_so(rig, dialect):
    controller = rig(dialect, settings={10: 2})
    controller.ask("G92 X5\n", 0.1)
    report = controller.status()
    assert (report.machine_mm, report.work_mm) == (None, (5.0, 0.0, 0.0))


@BOTH
def test_stored_lines_run_after_a_reset(rig, dialect):
    controller = rig(dialect)
    assert controller.ask("$N0=G20\n", 0.1) == ["ok"]
    assert controller.ask("$N\n", 0.1) == ["$N0=G20", "$N1=", "ok"]
    assert controller.ask("\x18", 0.1)[-1] == ">G20:ok"
    assert " G20 " in controller.ask("$G\n", 0.1)[0]


@BOTH
def test_settings_are_checked_kept_and_used(rig, dialect):
    controller = rig(dialect)
    assert controller.ask("$110=600\n$100=0\n$9999=1\n$0=1\n", 0.1) == [
        "ok",
        "error:52" if dialect == "grblhal" else "error:4",
        "error:3",
        "error:6",
    ]
    assert "$110=600.000" in controller.ask("$$\n", 0.1)
    controller.ask("\nG1 X10 F6000\n", 0.5)
    assert controller.status().feed_mm_min == pytest.approx(600.0)
    assert controller.ask("$110=6000\n", 0.1) == ["error:8"]


@BOTH
def test_sleep_is_left_by_a_reset_only(rig, dialect):
    controller = rig(dialect)
    if dialect == "grblhal":
        assert controller.ask("$SLP\n", 0.1) == ["error:3"]
        return
    assert controller.ask("$SLP\n", 0.1) == ["ok", "[MSG:Sleeping]"]
    assert controller.ask("G0 X1\n$X\n", 1.0) == []
    assert controller.ask("\x18", 0.1)[-1] == UNLOCK


def test_stop_of_grblhal_keeps_everything_but_the_motion(rig):
    controller = rig("grblhal")
    controller.ask("G92 X5\nM4 S600\nG1 X60 F1200\n", 0.5)
    assert controller.ask("\x19", 0.1) == []
    assert controller.status().state == "Idle"
    assert controller.machine.position_mm()[0] < 60.0
    assert beam(controller, [0.55]).tolist() == [0.0]


def test_the_user_info_tells_a_bench(rig):
    assert "[VER:1.1f.20260817:lmctl-bench]" in rig("grblhal").ask("$I\n", 0.1)
    assert "[VER:1.1h.20190830:lmctl-bench]" in rig("grbl").ask("$I\n", 0.1)
    assert "[OPT:V,20,256]" in rig("grbl", planner_blocks=20, rx_bytes=256).ask("$I\n", 0.1)


def test_a_wrong_configuration_is_refused():
    with pytest.raises(ValueError, match=r"unknown dialect 'marlin'; known: grbl, grblhal"):
        Controller(MotionConfig(dialect="marlin"))
    with pytest.raises(SettingError, match=r"\$20: error:10"):
        Controller(MotionConfig(dialect="grbl", settings={20: 1}))


REALTIME = [bytes([b]) for b in b"?!~?!~\x84\x85\x91\x92\x96\x9b\x9e\xa0\x87\x18"]
LINES = [
    b"G1 X10 F1200 S500\n", b"G0 Y3\n", b"M4 S600\n", b"M3\n", b"M5\n", b"G4 P0.2\n", b"\n",
    b"$J=G91 X3 F600\n", b"$G\n", b"$X\n", b"$C\n", b"G2 X5 Y5 R4\n", b"FOO\n", b"G28\n", b"M8\n",
    b"G1 X0.1 F60\n", b"M0\n", b"M62 P1\n", b"N7 G1 Z1 F900\n", b"$H\n", b"$10=3\n", b"M30\n",
]  # fmt: skip
STEPS = st.lists(
    st.tuples(st.sampled_from(LINES + LINES + REALTIME), st.sampled_from([0.0, 0.01, 0.2, 3.0])),
    max_size=30,
)


@BOTH
@settings(deadline=None, max_examples=60)
@given(steps=STEPS)
def test_whatever_is_sent_it_says_only_what_a_controller_says(rig, dialect, steps):
    controller = rig(dialect, planner_blocks=4)
    said = []
    for data, wait in steps:
        said += controller.send(data) + controller.wait(wait)
    said += controller.wait(1000.0)
    for line in said:
        known = ("ok", "error:", "ALARM:", "[", "Grbl", "$")
        assert line == "" or line.startswith(known) or parse_status(line) is not None
    answers = sum(line == "ok" or line.startswith("error:") for line in said)
    assert answers <= sum(data.endswith(b"\n") for data, _ in steps)
    assert controller.controller.next_wake_s() is None
    t = np.linspace(0.0, controller.now_s, 5000)
    controller.machine.stepper.commit()
    speed = controller.trace.sample(t).speed_mm_s
    assert speed.min() >= 0.0
    assert speed.max() <= 100.0 * 3**0.5 + 1e-6
    ends = controller.trace.blocks().end_mm
    if len(ends):
        assert controller.machine.position_mm() == pytest.approx(tuple(ends[-1]), abs=0.003)


@BOTH
def test_a_setting_written_behind_a_planned_move_loses_neither(rig, dialect):
    controller = rig(dialect)
    controller.ask("G1 X5 F600\n$100=125\nG1 X10\n", 5.0)
    assert controller.machine.position_mm() == (10.0, 0.0, 0.0)
    assert len(controller.trace.blocks().line) == 2
