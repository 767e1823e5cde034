"""Holds, doors, resets, jogs and locks of the simulated controller."""

from __future__ import annotations

import numpy as np
import pytest

from tests.simulators.motion_cases import BOTH, LEAD_S, START, beam

UNLOCK = "[MSG:'$H'|'$X' to unlock]"


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
def test_the_door_stops_everything_and_opens_the_way_only_when_shut(rig, dialect):
    controller = rig(dialect)
    controller.ask(START[dialect] + "M8\nG1 X60 F1200\n", 0.5)
    controller.machine.advance_to(controller.now_s)
    opened = controller.controller.set_door(True, controller.now_s)
    assert opened == b"[MSG:Check Door]\r\n"
    report = controller.status()
    assert (report.state, report.substate, report.active_pins) == ("Door", 2, "D")
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
