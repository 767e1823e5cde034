"""Reports of feed and power against a program: what it asks for, and what it never did."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from firmware_protocol.status import parse_status
from lmctl.run.program.line_energy import LineEnergyCheck

FULL_W, S_MAX, BEAD_W, SPEED_MM_S = 3000.0, 1000, 1500.0, 10.0
BEAD = "FS:600,500"
LEAD_S = 0.09

#: Two beads of a second each, dark ways of a second before, between and behind them.
LAYER = [
    ("setup", (0, 0, 0), 0.0), ("travel", (50, 0, 0), 1.0), ("bead", (60, 0, 0), 1.0, 0),
    ("travel", (60, 50, 0), 1.0), ("bead", (50, 50, 0), 1.0, 1), ("travel", (0, 50, 0), 1.0),
    ("dwell", (0, 50, 0), 5.0), ("travel", (0, 0, 0), 1.0),
]
IN_BEAD_S, IN_TRAVEL_S, IN_DWELL_S = 1.5, 2.5, 7.5


@pytest.fixture
def energy(job):
    return LineEnergyCheck(job([LAYER]).window(), LEAD_S)


def status(fields, state="Run"):
    return parse_status(f"<{state}|MPos:0.000,0.000,0.000|{fields}>")


def report_to(energy, s, *reports, rate=1.0):
    for fields in reports:
        energy.on_report(status(fields), s, rate)
    return energy.uncommanded_output


@pytest.mark.parametrize(("s", "fields", "rate"), [
    (IN_BEAD_S, BEAD, 1.0),
    (IN_BEAD_S, "FS:300,250", 1.0),  # accelerating: power follows speed
    (IN_BEAD_S, "FS:1,1", 1.0),  # whole mm/min, whole S
    (IN_BEAD_S, "FS:840,700", 1.4),  # feed override: so does it there
    (IN_BEAD_S, "FS:600,450|Ov:100,100,90", 1.0),  # power override
    (IN_BEAD_S, "FS:1200,1000", 2.5),  # no more than full power
    (IN_BEAD_S, "FS:612,510", 1.0),  # slack
    (IN_TRAVEL_S, "FS:3000,0", 1.0),
    (IN_TRAVEL_S, "FS:3000,9", 1.0),  # under a hundredth of full power
    (IN_DWELL_S, "FS:0,0", 1.0),
    (IN_DWELL_S, "FS:3000,0", 1.0),  # the way before it is not over
    (2.0, BEAD, 1.0), (2.0, "FS:600,0", 1.0), (2.0, "FS:3000,0", 1.0),  # either line may run
])
def test_what_the_program_asks_for(energy, s, fields, rate):
    assert report_to(energy, s, fields, fields, fields, rate=rate) is None
    assert energy.bead_short_from_s == math.inf


def test_a_scale_of_few_steps_is_known_to_a_step_only(job):
    """$30=1: half of full power is told as S0 or S1."""
    fine = job([LAYER])
    coarse = replace(fine, manifest=replace(fine.manifest, s_max=1))
    for fields in ("FS:600,0", "FS:600,1"):
        energy = LineEnergyCheck(coarse.window(), LEAD_S)
        assert report_to(energy, IN_BEAD_S, fields, fields, fields) is None


@pytest.mark.parametrize(("fields", "rate"), [
    ("FS:600,50", 1.0),  # a digit of S lost
    ("FS:600,580", 1.0),  # S500 became S580
    ("FS:600,0", 1.0),
    ("FS:60,500", 1.0),  # F600 became F60: ten times the energy
    ("FS:1200,500", 1.0),  # F1200: half of it
    ("FS:1200,1000", 1.0),  # right energy, but twice as fast as ever asked
    ("FS:600,500", 0.5),
    ("FS:200,500", 1.0),  # M4 became M3: power no longer follows speed
])
def test_what_it_does_not_ask_for_counts_when_three_reports_say_it(energy, fields, rate):
    assert report_to(energy, 1.3, "FS:300,250", "FS:300,250", rate=rate) is None
    for _ in range(2):
        assert report_to(energy, IN_BEAD_S, fields, rate=rate) is None
        assert energy.is_in_doubt
    found = report_to(energy, IN_BEAD_S, fields, rate=rate)
    assert found is not None
    feed, s_word = (float(word) for word in fields[3:].split(","))
    assert found.speed_mm_s == pytest.approx(feed / 60)
    assert found.power_W == pytest.approx(s_word * FULL_W / S_MAX)
    assert found.max_speed_mm_s == pytest.approx(SPEED_MM_S * rate)
    power_W = min(BEAD_W / SPEED_MM_S * feed / 60, FULL_W)
    assert found.commanded_powers_W == pytest.approx((power_W,))


def test_where_a_beam_off_line_and_a_bead_may_be_running_half_the_power_is_neither(energy):
    assert report_to(energy, 2.0, "FS:600,0", BEAD, "FS:3000,0") is None
    found = report_to(energy, 2.0, "FS:600,250", "FS:600,250", "FS:600,250")
    assert found.commanded_powers_W == pytest.approx((0.0, BEAD_W))


@pytest.mark.parametrize("s", [IN_TRAVEL_S, IN_DWELL_S])
@pytest.mark.parametrize("fields", ["FS:3000,500", "FS:0,500", "FS:600,50"])
def test_a_beam_where_the_program_has_none_needs_no_word_on_overrides(energy, s, fields):
    for _ in range(2):
        energy.on_report(status(fields), s, 1.0, overrides_known=False)
        assert energy.uncommanded_output is None
        assert energy.is_in_doubt
    energy.on_report(status(fields), s, 1.0, overrides_known=False)
    assert energy.uncommanded_output is not None


def test_a_lost_report_may_have_shown_an_override_so_that_is_asked_first(energy):
    for _ in range(6):
        energy.on_report(status("FS:600,300"), IN_BEAD_S, 1.0, overrides_known=False)
        assert energy.uncommanded_output is None
        assert energy.is_in_doubt
    energy.on_report(status("FS:600,300|Ov:100,100,60"), IN_BEAD_S, 1.0)
    assert report_to(energy, IN_BEAD_S, "FS:600,300", "FS:600,300", "FS:600,300") is None
    assert not energy.is_in_doubt


@pytest.mark.parametrize("damaged", [
    ("FS:600,900", "FS:600,50", "FS:600,580"),  # each digit another
    ("FS:600,900", BEAD, "FS:600,900", BEAD, "FS:600,900", BEAD),  # a sound report in between
    ("FS:6,500", "FS:600,5", "FS:900,500"),
])
def test_reports_that_do_not_agree_are_damaged_reports(energy, damaged):
    assert report_to(energy, IN_BEAD_S, BEAD, *damaged, BEAD) is None
    assert not energy.is_in_doubt
    assert energy.bead_short_from_s == math.inf


def test_three_reports_on_a_ramp_agree(energy):
    """F600 S500 became S580: power follows speed while the machine accelerates."""
    assert report_to(energy, IN_BEAD_S, "FS:150,145", "FS:300,290", "FS:450,435") is not None


@pytest.mark.parametrize("reports", [
    ("FS:1200,1000", "FS:1200,1000|Ov:200,100,100"),  # told a report late
    ("FS:600,300", "FS:600,300|Ov:100,100,60"),
    ("FS:600,300|Ov:100,100,60", "FS:600,300", "FS:600,300"),
])
def test_an_override_turned_at_the_panel_is_no_damage(energy, reports):
    rate = 1.0
    for fields in reports:
        report = status(fields)
        rate = report.override_percents[0] / 100 if report.override_percents else rate
        energy.on_report(report, IN_BEAD_S, rate)
    energy.on_report(status(reports[-1].partition("|")[0]), IN_BEAD_S, rate)
    assert energy.uncommanded_output is None


def test_a_change_of_rate_excuses_the_report_that_was_on_its_way(energy):
    assert report_to(energy, IN_BEAD_S, BEAD) is None
    assert report_to(energy, IN_BEAD_S, BEAD, rate=0.6) is None
    assert report_to(energy, IN_BEAD_S, "FS:360,300", "FS:360,300", rate=0.6) is None


@pytest.mark.parametrize("state", ["Hold", "Idle", "Door", "Alarm"])
def test_only_a_machine_that_runs_the_program_is_judged(energy, state):
    for _ in range(3):
        energy.on_report(status("FS:600,1000", state), IN_BEAD_S, 1.0)
    assert energy.uncommanded_output is None


def test_a_report_without_feed_says_nothing(energy):
    for _ in range(3):
        energy.on_report(parse_status("<Run|MPos:0.000,0.000,0.000>"), IN_BEAD_S, 1.0)
    assert energy.uncommanded_output is None


def test_a_bead_with_too_little_power_is_missing_from_the_last_good_report_on(energy):
    report_to(energy, 1.2, BEAD)
    report_to(energy, 1.4, "FS:600,20")
    assert energy.bead_short_from_s == pytest.approx(1.2)
    report_to(energy, 1.42, "FS:600,20", "FS:600,20")
    report_to(energy, 1.6, BEAD)  # the damaged line is over; it was laid all the same
    assert energy.uncommanded_output is not None
    assert energy.bead_short_from_s == pytest.approx(1.2)


def test_too_little_power_by_an_override_is_not_missing(energy):
    report_to(energy, 1.2, BEAD, "FS:600,250", "FS:600,250|Ov:100,100,50", "FS:600,250")
    assert energy.bead_short_from_s == math.inf


def test_too_much_power_leaves_nothing_missing(energy):
    assert report_to(energy, 1.4, BEAD, *3 * ["FS:600,900"]) is not None
    assert energy.bead_short_from_s == math.inf


def test_what_was_found_stands(energy):
    found = report_to(energy, IN_TRAVEL_S, *3 * ["FS:3000,500"])
    assert found is not None
    assert report_to(energy, IN_BEAD_S, BEAD, BEAD, BEAD) is found


def test_with_the_beam_off_every_power_is_one_too_many(job):
    energy = LineEnergyCheck(job([LAYER]).window(beam_off=True), LEAD_S)
    assert report_to(energy, IN_BEAD_S, "FS:600,0", "FS:600,0") is None
    assert report_to(energy, IN_BEAD_S, BEAD, BEAD, BEAD) is not None


def test_lines_of_the_next_layer_may_be_running(job):
    layers = [LAYER[:3], [("bead", (70, 0, 0), 1.0, 1), ("travel", (0, 0, 0), 1.0)]]
    energy = LineEnergyCheck(job(layers).window(), LEAD_S)
    assert report_to(energy, 2.0, BEAD, BEAD) is None
    # The head is already travelling.
    assert report_to(energy, 2.95, "FS:3000,0", "FS:3000,0") is None
