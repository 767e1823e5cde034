"""Lines of G-code to actions and error numbers."""

from itertools import pairwise
from math import hypot, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.dialect import GRBL, GRBLHAL
from firmware_protocol.gcode import GcodeError
from simulators.motion.actions import (
    BEAM_CONSTANT,
    BEAM_DYNAMIC,
    BEAM_OFF,
    Dwell,
    ProbeFailure,
    ProgramEnd,
    ProgramPause,
    ReadInput,
    SetCoolant,
    SetOutput,
    SetSpindle,
    StraightMove,
    ToolChange,
)
from simulators.motion.interpreter import GcodeInterpreter
from simulators.motion.reports import parser_state_line
from simulators.motion.settings import FirmwareSettings

DIALECTS = {"grbl": GRBL, "grblhal": GRBLHAL}
BOTH = pytest.mark.parametrize("name", ["grbl", "grblhal"])


def make(name="grblhal", **settings):
    values = {32: 1, 30: 1000} | {int(key.strip("s")): value for key, value in settings.items()}
    return GcodeInterpreter(DIALECTS[name], FirmwareSettings(DIALECTS[name], values))


def run(interpreter, *lines):
    """The actions of all lines."""
    return [action for line in lines for action in interpreter.interpret(line.encode("latin-1"))]


def targets(actions):
    return [action.target_mm for action in actions if isinstance(action, StraightMove)]


def refusal(interpreter, line):
    with pytest.raises(GcodeError) as refused:
        interpreter.interpret(line.encode("latin-1"))
    return refused.value.code


@pytest.mark.parametrize(
    ("line", "grbl", "grblhal"),
    [
        ("G1 X1", 22, 22),  # no feed yet
        ("G1", 22, 22),
        ("N10000001 G0 X1", 27, 27),
        ("G0 X1 X2", 25, 25),
        ("G0 G1 X1", 24, 24),
        ("G90 G91", 21, 21),
        ("M3 M4", 21, 21),
        ("M3.5", 23, 23),
        ("G1.5 X1", 20, 20),
        ("G77", 20, 20),
        ("M99", 20, 20),
        ("A1", 20, 20),
        ("F-1", 4, 4),
        ("G4", 28, 28),
        ("G0 X1 P3", 36, 36),
        ("G80 X1", 31, 31),
        ("G2 X1 I1 F100 G53", 30, 30),
        ("G2 F100", 26, 26),
        ("G2 Z1 I1 F100", 32, 32),
        ("G2 X1 F100", 35, 35),
        ("G2 X10 I1 F100", 33, 33),
        ("G2 X10 R1 F100", 34, 34),
        ("G2 X0 R1 F100", 33, 33),
        ("G10 P1 L2", 26, 26),
        ("G10 X1", 28, 28),
        ("G10 L3 P1 X1", 20, 20),
        ("G10 L2 P7 X1", 29, None),
        ("G10 L2 P10 X1", 29, 29),
        ("G92", 26, 26),
        ("G43.1 X1", 37, 37),
        ("G38.2 F100", 26, 26),
        ("G38.2 X0 F100", 33, 33),
        ("G59.1", 20, None),
        ("G99", 20, None),
        ("G5 X1 F100", 20, 28),
        ("M7", 20, None),
        ("M6 T1", 20, None),
        ("M62 P0", 20, None),
        ("M62", 20, 28),
        ("M64 P8", 20, 39),
        ("M67 E0 Q1", 20, None),
        ("M67 Q1", 20, 28),
        ("M68 E4 Q1", 20, 44),
        ("M66 L0", 20, 28),
        ("M66 P9 L0", 20, 39),
        ("M66 P0 L3", 20, 28),
    ],
)
def test_what_is_refused_and_how(line, grbl, grblhal):
    for name, code in (("grbl", grbl), ("grblhal", grblhal)):
        interpreter = make(name)
        if code is None:
            run(interpreter, line)
        else:
            assert refusal(interpreter, line) == code


