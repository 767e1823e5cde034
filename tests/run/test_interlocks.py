"""Every row of the interlock table: what trips it, what does not, after how long, what is done."""

from __future__ import annotations

from dataclasses import replace

import pytest

from firmware_protocol.pmx import FeederMode, FeederStatusBits, HopperStatusBits
from firmware_protocol.pmx import FeederStateCode as FeederState
from firmware_protocol.status import parse_status
from lmctl.config.machine import HopperSettings, SafetySettings
from lmctl.errors import MachineError
from lmctl.machine.feeder.readings import HopperReading
from lmctl.machine.feeder.status import FeederStatus
from lmctl.machine.feeder.warnings import FeederWarning
from lmctl.machine.safety.status import SafetyStatus
from lmctl.run.interlocks.alarms import EmergencyStopError, InterlockError, RunAlarms, RunTripError
from lmctl.run.interlocks.inputs import (
    FeederAnswerAge,
    InterlockInputs,
    ProgramDeviation,
    UncommandedOutput,
    feeder_reading,
)
from lmctl.run.interlocks.rules import INTERLOCK_RULES, INTERLOCK_RULES_WITHOUT_SAFETY
from lmctl.run.interlocks.supervision import InterlockSupervision

LIMITS = SafetySettings(
    endpoint="modbus-tcp://127.0.0.1:5023", shield_gas_min_L_min=12, chiller_min_L_min=6,
    chiller_max_C=25, oxygen_trip_ppm=1000, relay_timeout_s=0.5,
)
GOOD = SafetyStatus(
    time_s=0.0, estop_closed=True, door_closed=True, laser_ready=True, laser_healthy=True,
    no_back_reflection=True, chiller_ok=True, shield_gas_ok=True, extraction_ok=True,
    oxygen_valid=True, key_on=True, relay_closed=True, laser_enabled=None, shield_gas_L_min=15.0,
    chiller_C=22.0, chiller_L_min=10.0, oxygen_ppm=20.0, extraction_Pa=800.0, open_inputs=(),
    first_out=None, trip_count=0, self_test_ok=True, heartbeat_echo=1, heartbeat_age_s=0.0,
    uptime_s=1, tick_ms=1,
)
HOPPER = HopperSettings(name="A", feeder="F1", material="316L", dead_time_s=3, lag_s=1,
                        max_flow_g_min=60)


def reading(**changes):
    return replace(HopperReading(
        time_s=0.0, flags=HopperStatusBits(0), setpoint_g_min=6.0, flow_estimated_g_min=6.0,
        flow_weighed_g_min=6.0, weight_g=1000.0, level_percent=50.0, carrier_L_min=4.0,
    ), **changes)


def feeder(
    age_s=0.0, feeding=True, clipped=None, mixer_mbar=100.0, mixer_max_mbar=200.0, **changes
):
    warnings = [FeederWarning(55, "F1", name, "clipped", "") for name in clipped or ()]
    status = FeederStatus(
        time_s=0.0, state=FeederState.FEEDING if feeding else FeederState.READY,
        mode=FeederMode.REMOTE,
        flags=FeederStatusBits.STABLE, alarm=None, warnings=tuple(warnings),
        clipped=clipped is not None,
        seq_applied=1,
        heartbeat_age_s=0.0, uptime_s=1, tick_ms=1, total_gas_L_min=4.0,
        mixer_pressure_mbar=mixer_mbar, hoppers={"A": reading(**changes)}, gas_ok=True,
        feeding=feeding, stable=True,
    )
    return {"feeders": (FeederAnswerAge("F1", age_s, 1.0),),
            "feeder_readings": (feeder_reading("F1", status, (HOPPER,), mixer_max_mbar),)}


FINE = InterlockInputs(
    motion=parse_status("<Run|MPos:1.000,2.000,3.000|FS:600,500>"), motion_age_s=0.1,
    motion_period_s=0.2, standstill_s=0.0, deviation=ProgramDeviation(), **feeder(),
    safety=GOOD, safety_age_s=0.0, limits=LIMITS,
)


def with_safety(**changes):
    return FINE._replace(safety=replace(GOOD, **changes))


