"""Overrides, beam modes, outputs, dwells, stored lines and settings of the simulated controller."""

from __future__ import annotations

import numpy as np
import pytest

from tests.simulators.motion_cases import BOTH, START, beam


@BOTH
def test_overrides_are_summed_and_clipped(rig, dialect):
    controller = rig(dialect)
    controller.ask("M4 S600\nG1 X600 F1200\n", 0.5)
    controller.send("\x91\x91\x93\x9b\x96")
    controller.wait(0.5)
    assert controller.overrides() == (121, 50, 90)
    report = controller.status()
    assert (round(report.feed_mm_min), round(report.spindle_speed)) == (1452, 653)
    controller.send("\x91" * 20 + "\x9b" * 20)
    assert controller.overrides() == (200, 50, 10)
    controller.send("\x92" * 30 + "\x9a" * 30 + "\x95")
    assert controller.overrides() == (10, 100, 200)
    controller.send("\x90\x99\x94\x9c")
    assert controller.overrides() == (99, 100, 101)


@BOTH
def test_under_m4_every_report_shows_the_power_of_its_speed_between_short_lines_too(rig, dialect):
    controller = rig(dialect)
    controller.ask(START[dialect] + "G1 F600\n", 0.1)
    controller.ask("".join(f"X{0.1 * n:.1f}\n" for n in range(1, 25)), 0.02)
    said = []
    for _ in range(120):
        controller.wait(0.002)
        report = controller.status()
        said.append((report.feed_mm_min, report.spindle_speed))
    assert said.count((600.0, 600.0)) > 20
    assert all(feed == power for feed, power in said)


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
def test_the_beam_is_on_only_in_motion_under_m4(rig, dialect):
    controller = rig(dialect)
    controller.ask(START[dialect] + "G1 X5 F1200\nG0 Y5\nG4 P0.3\nG1 X0\n", 10.0)
    t = np.linspace(0.0, 5.0, 20001)
    sample = controller.trace.sample(t)
    beam_on = sample.power_fraction > 0.0
    assert beam_on.any()
    assert (sample.speed_mm_s[beam_on] > 0.0).all()
    assert (controller.trace.blocks().beam[sample.block[beam_on]] > 0).all()


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
def test_without_laser_mode_m4_is_on_at_standstill(rig, dialect):
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
def test_a_setting_written_behind_a_planned_move_loses_neither(rig, dialect):
    controller = rig(dialect)
    controller.ask("G1 X5 F600\n$100=125\nG1 X10\n", 5.0)
    assert controller.machine.position_mm() == (10.0, 0.0, 0.0)
    assert len(controller.trace.blocks().line) == 2
