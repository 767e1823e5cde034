"""What doctor calls a reason to refuse a run is what runs are refused for, and the other way."""

from __future__ import annotations

import re

import pytest

from firmware_protocol.dialect import GRBL as DIALECT_GRBL
from firmware_protocol.safety_io import CYCLIC_BLOCK, SafetyInputBits
from firmware_protocol.status import parse_status
from lmctl.config.machine import load_profile
from lmctl.machine.manual.inspect_motion import MotionReading
from lmctl.machine.motion.identity import ControllerIdentity
from lmctl.machine.safety.status import read_safety_status
from lmctl.run.cell.doctor import check_inspection, inspect_cell
from lmctl.run.cell.motion_conditions import motion_conditions
from lmctl.run.cell.safety_conditions import safety_conditions
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig
from simulators.feeder.injected_defects import InjectedDefects
from tests.run.whole.conftest import EXAMPLES, BenchRun, wired

GRBL = (('dialect = "grblhal"', 'dialect = "grbl"'), ("10 = 511", "10 = 3"),
        ("rx_bytes = 1024", "rx_bytes = 128"), ("planner_blocks = 100", "planner_blocks = 15"))


def settings(*assignments):
    """Settings of the simulated controller beside, or in place of, those of the example bench."""
    text = "32 = 1"
    replaced = [(f"{name} = {old}", f"{name} = {value}") for name, old, value in assignments if old]
    added = [f"{name} = {value}" for name, old, value in assignments if not old]
    return (*replaced, *([(text, "\n".join((text, *added)))] if added else []))


def lines(text):
    """Something another sender has sent before."""
    return lambda bench: bench.motion.receive(text)


def feeder(act):
    return lambda bench: act(bench.feeders["F1"])


def without_hopper(device):
    device.defects = InjectedDefects()
    device.defects.override_register(1, "STATUS", lambda word: word & ~1)


#: Name, replacements in the bench, what is done to it, words of each reason a run is refused for.
CELLS = [
    ("all well", (), None, []),
    ("laser mode", settings((32, 1, 0)), None, ["laser mode is off"]),
    ("reports behind laser mode", settings((32, 1, 0), (10, 511, 1)), None,
     ["laser mode is off", "neither Ln: nor Bf:"]),
    ("full power, inches", settings((30, 1000, 255), (13, None, 1)), None,
     ["full power is S255", "reports in mm"]),
    ("least power", settings((31, None, 50)), None, ["least power"]),
    ("a low least power", settings((31, None, 5)), None, []),
    ("slow axes", settings((111, 6000, 3000), (122, 500, 250), (11, None, 0.05)), None, []),
    ("G55", (), lines(b"G10 L2 P2 X5\nG55\n"), ["those of G55"]),
    ("G92", (), lines(b"G92 X-5 Y-3\n"), ["an offset by G92"]),
    ("tool length", (), lines(b"G43.1 Z2\n"), ["a tool length offset"]),
    ("G56, G92 and $13", settings((13, None, 1)), lines(b"G56\nG92 X-5\n"),
     ["reports in mm", "those of G56", "an offset by G92"]),
    ("check mode", (), lines(b"$C\n"), []),
    ("held at its panel", (), lines(b"!"), []),
    ("not homed", settings((22, None, 1)), None,
     ["its position is unknown", "soft limits off", "X of the profile", "Y of the profile",
      "Z of the profile"]),
    ("locked", (*GRBL, *settings((22, None, 1))), None,
     ["locked by an alarm", "soft limits off", "X of the profile", "Y of the profile",
      "Z of the profile"]),
    ("a feeder's alarm", (), feeder(lambda one: one.raise_alarm(201)), ["hopper A: drive fault"]),
    ("a feeder's e-stop", (), feeder(lambda one: one.set_estop_open(True)),
     ["emergency-stop chain is open"]),
    ("a feeder's watchdog", (), feeder(lambda one: one.trip_watchdog()), ["its watchdog tripped"]),
    ("an empty hopper", (), feeder(lambda one: one.raise_alarm(207)), ["hopper A: it is empty"]),
    ("no hopper", (), feeder(without_hopper),
     ["hopper A (316L): not there"]),
]
NAMES = [name for name, *_ in CELLS]


def doctor(folder, profile, changes, act, *, bench="bench.toml", close_relay=False):
    """Every condition that doctor finds, by device."""
    text = (EXAMPLES / bench).read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)

    async def main():
        async with Bench(BenchConfig.parse(text), ephemeral_ports=True) as cell:
            if act is not None:
                act(cell)
            here = wired(profile, cell.endpoints)
            if profile.safety is not None:
                here = here.model_copy(update={"safety": profile.safety.model_copy(
                    update={"endpoint": cell.endpoints["safety"]})})
            return check_inspection(await inspect_cell(here, folder / "runs",
                                                       close_relay=close_relay), here)

    return virtual_time.run_in_virtual_time(main())