@BOTH
def test_a_refused_line_changes_nothing(name):
    interpreter = make(name)
    run(interpreter, "G1 X1 F600 S100", "M4")
    before = parser_state_line(interpreter.dialect, interpreter)
    for line in ("G91 G20 G18 X1 X2", "G92", "G2 X1 M5 S3 F1", "G10 L2 P1", "M3 G4"):
        refusal(interpreter, line)
        assert parser_state_line(interpreter.dialect, interpreter) == before
        assert interpreter.position_mm == (1.0, 0.0, 0.0)


@BOTH
def test_nothing_but_comments_and_spaces_is_nothing_to_do(name):
    assert run(make(name), "", "  ", "(remark)", "; remark", "/") == []


@BOTH
def test_units_distance_mode_and_offsets(name):
    interpreter = make(name)
    actions = run(
        interpreter,
        "G0 X10 Y20",
        "G91 X1 Z-2",
        "G90 G20 X1",
        "G21 G10 L2 P2 X100 Y50 Z10",
        "G55 X0 Y0 Z0",
        "G53 G0 X0",
        "G92 X5",
        "X6",
        "G92.1 X0",
        "G43.1 Z3",
        "Z0",
        "G49 Z7",
        "Z0",
    )
    assert targets(actions) == [
        (10.0, 20.0, 0.0),
        (11.0, 20.0, -2.0),
        (25.4, 20.0, -2.0),
        (100.0, 50.0, 10.0),
        (0.0, 50.0, 10.0),
        (1.0, 50.0, 10.0),
        (-5.0, 50.0, 10.0),  # the target was worked out before the offset went
        (-5.0, 50.0, 13.0),
        (-5.0, 50.0, 10.0),
    ]


@BOTH
def test_g10_l20_makes_the_position_what_it_says(name):
    interpreter = make(name)
    run(interpreter, "G0 X10 Y20 Z30", "G10 L20 P1 X1 Y2")
    assert interpreter.work_offset_mm == (9.0, 18.0, 0.0)
    assert targets(run(interpreter, "G0 X1 Y2")) == [(10.0, 20.0, 30.0)]


@BOTH
def test_g28_goes_by_way_of_its_words_to_the_stored_position(name):
    interpreter = make(name)
    run(interpreter, "G0 X1 Y2 Z3", "G28.1", "G0 X50")
    first, second = run(interpreter, "G91 G28 Z10")
    assert (first.target_mm, second.target_mm) == ((50.0, 2.0, 13.0), (1.0, 2.0, 3.0))
    assert first.rapid
    assert second.rapid


@BOTH
def test_feeds_are_per_minute_and_kept(name):
    interpreter = make(name)
    slow, same, inches, inverse = run(
        interpreter, "G1 X1 F600", "X2", "G20 G1 X1 F10", "G21 G93 G1 X35.4 F3"
    )
    assert (slow.rate_mm_s, same.rate_mm_s) == (10.0, 10.0)
    assert inches.rate_mm_s == pytest.approx(10 * 25.4 / 60)
    assert inverse.rate_mm_s == pytest.approx(10.0 * 3 / 60)  # 10 mm in a third of a minute


@BOTH
@pytest.mark.parametrize(
    ("line", "centre", "length"),
    [
        ("G2 X10 Y0 I5", (5.0, 0.0), 5 * pi),
        ("G3 X10 Y0 I5", (5.0, 0.0), 5 * pi),
        ("G2 X0 Y0 I5", (5.0, 0.0), 10 * pi),
        ("G3 X5 Y5 R5", (0.0, 5.0), 2.5 * pi),
        ("G3 X5 Y5 R-5", (5.0, 0.0), 7.5 * pi),
        ("G2 X5 Y5 R5", (5.0, 0.0), 2.5 * pi),
        ("G2 X5 Y5 R-5", (0.0, 5.0), 7.5 * pi),
    ],
)
def test_arcs_are_chords_within_the_tolerance(name, line, centre, length):
    points = [(0.0, 0.0, 0.0), *targets(run(make(name), line + " F600"))]
    pairs = list(pairwise(points))
    path = sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairs)
    assert path == pytest.approx(length, rel=1e-3)
    for point in points:
        assert hypot(point[0] - centre[0], point[1] - centre[1]) == pytest.approx(5.0, abs=1e-9)
    for a, b in pairs:
        middle = hypot((a[0] + b[0]) / 2 - centre[0], (a[1] + b[1]) / 2 - centre[1])
        assert 5.0 - middle <= 0.0025  # $12 = 0.002, the number of chords rounded down