def with_feeder(**changes):
    return FINE._replace(**feeder(**changes))


def with_motion(text):
    return FINE._replace(motion=parse_status(text))


def off(**differences):
    return FINE._replace(deviation=ProgramDeviation(**differences))


#: What is the matter, by the name of the rule that must find it.
TRIPPED = [
    ("emergency stop", with_safety(estop_closed=False), "emergency stop"),
    ("door", with_safety(door_closed=False), "door"),
    ("controller's door", with_motion("<Door:1|MPos:1.000,2.000,3.000>"), "door"),
    ("laser", with_safety(laser_healthy=False), "fault"),
    ("laser", with_safety(no_back_reflection=False), "back-reflection"),
    ("laser", with_safety(laser_ready=False), "not ready"),
    ("laser", with_safety(key_on=False), "key"),
    ("chiller", with_safety(chiller_ok=False), "chiller"),
    ("chiller", with_safety(chiller_C=25.1), "25.1 °C"),
    ("chiller", with_safety(chiller_C=None), "unknown"),
    ("chiller", with_safety(chiller_L_min=5.9), "5.9 L/min"),
    ("shield gas", with_safety(shield_gas_ok=False), "shield gas"),
    ("shield gas", with_safety(shield_gas_L_min=11.0), "11 L/min"),
    ("shield gas", with_safety(shield_gas_L_min=None), "unknown"),
    ("oxygen", with_safety(oxygen_valid=False, oxygen_ppm=None), "analyser"),
    ("oxygen", with_safety(oxygen_ppm=1001.0), "1001 ppm"),
    ("watchdog relay", with_safety(relay_closed=False), "relay"),
    ("extraction", with_safety(extraction_ok=False), "extraction"),
    ("safety inputs silent", FINE._replace(safety_age_s=0.31), "0.3 s"),
    ("motion silent", FINE._replace(motion_age_s=0.7), "0.7 s"),
    ("position", FINE._replace(standstill_s=1.1), "1.1 s"),
    ("path", off(path_error_mm=0.11), "0.1 mm off the programmed path"),
    ("wait", off(ahead_of_program_s=1.5), "1.5 s ahead of the program"),
    ("feed and power", off(uncommanded_output=UncommandedOutput(20.0, 10.0, 500.0, (900.0,))),
     "10.0 mm/s at most"),
    ("feed and power", off(uncommanded_output=UncommandedOutput(50.0, 50.0, 580.0, (0.0,))),
     "580 W of beam, says the motion controller; the program asks for no beam here"),
    ("feed and power", off(uncommanded_output=UncommandedOutput(10.0, 10.0, 90.0, (880.0, 900.0))),
     "880 or 900 W at that speed"),
    ("feeder silent", with_feeder(age_s=3.1), "feeder F1"),
    ("mixer pressure", with_feeder(mixer_mbar=201.0), "201 mbar, 200 mbar"),
    ("mixer pressure", with_feeder(mixer_mbar=900.0, feeding=False),
     "feeder F1"),
    ("set-point", with_feeder(clipped=["A"]), "hopper A was clipped"),
    ("set-point", with_feeder(clipped=[]), "a hopper was clipped"),
    ("carrier gas", with_feeder(carrier_L_min=3.1), "3.1 L/min"),
    ("disc", with_feeder(flow_estimated_g_min=5.8), "5.80 g/min"),
    ("disc", with_feeder(flow_estimated_g_min=3.9, previous_setpoints_g_min=(4.0, 4.5)),
     "3.90 g/min"),
    ("weighed flow", with_feeder(flow_weighed_g_min=4.9), "4.90 g/min"),
]


def found(facts):
    return [(rule.name, finding) for rule in INTERLOCK_RULES for finding in rule.find(facts)]


def test_a_good_cell_trips_nothing_with_a_safety_device_and_without():
    assert found(FINE) == []
    assert found(FINE._replace(safety=None, limits=None)) == []
    assert found(FINE._replace(feeders=(), feeder_readings=())) == []


@pytest.mark.parametrize(("name", "facts", "words"), TRIPPED,
                         ids=[f"{n}-{w}" for n, _, w in TRIPPED])
