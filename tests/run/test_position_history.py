"""Which positions of a controller without homing are believed, by the journal of its machine."""

from __future__ import annotations

import pytest

from lmctl.run.journal.position_history import read_position_history

LEFT = [10.0, 10.0, 20.0]
WAY = [[0.0, 0.0, 5.0], [0.0, 0.0, 10.0], [10.0, 10.0, 10.0], [10.0, 10.0, 20.0]]


def act(do, **more):
    return {"kind": "act", "do": do, **more}


def ended(do, at=LEFT, lost="", **more):
    fields = {"machine_mm": at, "trusted": not lost, "seen": True, **more}
    return {"kind": "ended", "do": do, **fields, **({"lost": lost} if lost else {})}


def run(name="run-0001", **more):
    return act("run", run=name, from_mm=WAY[0], way_mm=WAY, **more)


def touched_off(*axes, at=LEFT, lost="it restarted"):
    return [act("offset", axes=dict.fromkeys(axes, 0.0), here=True), ended("offset", at, lost)]


LOST_IN_RUN = [run(), ended("run", [0.0, 0.0, 0.0], "it restarted")]

BELIEVED = {
    "never seen before": ([], [3.0, 4.0, 5.0]),
    "where a run left it": ([run(), ended("run")], LEFT),
    "where a jog left it": ([act("jog"), ended("jog")], LEFT),
    "at zero, where it was left": ([act("jog"), ended("jog", [0.0] * 3)], [0.0] * 3),
    "after a command that never reached it": (
        [act("jog"), ended("jog"), act("jog"), {"kind": "ended", "do": "jog", "why": "silent"}],
        LEFT),
    "where a killed run began": ([run()], WAY[0]),
    "on the way of a killed run to the purge position": ([run()], [5.0, 5.0, 10.0]),
    "at the purge position of a killed run": ([run()], LEFT),
    "unmoved by a killed command": ([act("jog"), ended("jog"), act("settings")], LEFT),
    "touched off on every axis": ([*LOST_IN_RUN, *touched_off("X", "Y", "Z")], LEFT),
    "touched off axis by axis, with a jog between": (
        [*LOST_IN_RUN, *touched_off("X"), act("jog"), ended("jog", lost="it restarted"),
         *touched_off("Y", "Z")], LEFT),
    "recovered by its operator's word": (
        [*LOST_IN_RUN, run("run-0002"), ended("run", [7.0, 8.0, 9.0])], [7.0, 8.0, 9.0]),
}

NOT_BELIEVED = {
    "lost in the last run": (LOST_IN_RUN, LEFT, "it restarted"),
    "lost, and jogged since": (
        [*LOST_IN_RUN, act("jog"), ended("jog", lost="it restarted")], LEFT, "it restarted"),
    "lost, and touched off on two axes": (
        [*LOST_IN_RUN, *touched_off("X", "Y")], LEFT, "it restarted"),
    "lost, and program zero set by numbers": (
        [*LOST_IN_RUN, act("offset", axes={"X": 0.0, "Y": 0.0, "Z": 0.0}, here=False),
         ended("offset", lost="it restarted")], LEFT, "it restarted"),
    "lost, and a touch-off that failed": (
        [*LOST_IN_RUN, act("offset", axes={"X": 0.0, "Y": 0.0, "Z": 0.0}, here=True),
         ended("offset", lost="it restarted", why="error 9")], LEFT, "it restarted"),
    "lost again after a touch-off": (
        [*LOST_IN_RUN, *touched_off("X", "Y", "Z"), act("jog"), ended("jog", lost="an alarm")],
        LEFT, "an alarm"),
    "lost, and then silent": (
        [*LOST_IN_RUN, act("jog"), {"kind": "ended", "do": "jog", "why": "silent"}],
        LEFT, "it restarted"),
    "switched off and on": ([run(), ended("run")], [0.0] * 3, "switched off and on"),
    "moved by another program": (
        [run(), ended("run")], [10.0, 10.0, 20.5], "was left at X10.000 Y10.000 Z20.000"),
    "switched off and on after a killed run": ([run()], [0.0] * 3, "switched off and on"),
    "off the way of a killed run": ([run()], [30.0, 5.0, 1.0], "run-0001 was broken off"),
    "moved by a killed jog": ([act("jog"), ended("jog"), act("jog")], [11.0, 10.0, 20.0],
                              "`lmctl machine jog` was broken off"),
    "after a killed run, a command that never reached it": (
        [run(), act("jog"), {"kind": "ended", "do": "jog", "why": "silent"}], [30.0, 5.0, 1.0],
        "run-0001 was broken off"),
}


@pytest.mark.parametrize("case", BELIEVED)
def test_a_position_that_the_journal_explains_is_believed(case):
    records, at_mm = BELIEVED[case]
    assert read_position_history(records).why_lost(at_mm) == ""


@pytest.mark.parametrize("case", NOT_BELIEVED)
def test_a_position_that_it_does_not_explain_is_lost_and_why_is_said(case):
    records, at_mm, why = NOT_BELIEVED[case]
    assert why in read_position_history(records).why_lost(at_mm)


def test_a_run_after_the_touch_off_needs_one_of_its_own():
    stated = read_position_history([*LOST_IN_RUN, *touched_off("X", "Y", "Z")])
    assert stated.is_stated_since_run
    later = read_position_history(
        [*LOST_IN_RUN, *touched_off("X", "Y", "Z"), run("run-0002"), ended("run")])
    assert not later.is_stated_since_run