def test_an_arc_in_another_plane_is_a_helix_along_the_third_axis():
    points = targets(run(make(), "G18 G3 X10 Z0 Y4 I5 F600"))
    assert points[-1] == (10.0, 4.0, 0.0)
    middle = points[len(points) // 2 - 1]
    assert middle[1] == pytest.approx(2.0, abs=0.05)
    assert abs(middle[2]) == pytest.approx(5.0, abs=0.05)
    heights = [point[1] for point in points]
    assert heights == sorted(heights)


@BOTH
def test_the_beam_is_driven_by_m3_m4_and_never_in_g0(name):
    interpreter = make(name)
    actions = run(
        interpreter,
        "M4 S600",
        "G1 X1 F600",
        "G0 X2",
        "G1 X3 S300",
        "M3",
        "X4",
        "G0 X5",
        "M5",
        "G1 X6",
    )
    moves = [action for action in actions if isinstance(action, StraightMove)]
    assert [(move.beam, move.power) for move in moves] == [
        (BEAM_DYNAMIC, 0.6),
        (BEAM_OFF, 0.0),
        (BEAM_DYNAMIC, 0.3),
        (BEAM_CONSTANT, 0.3),
        (BEAM_OFF, 0.0),
        (BEAM_OFF, 0.0),
    ]


@BOTH
def test_only_m3_is_on_at_standstill_and_only_in_g1(name):
    interpreter = make(name)
    assert run(interpreter, "M4 S600") == [SetSpindle(4, 0.0)]
    assert run(interpreter, "M3") == [SetSpindle(3, 0.0)]  # in G0
    assert run(interpreter, "G1 F600") == [SetSpindle(3, 0.6)]
    assert run(interpreter, "S500") == [SetSpindle(3, 0.5)]
    assert run(interpreter, "G0") == [SetSpindle(3, 0.0)]


@BOTH
def test_without_laser_mode_m4_is_a_spindle_that_stays_on(name):
    interpreter = make(name, s32=0)
    actions = run(interpreter, "M4 S600", "G1 X1 F600", "G0 X2", "G1 X3 S300")
    assert actions[0] == SetSpindle(4, 0.6)
    assert [(a.beam, a.power) for a in actions if isinstance(a, StraightMove)] == [
        (BEAM_CONSTANT, 0.6),
        (BEAM_CONSTANT, 0.6),
        (BEAM_CONSTANT, 0.3),
    ]
    assert actions[3] == SetSpindle(4, 0.3)  # an S change waits for rest


@BOTH
def test_s_within_moves_needs_no_wait_in_laser_mode(name):
    interpreter = make(name)
    run(interpreter, "M4 S100", "G1 X1 F600")
    assert [type(a) for a in run(interpreter, "G1 X2 S200", "X3 S0",
                                 "G0 X4 S5")] == [StraightMove] * 3


def test_power_is_limited_and_has_a_floor():
    interpreter = make(s31=50)
    run(interpreter, "M4 S2000")
    (move,) = run(interpreter, "G1 X1 F600")
    assert (move.power, move.floor) == (1.0, 0.05)


def test_the_order_within_a_line_is_the_firmwares():
    actions = run(make(), "G1 X1 F600 M3 S100 M8 M64 P1", "G4 P0.5 X2", "M2")
    assert [type(a) for a in actions] == [
        SetSpindle,
        SetCoolant,
        SetOutput,
        StraightMove,
        Dwell,
        StraightMove,
        ProgramEnd,
    ]


def test_ports_of_grblhal():
    interpreter = make()
    assert run(interpreter, "M62 P3", "M67 E1 Q3.25") == []
    (move,) = run(interpreter, "G0 X1")
    assert move.outputs == (("D", 3, 1.0), ("A", 1, 3.0))  # an int32: the fraction is lost
    assert run(interpreter, "M65 P2", "M68 E0 Q7") == [SetOutput("D", 2, 0.0),
                                                       SetOutput("A", 0, 7.0)]
    assert run(interpreter, "M66 P0 L0", "M66 P0 L3 Q2") == [ReadInput(0.0, 0), ReadInput(2.0, -1)]
    (plain,) = run(interpreter, "G0 X2")
    assert plain.outputs == ()


def test_stops_tools_and_probes():
    interpreter = make()
    assert run(interpreter, "M0", "M1") == [ProgramPause()]  # no optional stop
    assert run(interpreter, "M6 T3") == [ToolChange()]
    assert interpreter.modal.tool == 0
    interpreter.confirm_tool_change()
    assert interpreter.modal.tool == 3
    assert run(interpreter, "G38.2 X5 F100", "G38.3 X6") == [
        StraightMove((5.0, 0.0, 0.0), 100 / 60),
        ProbeFailure(True),
        StraightMove((6.0, 0.0, 0.0), 100 / 60),
        ProbeFailure(False),
    ]


@BOTH
def test_program_end_restores_the_modes(name):
    interpreter = make(name)
    run(interpreter, "G91 G18 G55 M3 S100 F600", "M8", "M30")
    text = parser_state_line(interpreter.dialect, interpreter).text
    assert text.startswith("G1 G54 G17 G21 G90 G94 ")
    assert " M5 M9 " in text


@BOTH
def test_a_jog_keeps_the_modal_state(name):
    interpreter = make(name)
    run(interpreter, "G1 X10 F600")
    before = parser_state_line(interpreter.dialect, interpreter)
    assert interpreter.interpret_jog(b"G91 G20 X1 F10") == StraightMove((35.4, 0.0, 0.0),
                                                                        10 * 25.4 / 60)
    assert parser_state_line(interpreter.dialect, interpreter) == before


@pytest.mark.parametrize(
    ("line", "code"),
    [("X1", 22), ("F100", 26), ("G1 X1 F100", 16), ("M3 X1 F100", 16), ("X1 F0", 22)],
)
def test_what_is_no_jog(line, code):
    with pytest.raises(GcodeError) as refused:
        make().interpret_jog(line.encode())
    assert refused.value.code == code


NUMBER = st.one_of(
    st.integers(-50, 50).map(str), st.floats(-999, 999).map(lambda x: f"{x:.3f}"), st.just("")
)
WORD = st.tuples(st.sampled_from("NGXYZFSGXYFMPT"), NUMBER).map("".join)
LINE = st.lists(
    st.one_of(WORD, st.sampled_from(["G0", "G1", "G1", "F600", "S500", "N7", "G91", "G20", "M4"])),
    max_size=6,
).map(" ".join)


@BOTH
@given(lines=st.lists(LINE, max_size=8), laser=st.booleans())
def test_the_short_way_through_gives_what_the_long_way_gives(name, lines, laser):
    short, long = make(name, s32=int(laser)), make(name, s32=int(laser))
    for line in lines:
        outcomes = []
        for interpreter, text in ((short, line), (long, line + "(no short way)")):
            try:
                outcomes.append(list(interpreter.interpret(text.encode())))
            except GcodeError as refused:
                outcomes.append(refused.code)
        assert outcomes[0] == outcomes[1], line
        assert short.modal == long.modal, line
        assert short.position_mm == long.position_mm