def test_each_row(name, facts, words):
    ((rule, finding),) = found(facts)
    assert rule == name
    assert words in finding.text
    assert finding.remedy


@pytest.mark.parametrize(("name", "facts", "words"), TRIPPED,
                         ids=[f"{n}-{w}" for n, _, w in TRIPPED])
def test_a_cell_without_a_safety_device_is_spared_only_what_such_a_device_says(name, facts, words):
    bare = facts._replace(safety=None, limits=None)
    spared = [rule for rule in INTERLOCK_RULES if rule not in INTERLOCK_RULES_WITHOUT_SAFETY]
    assert [finding for rule in spared for finding in rule.find(bare)] == []
    kept = [finding for rule in INTERLOCK_RULES_WITHOUT_SAFETY for finding in rule.find(bare)]
    assert kept == [finding for _, finding in found(bare)]
    assert bool(kept) == (name in [rule.name for rule in INTERLOCK_RULES_WITHOUT_SAFETY])


def test_every_rule_has_a_row_above():
    assert {rule.name for rule in INTERLOCK_RULES} == {name for name, *_ in TRIPPED}


@pytest.mark.parametrize("facts", [
    with_motion("<Door:0|MPos:1.000,2.000,3.000>"),  # closed again, not yet gone on
    with_feeder(flow_estimated_g_min=6.11),  # within 2 %
    with_feeder(flow_estimated_g_min=5.0, previous_setpoints_g_min=(4.0, 4.5)),  # on its way up
    with_feeder(flow_estimated_g_min=8.1, previous_setpoints_g_min=(8.0,)),  # and down
    with_feeder(flow_estimated_g_min=0.0, feeding=False),  # discs are off
    with_feeder(carrier_L_min=None, flow_weighed_g_min=None),
    with_feeder(mixer_mbar=200.0),  # what is allowed
    with_feeder(mixer_mbar=None),  # the feeder has no such sensor
    with_feeder(mixer_mbar=900.0, mixer_max_mbar=None),  # no limit is set
    with_feeder(clipped=["A"], feeding=False),  # discs are off
    with_safety(door_closed=None, chiller_ok=None, key_on=None),  # not fitted
])
def test_what_is_no_trip(facts):
    assert found(facts) == []


def test_a_relay_that_opens_the_controllers_door_input_is_not_called_a_door():
    facts = with_safety(relay_closed=False)._replace(
        motion=parse_status("<Door:1|MPos:1.000,2.000,3.000>"))
    assert [name for name, _ in found(facts)] == ["watchdog relay"]


def watched(rules=INTERLOCK_RULES):
    raised = []
    return InterlockSupervision(raised.append, rules), raised


def test_a_rule_with_a_time_waits_for_it_and_starts_anew_after_a_gap():
    supervision, raised = watched()
    low = with_safety(shield_gas_L_min=5.0)
    for t in (0.0, 0.2, 0.4):
        supervision.evaluate(low, t, beam_off=False)
    supervision.evaluate(FINE, 0.45, beam_off=False)
    supervision.evaluate(low, 0.5, beam_off=False)
    supervision.evaluate(low, 0.9, beam_off=False)
    assert raised == []
    supervision.evaluate(low, 1.0, beam_off=False)
    assert [type(error) for error in raised] == [InterlockError]
    supervision.evaluate(low, 2.0, beam_off=False)
    assert len(raised) == 1  # told once
    supervision.acknowledge()
    supervision.evaluate(low, 2.1, beam_off=False)
    assert len(raised) == 2


@pytest.mark.parametrize(("changes", "name", "for_s"), [
    ({"flow_estimated_g_min": 5.8}, "disc A", 2.0), ({"carrier_L_min": 3.0}, "carrier gas A", 1.0),
    ({"flow_weighed_g_min": 4.0}, "weighed flow A", 20.0),
])
def test_one_reading_trips_nothing_however_often_it_is_looked_at(changes, name, for_s):
    """A set-point may just have changed; hoppers are read less often than looked at."""
    supervision, raised = watched()
    bad = with_feeder(**changes)
    for t in (0.0, 0.2, for_s, 2 * for_s):
        supervision.evaluate(bad, t, beam_off=False)
        assert supervision.has_unconfirmed_findings
    supervision.evaluate(with_feeder(time_s=for_s / 2, **changes), for_s, beam_off=False)
    assert raised == []
    supervision.evaluate(with_feeder(time_s=for_s - 0.01, **changes), for_s, beam_off=False)
    assert [error.name for error in raised] == [name]
    supervision.evaluate(FINE, 3 * for_s, beam_off=False)
    assert not supervision.has_unconfirmed_findings


