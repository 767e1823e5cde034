"""A job whose text and table tell different stories is refused, with the line and both values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lmctl.errors import JobError
from lmctl.job.layer_rules import first_broken_rule
from lmctl.job.schema import JobLayer, LineKind, line_dtype
from lmctl.preflight.program_check import check_program

# Text and what the table has for it: kind, end, speed, power, seconds.
START = (10.0, 10.0, 20.0)
ROWS = [
    ("G21 G90 G94", LineKind.SETUP, START, 0, 0, 0.0),
    ("M4 S0", LineKind.SETUP, START, 0, 0, 0.0),
    ("G1 X20 Y10 Z1 F3000 S0", LineKind.TRAVEL, (20, 10, 1), 50, 0, 0.6),
    ("G4 P0.25", LineKind.DWELL, (20, 10, 1), 0, 0, 0.25),
    ("G1 X21 Y10 Z1 F600 S0", LineKind.LEAD, (21, 10, 1), 10, 0, 0.11),
    ("G1 X21.5 Y10.25 S500", LineKind.BEAD, (21.5, 10.25, 1), 10, 1500, 0.06),
    ("G1 X22 Y11", LineKind.BEAD, (22, 11, 1), 10, 1500, 0.095),
    ("G1 X22.5 Y11 F540 S612.3", LineKind.BEAD, (22.5, 11, 1), 9, 1836.9, 0.06),
    ("G1 X23 Y11 S0", LineKind.LEAD, (23, 11, 1), 9, 0, 0.06),
    ("G1 X10 Y10 Z20 F3000 S0", LineKind.TRAVEL, START, 50, 0, 0.6),
    ("M5", LineKind.SETUP, START, 0, 0, 0.0),
]


def layer_of(rows, index=0, first_line=0, start_s=0.0) -> JobLayer:
    lines = np.zeros(len(rows), line_dtype(2))
    lines["fractions"] = (0.5, 0.5)
    lines["path"] = -1
    for at, (_, kind, end_mm, speed, power, _) in enumerate(rows):
        lines[at]["kind"], lines[at]["speed_mm_s"], lines[at]["power_W"] = kind, speed, power
        lines[at]["x_mm"], lines[at]["y_mm"], lines[at]["z_mm"] = end_mm
    lines["end_s"] = start_s + np.cumsum([row[5] for row in rows])
    program = tuple(f"N{first_line + at} {row[0]}" for at, row in enumerate(rows))
    flow_s = np.array([start_s, lines["end_s"][-1]])
    layer = JobLayer(index, 1.0, first_line, program, lines, flow_s, np.zeros((2, 2)))
    assert first_broken_rule(layer, 2, 2) is None, "the job's own rules would have refused it"
    return layer


class Job:
    """What `check_program` reads of a job file."""

    def __init__(self, manifest, *layers: JobLayer) -> None:
        self.manifest = replace(
            manifest, layers=tuple(layers), bounds_mm=((10.0, 10.0, 0.8), (200.0, 190.0, 20.0)),
            totals={"longest_line_s": 0.6, "peak_power_W": 1836.9},
        )
        self._layers = layers

    def iterate_layers(self):
        return iter(self._layers)


@pytest.fixture
def check(manifest, profile):
    def one(*layers: JobLayer) -> None:
        check_program(Job(manifest, *layers), profile)

    return one


def test_a_program_that_does_what_its_table_says(check):
    check(layer_of(ROWS))


def test_layers_go_on_from_where_the_one_before_ended(check):
    first, second = ROWS[:9], ROWS[9:]
    check(layer_of(first), layer_of(second, 1, len(first), sum(row[5] for row in first)))


@pytest.mark.parametrize("at", range(len(ROWS)))
def test_every_line_is_looked_at(check, at):
    """Each line in turn is replaced by one of another kind."""
    rows = list(ROWS)
    other = "M5" if rows[at][1] is not LineKind.SETUP else "G4 P0.25"
    rows[at] = (other, *rows[at][1:])
    with pytest.raises(JobError, match=rf"line {at} of the job"):
        check(layer_of(rows))


LIES = [
    # line, its text, what is said
    (2, "G1 X20 Y10 Z1 F3000 S1000", "beam on, at S1000; the table has it off (travel)"),
    (4, "G1 X21 Y10 Z1 F600 S0.1", "beam on, at S0.1; the table has it off (lead)"),
    (8, "G1 X23 Y11", "beam on, at S612.3; the table has it off (lead)"),
    (5, "G1 X21.5 Y10.25 S1000", "has a beam of 3000 W, the table has 1500 W"),
    (5, "G1 X21.5 Y10.25", "has a beam of 0 W, the table has 1500 W"),
    (6, "G1 X22 Y11 S500.3", "has a beam of 1500.9 W, the table has 1500 W"),
    (5, "G1 X25 Y10.25 S500", "goes to X 25.000 mm, the table has 21.500 mm"),
    (6, "G1 X22 Y11.002", "goes to Y 11.002 mm, the table has 11.000 mm"),
    (6, "G1 X22 Y11 Z0", "goes to Z 0.000 mm, the table has 1.000 mm"),
    (2, "G1 X20 Y10 F3000 S0", "does not say how high it is"),
    (2, "G1 X20 Y10 Z1 S0", "does not say how fast it is"),
    (2, "G1 X20 Y10 Z1 F3000", "does not say with which power"),
    (4, "G1 X21 Y10 Z1 F601 S0", "goes at 10.02 mm/s, the table has 10 mm/s"),
    (6, "G1 X22 Y11 F6000", "goes at 100 mm/s, the table has 10 mm/s"),
    (3, "G4 P25", "waits 25 s, the table has 0.25 s"),
    (3, "G1 X20 Y10 Z1 S0", "the program moves, the table has dwell"),
    (6, "G4 P0.1", "the program waits, the table has bead"),
    (6, "M4 S0", "the program sets modes, the table has bead"),
    (1, "M5", "sets M5 here, a plan M4 S0"),
    (0, "M4 S0", "sets M4 S0 here, a plan G21 G90 G94"),
    (10, "M4 S0", "sets M4 S0 here, a plan M5"),
    (1, "M4 S1000", "a line that no plan is made of"),
    (6, "G0 X22 Y11", "a line that no plan is made of"),
    (6, "G1 X22 Y11 M5", "a line that no plan is made of"),
    (6, "G1 X22 Y11 S500 S1000", "a line that no plan is made of"),
    (6, "G1 X22 X22 Y11", "a line that no plan is made of"),
    (6, "G1 Y11 X22", "a line that no plan is made of"),
    (6, "X22 Y11", "a line that no plan is made of"),
    (6, "G1 X22 Y11 G4 P1", "a line that no plan is made of"),
    (6, "G1 X22 Y11 F-600", "a line that no plan is made of"),
    (6, "G1 X22 Y11 S-1", "a line that no plan is made of"),
]


@pytest.mark.parametrize(("at", "text", "said"), LIES)
def test_a_text_that_lies_is_named_with_both_values(check, at, text, said):
    rows = list(ROWS)
    rows[at] = (text, *rows[at][1:])
    with pytest.raises(JobError) as caught:
        check(layer_of(rows))
    reported = caught.value.render()
    assert f"line {at} of the job" in reported
    assert said in reported
    assert f"N{at} {text}" in reported
    assert "plan the part again" in reported


@pytest.mark.parametrize(("column", "value", "said"), [
    ("end_s", -0.2, "takes 0.447 s at least, the table has 0.247 s"),
    ("power_W", 3000, "has a beam of"),
    ("x_mm", 300, "goes to X"),
])
def test_a_table_that_lies(check, column, value, said):
    layer = layer_of(ROWS)
    layer = replace(layer, lines=layer.lines.copy())
    if column == "end_s":
        layer.lines["end_s"][2:] += value
        said = "s at least, the table has 0.400 s"
    else:
        layer.lines[column][5] = value
    with pytest.raises(JobError, match=r"line [25] of the job") as caught:
        check(layer)
    assert said in caught.value.render()


@pytest.mark.parametrize(("changes", "said"), [
    ({"bounds_mm": ((10, 10, 0.8), (22.2, 190, 20))}, "X 22.500 mm, the manifest says 10 to 22.2"),
    ({"bounds_mm": ((10, 10, 2.0), (200, 190, 20))}, "Z 1.000 mm, the manifest says 2 to 20"),
    ({"totals": {"longest_line_s": 0.24}}, "it has 0.6 s, the manifest says 0.24 at most"),
    ({"totals": {"peak_power_W": 1500}}, "it has 1836.9 W, the manifest says 1500 at most"),
])
def test_what_the_manifest_promises_must_be_so(manifest, profile, changes, said):
    job = Job(manifest, layer_of(ROWS))
    job.manifest = replace(job.manifest, **changes)
    with pytest.raises(JobError) as caught:
        check_program(job, profile)
    assert said in caught.value.render()


@pytest.mark.parametrize(("said", "fits"), [("0.5", False), ("0.4667", True), ("0.4669", False)])
def test_on_a_small_scale_a_power_has_more_decimals(manifest, profile, said, fits):
    """Of 3000 W, where $30 is 1: 1400 W is no S0.5."""
    rows = [list(row) for row in ROWS]
    rows[5][0], rows[5][4] = f"G1 X21.5 Y10.25 S{said}", 1400
    rows[6][4] = 1400
    rows[7][0], rows[7][4] = "G1 X22.5 Y11 F540 S0.6123", 1836.9
    job = Job(replace(manifest, s_max=1), layer_of(rows))
    if fits:
        check_program(job, profile)
    else:
        with pytest.raises(JobError, match="line 5 of the job"):
            check_program(job, profile)


def test_a_feed_of_nothing_in_text_and_table(check):
    rows = [*ROWS]
    rows[4] = ("G1 X21 Y10 Z1 F0 S0", LineKind.LEAD, (21, 10, 1), 0, 0, 0.11)
    rows[5] = ("G1 X21.5 Y10.25 F600 S500", *ROWS[5][1:])
    with pytest.raises(JobError, match=r"line 4 .*the program moves at F0"):
        check(layer_of(rows))


def test_rounding_is_no_difference(check):
    """Positions of three decimals, feeds and powers of one, and what float32 makes of them."""
    rows = list(ROWS)
    rows[6] = ("G1 X22 Y11", LineKind.BEAD, (22.00049, 10.99951, 1.0), 10.0009, 1500.14, 0.095)
    rows[7] = (*rows[7][:4], 1836.94, rows[7][5])  # the manifest has 1836.9
    check(layer_of(rows))