def unmet(found):
    return [one for of_device in found.values() for one in of_device if not one.is_met]


@pytest.mark.parametrize(("changes", "act", "words"), [cell[1:] for cell in CELLS], ids=NAMES)
def test_doctor_finds_what_refuses_a_run_each_once_and_nothing_else(
    tmp_path, profile, square_job, changes, act, words
):
    found = unmet(doctor(tmp_path, profile, changes, act))
    reasons = [one.text for one in found if one.refuses_run]
    assert len(reasons) == len(words), reasons
    for word in words:
        assert sum(word in reason for reason in reasons) == 1, (word, reasons)
    assert len({one.text for one in found}) == len(found)
    assert all(one.hint for one in found)

    run = BenchRun(tmp_path / "run", profile, square_job, bench=changes,
                   before=None if act is None else lambda one: act(one.bench))
    assert (run.error is not None) == bool(words), run.error
    if run.error is not None:
        assert run.executed == []
        assert run.states == ["connecting", "checking", "faulted"]
        said = [run.error.what, *(place.removeprefix("also: ") for place in run.error.where
                                  if place.startswith("also: "))]
        assert sorted(re.sub("^(feeder|safety)[^:]*: ", "", one) for one in said) == sorted(reasons)


def safety(act):
    return lambda bench: act(bench.safety)


SAFETY = [
    ("all well", (), None, []),
    ("key off", (), safety(lambda one: one.set_input(SafetyInputBits.KEY_ON, False)),
     ["key switch is off"]),
    ("too little gas", (), safety(lambda one: one.set_shield_gas(8.0)), ["shield gas flows at 8"]),
    ("chiller, oxygen", (), safety(lambda one: (one.set_chiller(30.0, 10.0), one.set_oxygen(2e3))),
     ["the chiller is at 30", "oxygen is at 2000"]),
    ("laser mode", settings((32, 1, 0)), None, ["laser mode is off"]),
]


@pytest.mark.parametrize(("changes", "act", "words"), [one[1:] for one in SAFETY],
                         ids=[one[0] for one in SAFETY])
def test_behind_a_watchdog_relay_doctor_finds_the_same_once_it_may_close_it(
    tmp_path, changes, act, words
):
    profile = load_profile(EXAMPLES / "cell-safe.toml")
    found = unmet(doctor(tmp_path, profile, changes, act, bench="bench-safe.toml",
                         close_relay=True))
    reasons = [one.text for one in found if one.refuses_run]
    assert len(reasons) == len(words), reasons
    for word in words:
        assert sum(word in reason for reason in reasons) == 1, (word, reasons)


def test_without_closing_the_relay_doctor_says_what_it_could_not_see(tmp_path):
    profile = load_profile(EXAMPLES / "cell-safe.toml")
    (unseen,) = unmet(doctor(tmp_path, profile, (), None, bench="bench-safe.toml"))
    assert "its settings cannot be read" in unseen.text
    assert "doctor --close-relay" in unseen.hint
    assert not unseen.refuses_run


def test_doctor_prints_what_it_saw_on_a_silent_wire(tmp_path, profile):
    """A serial feeder asked by a wrong device id, behind which another one answers."""
    here = profile.model_copy(update={"feeder": (
        profile.feeder[0].model_copy(update={"device_id": 3}), profile.feeder[1])})
    found = doctor(tmp_path, here, (('"modbus-tcp://127.0.0.1:5021"', '"pty"'),), None)
    (silent,) = found["feeder F1"]
    assert silent.refuses_run
    assert "no byte came back" in silent.text
    assert "device_id" in silent.hint
    assert all(one.is_met for one in [*found["motion"], *found["feeder F2"]])


def test_a_line_too_slow_for_the_safety_device_is_among_its_conditions():
    safety = load_profile(EXAMPLES / "cell-safe.toml").safety
    slow = safety.model_copy(update={"endpoint": "modbus-rtu:///dev/ttyUSB0?baud=1200"})
    status = read_safety_status([0] * CYCLIC_BLOCK.count, 0.0, safety)
    assert not any("cannot be read every" in one.text for one in safety_conditions(status, safety))
    (line,) = [one for one in safety_conditions(status, slow) if "cannot be read every" in one.text]
    assert line.refuses_run
    assert "raise period_s" in line.hint


@pytest.mark.parametrize(("name", "beam"), [("cell.toml", False), ("cell-safe.toml", True)])
def test_a_beam_that_would_stay_off_is_said_and_refuses_nothing(name, beam):
    profile = load_profile(EXAMPLES / name)
    report = parse_status("<Idle|WPos:0.000,0.000,0.000|Bf:15,128|FS:0,0>")
    identity = ControllerIdentity(DIALECT_GRBL, "1.1h", "", 128, 15)
    reading = MotionReading(report, identity, {}, (), (), True, None, 0)
    said = [one for one in motion_conditions(reading, profile) if "beam stays off" in one.text]
    assert len(said) == (not beam)
    assert not any(one.refuses_run for one in said)