def test_a_mixer_pressure_trips_when_it_has_been_too_high_for_a_second():
    supervision, raised = watched()
    clogged = with_feeder(mixer_mbar=201.0)
    for t in (0.0, 0.5, 0.9):
        supervision.evaluate(clogged, t, beam_off=False)
    supervision.evaluate(FINE, 0.95, beam_off=False)  # a puff
    for t in (1.0, 1.5, 1.9):
        supervision.evaluate(clogged, t, beam_off=False)
    assert raised == []
    supervision.evaluate(clogged, 2.0, beam_off=False)
    assert [(type(error), error.name) for error in raised] == [(InterlockError,
                                                                "mixer pressure F1")]


@pytest.mark.parametrize(("mbar", "trips"), [(201.0, ["feeder silent", "mixer pressure"]),
                                             (100.0, ["feeder silent"]), (None, ["feeder silent"])])
def test_a_mixer_pressure_that_is_old_counts_and_so_does_its_age(mbar, trips):
    stale = with_feeder(age_s=3.1, mixer_mbar=mbar)
    assert [name for name, _ in found(stale)] == trips


def test_of_a_feeder_that_has_not_answered_nothing_is_known():
    silent = FINE._replace(feeder_readings=(feeder_reading("F1", None, (HOPPER,), 200.0),))
    assert found(silent) == []


def test_a_clog_keeps_from_resuming_until_it_has_cleared_however_short():
    supervision, _ = watched()
    clogged = with_feeder(mixer_mbar=900.0, feeding=False)
    assert len(supervision.active_alarms(clogged)) == 1
    assert supervision.active_alarms(FINE) == []


def test_answers_in_which_nothing_is_found_are_looked_at_once_and_trouble_until_it_is_over():
    looks = []

    def looked(rule):
        def look(facts):
            looks.append(rule.name)
            return rule.find(facts)

        return replace(rule, find=look)

    of_answers = [rule.name for rule in INTERLOCK_RULES if rule.uses_feeder_readings]
    assert of_answers == ["mixer pressure", "set-point", "carrier gas", "disc", "weighed flow"]
    supervision, raised = watched([looked(rule) for rule in INTERLOCK_RULES])

    def asked(facts, t):
        looks.clear()
        supervision.evaluate(facts, t, beam_off=False)
        return [name for name in looks if name in of_answers]

    clogged = with_feeder(mixer_mbar=900.0)
    assert asked(FINE, 0.0) == of_answers
    assert asked(FINE, 0.2) == []
    assert asked(FINE._replace(motion_age_s=0.2), 0.3) == []  # the answers are the same
    for t in (1.0, 1.2, 1.9, 2.0, 2.2):
        assert asked(clogged, t) == of_answers
    assert [error.name for error in raised] == ["mixer pressure F1"]
    assert asked(FINE, 2.4) == of_answers
    assert asked(FINE, 2.6) == []


def test_an_open_safety_chain_is_no_mere_hold():
    supervision, raised = watched()
    supervision.evaluate(with_safety(estop_closed=False), 0.0, beam_off=False)
    assert [type(error) for error in raised] == [EmergencyStopError]


def test_extraction_waits_for_the_end_of_the_path_but_not_for_ever():
    supervision, raised = watched()
    bad = with_safety(extraction_ok=False)
    supervision.evaluate(bad, 0.0, beam_off=False)
    supervision.evaluate(bad, 30.0, beam_off=False)
    assert raised == []
    supervision.evaluate(bad, 31.0, beam_off=True)
    assert len(raised) == 1
    supervision, raised = watched()
    supervision.evaluate(bad, 0.0, beam_off=False)
    supervision.evaluate(bad, 60.0, beam_off=False)
    assert len(raised) == 1


