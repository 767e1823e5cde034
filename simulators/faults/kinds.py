"""Every fault a simulated cell can have, as data: what it does, with which parameters.

`FAULT_KINDS` is the table; `Fault.create` makes one fault of it, with its parameters checked and
completed. This module only holds data: `faults.injectors` injects the faults.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from simulators.faults.kind import (
    ExpectedReaction,
    FaultKind,
    FaultParameter,
    FaultTarget,
    ParameterValue,
)


@dataclass(frozen=True)
class Fault:
    """One fault. device : name of the link's device or feeder; channel : of a hopper.

    parameters : all of the kind's, each with its value
    """

    kind: FaultKind
    device: str = ""
    channel: int = 0
    parameters: tuple[tuple[str, ParameterValue], ...] = ()

    @classmethod
    def create(cls, kind: str, device: str = "", channel: int = 0,
               **values: ParameterValue) -> Fault:
        """A fault by the name of its kind. Raises ValueError with every mistake, one per line."""
        mistakes = find_mistakes(kind, device, channel, values)
        if mistakes:
            raise ValueError("\n".join(mistakes))
        known = FAULT_KINDS[kind]
        if known.target is FaultTarget.LINK:
            device = device or "motion"
        elif known.target is FaultTarget.HOPPER:
            channel = channel or 1
        given = {p.name: p.default for p in known.parameters if p.default is not None} | values
        return cls(known, device, channel, tuple((p.name, given[p.name]) for p in known.parameters))

    @property
    def values(self) -> dict[str, ParameterValue]:
        """All parameters, by name."""
        return dict(self.parameters)

    def numeric_parameter(self, name: str) -> float:
        """A parameter that is a number."""
        value = self.values[name]
        assert isinstance(value, int | float)
        return float(value)

    def __str__(self) -> str:
        place = f"{self.device}/{self.channel}" if self.channel else self.device
        usual = {p.name: p.default for p in self.kind.parameters}
        asked = ", ".join(f"{name} {v}" for name, v in self.parameters if v != usual[name])
        return self.kind.name + (f" of {place}" if place else "") + (f" ({asked})" if asked else "")


def find_mistakes(
    kind: str, device: str, channel: int, values: Mapping[str, object]
) -> list[str]:
    """Return each mistake in these arguments with its key; empty if they are valid."""
    if kind not in FAULT_KINDS:
        alike = difflib.get_close_matches(kind, FAULT_KINDS, n=1)
        return [f"kind: there is no fault {kind!r}" + "".join(f"; {a!r}?" for a in alike)]
    known = FAULT_KINDS[kind]
    parameters = {parameter.name: parameter for parameter in known.parameters}
    wants_device = known.target in (FaultTarget.MODBUS, FaultTarget.FEEDER, FaultTarget.HOPPER)
    found = []
    if wants_device and not device:
        found.append(f"device: is missing: the name of {known.target.value}")
    elif device and not wants_device and known.target is not FaultTarget.LINK:
        found.append(f"device: {kind} strikes {known.target.value}")
    if channel and known.target is not FaultTarget.HOPPER:
        found.append(f"channel: {kind} strikes {known.target.value}")
    for name, value in values.items():
        if name not in parameters:
            found.append(f"{name}: {kind} has no such parameter")
        elif reason := parameters[name].reason_invalid(value):
            found.append(f"{name}: {reason}")
    found += [
        f"{name}: is missing: {parameter.description}"
        for name, parameter in parameters.items()
        if parameter.default is None and name not in values
    ]
    return found


def _n(name: str, default: int | None, doc: str, most: int, least: int = 1) -> FaultParameter:
    return FaultParameter(name, default, doc, least, most, is_integer=True)


_DIRECTION = FaultParameter(
    "direction", "to_device", "which way the bytes were going", choices=("to_device", "to_host")
)
_COUNT = _n("count", 1, "how many bytes", 1_000_000)
_EVERY = _n("every", 1, "one in so many bytes", 1_000_000)
_PROBABILITY = FaultParameter("probability", 0.1, "that a report is struck", 0, 1)
_REPORTS = _n("count", 0, "how many, 0 for as long as it is active", 1_000_000, 0)
_SEED = _n("seed", 0, "which reports are struck", 1_000_000, 0)
_NOTICED = FaultParameter("noticed", True, "the device raises its own alarm")
_RISES = FaultParameter(
    "rise_s", 0.0, "the pressure rises evenly for so long; it is noticed, and powder minds, then",
    0, 3600)
_REPLIES = _n("count", 1, "how many", 1_000_000)

_M, _L, _B = FaultTarget.MOTION, FaultTarget.LINK, FaultTarget.MODBUS
_F, _H, _S = FaultTarget.FEEDER, FaultTarget.HOPPER, FaultTarget.SAFETY
_STOP, _MAY, _ON = ExpectedReaction.STOP, ExpectedReaction.MAY_STOP, ExpectedReaction.CONTINUE

_MOTION_KINDS = (
    FaultKind("controller_reboots", "the controller loses power and comes back: motion and beam "
              "end at once, its position starts at zero", _M, _STOP, "restarted",
              (FaultParameter("boot_s", 1.5, "silent for so long", 0, 60),)),
    FaultKind("controller_silent", "the controller answers nothing, and goes on with what it has",
              _M, _STOP, "not reported",
              (FaultParameter("receives", False, "it still executes what it receives"),),
              is_lasting=True),
    FaultKind("controller_stalls", "the controller takes no more bytes off its link, and goes on "
              "with what it has", _M, _STOP, "not reported", is_lasting=True),
    FaultKind("controller_lies", "its status reports are frozen", _M, _STOP,
              "position does not follow",
              (FaultParameter("state", "Run", "the state it reports", choices=("Run", "Idle")),),
              is_lasting=True),
    FaultKind("hard_limit", "an axis meets its limit switch: alarm 1, position lost", _M, _STOP,
              "hard limit"),
    FaultKind("soft_limit", "a target outside the travel: alarm 2, position kept", _M, _STOP,
              "soft limit"),
    FaultKind("motion_door", "the controller's own door input opens", _M, _STOP, "door",
              is_lasting=True),
    FaultKind("motion_estop", "the controller's own e-stop input opens", _M, _STOP,
              "emergency", is_lasting=True),
    FaultKind("panel_hold", "feed hold is pressed at the panel", _M, _STOP,
              "hold"),
    FaultKind("panel_start", "cycle start is pressed at the panel", _M, _MAY,
              "cycle start at the panel"),
    FaultKind("panel_override", "overrides are turned at the panel", _M, _ON, "",
              (_n("feed", 100, "percent of the programmed feed", 200, 10),
               _n("rapid", 100, "percent: 25, 50 or 100", 100, 25),
               _n("beam", 100, "percent of the programmed power", 200, 10))),
    FaultKind("ok_lost", "answers of the controller get lost", _M, _MAY,
              "an answer is missing", (_REPLIES,)),
    FaultKind("ok_doubled", "answers of the controller come twice", _M, _MAY,
              "a reply came to no command", (_REPLIES,)),
    FaultKind("reports_garbled", "status reports are damaged on their way; with another digit they "
              "are still reports", _M, _ON, "",
              (_PROBABILITY, _REPORTS, _SEED,
               FaultParameter("how", "any", "what becomes of one",
                              choices=("any", "digit", "byte", "cut"))), is_lasting=True),
    FaultKind("reports_lost", "status reports get lost", _M, _ON, "",
              (_PROBABILITY, _REPORTS, _SEED), is_lasting=True),
    FaultKind("reports_extended", "status reports carry fields of a newer firmware", _M, _ON, "",
              is_lasting=True),
    FaultKind("reports_slow", "the controller looks at '?' every so often; a reset before it has "
              "looked takes the question with it", _M, _ON, "",
              (FaultParameter("look_s", 0.02, "how often", 0.001, 0.5),), is_lasting=True),
    FaultKind("word_garbled", "a place, feed, power or wait of the program is damaged on its "
              "way, and still a number", _M, _MAY, "the program asks for",
              (FaultParameter("letter", "S", "which word", choices=("X", "Y", "Z", "F", "S", "P")),
               FaultParameter("percent", 10.0, "what is left of its value", 0, 1000))),
)

_LINK_KINDS = (
    FaultKind("link_closed", "the link is closed, and refuses to open until the fault is over",
              _L, _STOP, "the link is lost", is_lasting=True),
    FaultKind("bytes_lost", "bytes get lost on the link", _L, _MAY, "the link loses bytes",
              (_DIRECTION, _COUNT, _EVERY)),
    FaultKind("bytes_doubled", "bytes come twice", _L, _MAY, "the link is disturbed",
              (_DIRECTION, _COUNT, _EVERY)),
    FaultKind("bytes_flipped", "a bit of some bytes is flipped", _L, _MAY, "the link is disturbed",
              (_DIRECTION, _COUNT, _EVERY, _n("bit", 0, "which one", 7, 0))),
    FaultKind("bytes_late", "bytes come late, in order", _L, _MAY, "the link is slow",
              (_DIRECTION, FaultParameter("late_s", 0.5, "by how much", 0.001, 60)),
              is_lasting=True),
    FaultKind("garbage_echoed", "what the host sends comes back as garbage, beside the answers",
              _L, _MAY, "the link is disturbed", is_lasting=True),
)

_MODBUS_KINDS = (
    FaultKind("modbus_exception", "requests are answered by a Modbus exception, and not carried "
              "out", _B, _MAY, "the device refuses requests",
              (_n("code", 4, "1 function, 2 address, 3 value, 4 refused, 5 later, 6 busy, "
                  "10 and 11 gateway", 11), _REPLIES)),
    FaultKind("passing_exceptions", "every request is answered that the device is busy or that its "
              "gateway cannot reach it, and not carried out", _B, _STOP, "no answer",
              (FaultParameter("code", "11", "5 later, 6 busy, 10 no path, 11 no answer behind the "
                              "gateway", choices=("5", "6", "10", "11")),), is_lasting=True),
    FaultKind("half_open", "the device has forgotten the connection: what comes over it is lost, "
              "and a new one works (Modbus TCP)", _B, _ON, "", is_lasting=True),
    FaultKind("stray_bytes", "stray bytes come before each reply", _B, _ON, "",
              (_n("count", 3, "how many", 64),), is_lasting=True),
    FaultKind("requests_echoed", "each request comes back as it was sent, before its reply", _B,
              _ON, "", is_lasting=True),
    FaultKind("replies_slow", "replies come late", _B, _MAY, "no answer",
              (FaultParameter("late_s", 0.5, "by how much", 0.001, 60),), is_lasting=True),
    FaultKind("replies_dropped", "requests are carried out, but not answered", _B, _MAY,
              "no answer", (_REPLIES,)),
    FaultKind("replies_doubled", "replies come twice", _B, _ON, "", (_REPLIES,)),
    FaultKind("device_silent", "it neither receives nor answers", _B, _STOP, "no answer",
              is_lasting=True),
)

_FEEDER_KINDS = (
    FaultKind("feeder_restarts", "power off and on: discs stop, everything volatile is forgotten",
              _F, _STOP, "restarted"),
    FaultKind("feeder_local", "an operator turns its switch to LOCAL", _F, _STOP,
              "LOCAL", is_lasting=True),
    FaultKind("feeder_estop", "the feeder's emergency-stop chain opens", _F, _STOP,
              "emergency", is_lasting=True),
    FaultKind("watchdog_trips", "its watchdog trips, though the host is alive", _F, _STOP,
              "watchdog"),
    FaultKind("data_stale", "its registers do not change, TICK and TOGGLE with them", _F, _STOP,
              "same data", is_lasting=True),
    FaultKind("feeder_lies", "discs are stopped, and it still reports that they feed at set-point",
              _F, _STOP, "by weight", is_lasting=True),
    FaultKind("recipe_ignored", "recipes are taken, but SEQ_APPLIED and discs stay as they are",
              _F, _MAY, "recipe", is_lasting=True),
    FaultKind("supply_low", "the gas supply pressure falls", _F, _STOP, "supply pressure",
              (FaultParameter("bar", 1.0, "to so much", 0, 6), _NOTICED), is_lasting=True),
    FaultKind("over_pressure", "the mixer pressure rises", _F, _STOP, "mixer pressure",
              (_n("mbar", 1500, "to so much", 30_000), _RISES, _NOTICED), is_lasting=True),
    FaultKind("feeder_warns", "it shows a warning", _F, _ON, "",
              (FaultParameter("of", "drift", "what it warns of",
                              choices=("drift", "unsteady flow", "old calibration")),),
                              is_lasting=True),
)

_HOPPER_KINDS = (
    FaultKind("disc_stalls", "the disc stops", _H, _STOP, "stalled", (_NOTICED,), is_lasting=True),
    FaultKind("speed_deviates", "the disc turns faster or slower than commanded", _H, _STOP,
              "speed",
              (FaultParameter("percent", -30.0, "more than commanded", -90, 100), _NOTICED),
              is_lasting=True),
    FaultKind("flow_readback_off", "its flow estimate reads wrong; the flow itself is right", _H,
              _STOP, "flow and set-point differ",
              (FaultParameter("percent", -30.0, "more than there is", -100, 100),),
              is_lasting=True),
    FaultKind("hose_clogs", "mixer pressure rises, and less powder gets through", _H, _STOP,
              "mixer pressure",
              (FaultParameter("share", 0.3, "of the powder that gets through", 0, 1),
               _n("mbar", 900, "mixer pressure", 30_000), _RISES, _NOTICED), is_lasting=True),
    FaultKind("hopper_empty", "the hopper runs empty", _H, _STOP, "empty"),
    FaultKind("hopper_level", "so much powder is left in the hopper", _H, _MAY, "the level is low",
              (FaultParameter("grams", None, "powder left", 0, 1e6),)),
    FaultKind("carrier_low", "less carrier gas than set", _H, _STOP, "carrier gas",
              (FaultParameter("share", 0.5, "of what is set", 0, 1), _NOTICED), is_lasting=True),
    FaultKind("lid_open", "the lid is opened", _H, _STOP, "lid", (_NOTICED,), is_lasting=True),
    FaultKind("below_n_min", "the disc needs a higher speed to turn at all", _H, _STOP,
              "set-point below the least speed",
              (FaultParameter("n_min_rpm", 5.0, "below this it stops", 0, 600),), is_lasting=True),
    FaultKind("disc_limited", "the disc is given another highest speed at its panel; set-points "
              "above it are clipped", _H, _STOP, "clipped",
              (FaultParameter("n_max_rpm", 1.0, "no faster than this", 0, 600),), is_lasting=True),
)

_SAFETY_KINDS = (
    FaultKind("shield_gas_low", "less shield gas flows", _S, _STOP, "shield gas",
              (FaultParameter("flow_L_min", 2.0, "so much", 0, 600),), is_lasting=True),
    FaultKind("chiller_fails", "the chiller's water flows slowly and gets warm", _S, _STOP,
              "chiller",
              (FaultParameter("flow_L_min", 2.0, "so much", 0, 600),
               FaultParameter("temperature_C", 40.0, "so warm", -50, 150)), is_lasting=True),
    FaultKind("oxygen_high", "oxygen rises in the chamber", _S, _STOP, "oxygen",
              (FaultParameter("ppm", 5000.0, "so much", 0, 1e6),), is_lasting=True),
    FaultKind("analyser_invalid", "the oxygen analyser calls its own reading invalid", _S, _STOP,
              "oxygen analyser", is_lasting=True),
    FaultKind("extraction_low", "the extraction draws no air", _S, _STOP, "extraction",
              (FaultParameter("pressure_Pa", 20, "pressure difference at the filter", -30_000,
                              30_000,
                              is_integer=True),), is_lasting=True),
    FaultKind("safety_stuck", "its inputs do not change, TICK with them; heartbeats are echoed", _S,
              _STOP, "same data", is_lasting=True),
    FaultKind("laser_enable_stuck", "the laser-enable contact stays as it is, or welds closed, "
              "whatever is commanded", _S, _MAY, "laser-enable",
              (FaultParameter("contact", "closed", "how it stays", choices=("closed", "as it is")),
               ),
              is_lasting=True),
    FaultKind("laser_enable_drops", "the laser-enable contact opens by itself", _S, _STOP,
              "laser-enable"),
    FaultKind("safety_restarts", "power off and on: its watchdog relay opens", _S, _STOP,
              "restarted"),
)

_CELL_KINDS = (
    FaultKind("estop", "emergency stop is pressed: every device's chain opens",
              FaultTarget.CELL,
              _STOP, "emergency", is_lasting=True),
    FaultKind("door", "the door is opened: every input that senses it", FaultTarget.CELL,
              _STOP,
              "door", is_lasting=True),
    FaultKind("host_killed", "the host's process is killed (SIGKILL) by the test that started it",
              FaultTarget.HOST, _STOP, ""),
)

FAULT_KINDS: Mapping[str, FaultKind] = MappingProxyType({
    kind.name: kind
    for kind in (*_MOTION_KINDS, *_LINK_KINDS, *_MODBUS_KINDS, *_FEEDER_KINDS, *_HOPPER_KINDS,
                 *_SAFETY_KINDS, *_CELL_KINDS)
})