def test_what_stands_keeps_from_resuming_but_not_what_acknowledging_ends():
    supervision, _ = watched()
    assert [e.what for e in supervision.active_alarms(with_safety(door_closed=False))] == [
        "the safety door is open"]
    assert supervision.active_alarms(with_safety(relay_closed=False)) == []


def test_alarms_and_warnings_are_reported_as_they_come_and_warnings_as_they_go():
    alarms, lines = RunAlarms(), []
    alarms.notify = lines.append
    low = FeederWarning(51, "F1", "A", "hopper A: the level is low", "fill it")
    alarms.set_warning(low, is_active=True)
    alarms.add(InterlockError("gas", "gas is low", hint="check the bottle"), 1.0)
    alarms.add(InterlockError("gas", "gas is low"), 2.0)
    alarms.acknowledge()
    assert alarms.warnings == [low]  # that does not fill it
    alarms.set_warning(low, is_active=False)
    assert alarms.warnings == []
    assert lines == [
        "warning: hopper A: the level is low; what to do: fill it",
        "alarm: gas is low; what to do: check the bottle",
        "no longer: hopper A: the level is low",
    ]


def test_the_first_alarm_stays_first_until_all_are_acknowledged():
    alarms = RunAlarms()
    assert alarms.add(InterlockError("gas", "gas is low"), 1.0)
    assert alarms.add(InterlockError("disc", "disc is jammed"), 2.0)
    assert alarms.add(InterlockError("gas", "gas is lower still"), 3.0) is None
    assert alarms.cause.what == "gas is low"
    assert [alarm.name for alarm in alarms] == ["gas", "disc"]
    alarms.acknowledge()
    assert alarms.cause is None
    assert len(alarms) == 0


def test_what_the_headline_ends_with_is_not_repeated_as_its_consequence():
    alarms = RunAlarms()
    alarms.add(MachineError("the motion controller is lost: the link was closed"), 1.0)
    assert alarms.add(MachineError("the link was closed"), 1.1) is None
    assert alarms.add(MachineError("the gate of the link was closed"), 1.2) is not None
    assert len(alarms) == 2


def test_a_host_that_stood_still_has_not_asked_so_no_one_is_silent():
    stale = FINE._replace(motion_age_s=0.9, motion_unanswered=False)
    supervision, raised = watched()
    supervision.evaluate(stale, 0.0, beam_off=False)
    assert raised == []
    supervision.evaluate(stale._replace(motion_unanswered=True), 0.1, beam_off=False)
    assert len(raised) == 1


def test_reports_that_cannot_be_read_are_called_that():
    supervision, raised = watched()
    supervision.evaluate(FINE._replace(motion_age_s=0.7, motion_unreadable=5), 0.0, beam_off=False)
    assert "unreadable for 0.7 s" in raised[0].what


def test_a_cause_that_shows_later_than_what_it_does_is_the_first_alarm():
    """A controller that loses power is silent before it says that it has restarted."""
    alarms, lines = RunAlarms(), []
    alarms.notify = lines.append
    alarms.add(InterlockError("motion silent", "it has not reported for 0.6 s"), 0.6)
    alarms.add(InterlockError("feeder silent F1", "feeder F1: no answer"), 0.9)
    alarms.add(RunTripError("motion restarted", "it restarted", explains=("motion silent",)), 1.5)
    alarms.add(RunTripError("motion alarm 3", "it is in alarm"), 1.6)
    assert alarms.cause.what == "it restarted"
    assert [one.what for one in alarms] == [
        "it restarted", "it has not reported for 0.6 s", "feeder F1: no answer", "it is in alarm"]
    assert [line.partition(":")[0] for line in lines] == ["alarm", "then", "the cause", "then"]


def test_what_explains_something_else_stays_behind_the_first_alarm():
    alarms = RunAlarms()
    alarms.add(InterlockError("door", "the door is open"), 0.1)
    alarms.add(InterlockError("motion silent", "it has not reported for 0.6 s"), 0.6)
    alarms.add(RunTripError("motion restarted", "it restarted", explains=("motion silent",)), 1.5)
    assert alarms.cause.name == "door"
