"""Every fault a simulated cell can have, as data: what it does, with which parameters.

`KINDS` is the table; `Fault.of` makes one fault of it, with its parameters checked and completed.
Nothing here acts: `faults.board` does.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from simulators.faults.kind import FaultKind, Host, Parameter, Strikes, Value


@dataclass(frozen=True)
class Fault:
    """One fault. device : where the kind strikes a link or feeder; channel : of a hopper.

    parameters : all of the kind's, each with its value
    """

    kind: FaultKind
    device: str = ""
    channel: int = 0
    parameters: tuple[tuple[str, Value], ...] = ()

    @classmethod
    def of(cls, kind: str, device: str = "", channel: int = 0, **values: Value) -> Fault:
        """A fault by the name of its kind. Raises ValueError with every mistake, one a line."""
        mistakes = mistakes_in(kind, device, channel, values)
        if mistakes:
            raise ValueError("\n".join(mistakes))
        known = KINDS[kind]
        if known.strikes is Strikes.LINK:
            device = device or "motion"
        elif known.strikes is Strikes.HOPPER:
            channel = channel or 1
        whole = {p.name: p.default for p in known.parameters if p.default is not None} | values
        return cls(known, device, channel, tuple((p.name, whole[p.name]) for p in known.parameters))

    @property
    def values(self) -> dict[str, Value]:
        """All parameters, by name."""
        return dict(self.parameters)

    def number(self, name: str) -> float:
        """A parameter that is a number."""
        value = self.values[name]
        assert isinstance(value, int | float)
        return float(value)

    def __str__(self) -> str:
        place = f"{self.device}/{self.channel}" if self.channel else self.device
        usual = {p.name: p.default for p in self.kind.parameters}
        asked = ", ".join(f"{name} {v}" for name, v in self.parameters if v != usual[name])
        return self.kind.name + (f" of {place}" if place else "") + (f" ({asked})" if asked else "")


def mistakes_in(
    kind: str, device: str, channel: int, values: Mapping[str, object]
) -> list[str]:
    """Why these do not make a fault, each with the key it is about; empty where they do."""
    if kind not in KINDS:
        alike = difflib.get_close_matches(kind, KINDS, n=1)
        return [f"kind: there is no fault {kind!r}" + "".join(f"; {a!r}?" for a in alike)]
    known = KINDS[kind]
    parameters = {parameter.name: parameter for parameter in known.parameters}
    wants_device = known.strikes in (Strikes.MODBUS, Strikes.FEEDER, Strikes.HOPPER)
    found = []
    if wants_device and not device:
        found.append(f"device: is missing: the name of {known.strikes.value}")
    elif device and not wants_device and known.strikes is not Strikes.LINK:
        found.append(f"device: {kind} strikes {known.strikes.value}")
    if channel and known.strikes is not Strikes.HOPPER:
        found.append(f"channel: {kind} strikes {known.strikes.value}")
    for name, value in values.items():
        if name not in parameters:
            found.append(f"{name}: {kind} has no such parameter")
        elif reason := parameters[name].mistake(value):
            found.append(f"{name}: {reason}")
    found += [
        f"{name}: is missing: {parameter.doc}"
        for name, parameter in parameters.items()
        if parameter.default is None and name not in values
    ]
    return found


def _n(name: str, default: int | None, doc: str, most: int, least: int = 1) -> Parameter:
    return Parameter(name, default, doc, least, most, whole=True)


_DIRECTION = Parameter(
    "direction", "to_device", "which way the bytes were going", choices=("to_device", "to_host")
)
_COUNT = _n("count", 1, "how many bytes", 1_000_000)
_EVERY = _n("every", 1, "one in so many bytes", 1_000_000)
_PROBABILITY = Parameter("probability", 0.1, "that a report is struck", 0, 1)
_REPORTS = _n("count", 0, "how many, 0 for as long as it stands", 1_000_000, 0)
_SEED = _n("seed", 0, "which reports are struck", 1_000_000, 0)
_NOTICED = Parameter("noticed", True, "the device raises its own alarm")
_RISES = Parameter(
    "rise_s", 0.0, "the pressure rises evenly for so long; it is noticed, and powder minds, then",
    0, 3600)
_REPLIES = _n("count", 1, "how many", 1_000_000)

_M, _L, _B = Strikes.MOTION, Strikes.LINK, Strikes.MODBUS
_F, _H, _S = Strikes.FEEDER, Strikes.HOPPER, Strikes.SAFETY
_STOP, _MAY, _ON = Host.STOPS, Host.MAY_STOP, Host.GOES_ON

_MOTION_KINDS = (
    FaultKind("controller_reboots", "the controller loses power and comes back: motion and beam "
              "end at once, its position starts at zero", _M, _STOP, "restarted",
              (Parameter("boot_s", 1.5, "silent for so long", 0, 60),)),
    FaultKind("controller_silent", "the controller answers nothing, and goes on with what it has",
              _M, _STOP, "not reported",
              (Parameter("hears", False, "it still obeys what it is sent"),), lasts=True),
    FaultKind("controller_stalls", "the controller takes no more bytes off its link, and goes on "
              "with what it has", _M, _STOP, "not reported", lasts=True),
    FaultKind("controller_lies", "its status reports are frozen", _M, _STOP,
              "position does not follow",
              (Parameter("state", "Run", "the state it reports", choices=("Run", "Idle")),),
              lasts=True),
    FaultKind("hard_limit", "an axis meets its limit switch: alarm 1, position lost", _M, _STOP,
              "hard limit"),
    FaultKind("soft_limit", "a target outside the travel: alarm 2, position kept", _M, _STOP,
              "soft limit"),
    FaultKind("motion_door", "the controller's own door input opens", _M, _STOP, "door",
              lasts=True),
    FaultKind("motion_estop", "the controller's own e-stop input opens", _M, _STOP,
              "emergency", lasts=True),
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
              "an answer nobody waits for", (_REPLIES,)),
    FaultKind("reports_garbled", "status reports are damaged on their way; with another digit they "
              "are still reports", _M, _ON, "",
              (_PROBABILITY, _REPORTS, _SEED,
               Parameter("how", "any", "what becomes of one",
                         choices=("any", "digit", "byte", "cut"))), lasts=True),
    FaultKind("reports_lost", "status reports get lost", _M, _ON, "",
              (_PROBABILITY, _REPORTS, _SEED), lasts=True),
    FaultKind("reports_extended", "status reports carry fields of a newer firmware", _M, _ON, "",
              lasts=True),
    FaultKind("reports_slow", "the controller looks at '?' every so often; a reset before it has "
              "looked takes the question with it", _M, _ON, "",
              (Parameter("look_s", 0.02, "how often", 0.001, 0.5),), lasts=True),
    FaultKind("word_garbled", "a place, feed, power or wait of the program is damaged on its "
              "way, and still a number", _M, _MAY, "the program asks for",
              (Parameter("letter", "S", "which word", choices=("X", "Y", "Z", "F", "S", "P")),
               Parameter("percent", 10.0, "what is left of its value", 0, 1000))),
)

_LINK_KINDS = (
    FaultKind("link_closed", "the link is closed, and refuses to open until the fault is over",
              _L, _STOP, "the link is lost", lasts=True),
    FaultKind("bytes_lost", "bytes get lost on the link", _L, _MAY, "the link loses bytes",
              (_DIRECTION, _COUNT, _EVERY)),
    FaultKind("bytes_doubled", "bytes come twice", _L, _MAY, "the link is disturbed",
              (_DIRECTION, _COUNT, _EVERY)),
    FaultKind("bytes_flipped", "a bit of some bytes is flipped", _L, _MAY, "the link is disturbed",
              (_DIRECTION, _COUNT, _EVERY, _n("bit", 0, "which one", 7, 0))),
    FaultKind("bytes_late", "bytes come late, in order", _L, _MAY, "the link is slow",
              (_DIRECTION, Parameter("late_s", 0.5, "by how much", 0.001, 60)), lasts=True),
    FaultKind("garbage_echoed", "what the host sends comes back as garbage, beside the answers",
              _L, _MAY, "the link is disturbed", lasts=True),
)

_MODBUS_KINDS = (
    FaultKind("modbus_exception", "requests are answered by a Modbus exception, and not carried "
              "out", _B, _MAY, "the device refuses requests",
              (_n("code", 4, "1 function, 2 address, 3 value, 4 refused, 5 later, 6 busy, "
                  "10 and 11 gateway", 11), _REPLIES)),
    FaultKind("passing_exceptions", "every request is answered that the device is busy or that its "
              "gateway cannot reach it, and not carried out", _B, _STOP, "no answer",
              (Parameter("code", "11", "5 later, 6 busy, 10 no path, 11 no answer behind the "
                         "gateway", choices=("5", "6", "10", "11")),), lasts=True),
    FaultKind("half_open", "the device has forgotten the connection: what comes over it is lost, "
              "and a new one works (Modbus TCP)", _B, _ON, "", lasts=True),
    FaultKind("stray_bytes", "a few bytes that nobody sent come before each reply", _B, _ON, "",
              (_n("count", 3, "how many", 64),), lasts=True),
    FaultKind("requests_echoed", "each request comes back as it was sent, before its reply", _B,
              _ON, "", lasts=True),
    FaultKind("replies_slow", "replies come late", _B, _MAY, "no answer",
              (Parameter("late_s", 0.5, "by how much", 0.001, 60),), lasts=True),
    FaultKind("replies_dropped", "requests are carried out, but not answered", _B, _MAY,
              "no answer", (_REPLIES,)),
    FaultKind("replies_doubled", "replies come twice", _B, _ON, "", (_REPLIES,)),
    FaultKind("device_silent", "it neither hears nor answers", _B, _STOP, "no answer",
              lasts=True),
)

_FEEDER_KINDS = (
    FaultKind("feeder_restarts", "power off and on: discs stop, everything volatile is forgotten",
              _F, _STOP, "restarted"),
    FaultKind("feeder_local", "somebody turns its switch to LOCAL", _F, _STOP,
              "LOCAL", lasts=True),
    FaultKind("feeder_estop", "the feeder's emergency-stop chain opens", _F, _STOP,
              "emergency", lasts=True),
    FaultKind("watchdog_trips", "its watchdog trips, though the host is alive", _F, _STOP,
              "watchdog"),
    FaultKind("data_stale", "its registers stand still, TICK and TOGGLE with them", _F, _STOP,
              "same data", lasts=True),
    FaultKind("feeder_lies", "discs stand, and it goes on telling that they feed at set-point",
              _F, _STOP, "by weight", lasts=True),
    FaultKind("recipe_ignored", "recipes are taken, but SEQ_APPLIED and discs stay as they are",
              _F, _MAY, "recipe", lasts=True),
    FaultKind("supply_low", "the gas supply pressure falls", _F, _STOP, "supply pressure",
              (Parameter("bar", 1.0, "to so much", 0, 6), _NOTICED), lasts=True),
    FaultKind("over_pressure", "the mixer pressure rises", _F, _STOP, "mixer pressure",
              (_n("mbar", 1500, "to so much", 30_000), _RISES, _NOTICED), lasts=True),
    FaultKind("feeder_warns", "it shows a warning", _F, _ON, "",
              (Parameter("of", "drift", "what it warns of",
                         choices=("drift", "unsteady flow", "old calibration")),), lasts=True),
)

_HOPPER_KINDS = (
    FaultKind("disc_stalls", "the disc stands", _H, _STOP, "stalled", (_NOTICED,), lasts=True),
    FaultKind("speed_deviates", "the disc turns faster or slower than told", _H, _STOP,
              "speed",
              (Parameter("percent", -30.0, "more than told", -90, 100), _NOTICED), lasts=True),
    FaultKind("flow_readback_off", "its flow estimate reads wrong; the flow itself is right", _H,
              _STOP, "flow and set-point differ",
              (Parameter("percent", -30.0, "more than there is", -100, 100),), lasts=True),
    FaultKind("hose_clogs", "mixer pressure rises, and less powder gets through", _H, _STOP,
              "mixer pressure",
              (Parameter("share", 0.3, "of the powder that gets through", 0, 1),
               _n("mbar", 900, "mixer pressure", 30_000), _RISES, _NOTICED), lasts=True),
    FaultKind("hopper_empty", "the hopper runs empty", _H, _STOP, "empty"),
    FaultKind("hopper_level", "so much powder is left in the hopper", _H, _MAY, "the level is low",
              (Parameter("grams", None, "powder left", 0, 1e6),)),
    FaultKind("carrier_low", "less carrier gas than set", _H, _STOP, "carrier gas",
              (Parameter("share", 0.5, "of what is set", 0, 1), _NOTICED), lasts=True),
    FaultKind("lid_open", "the lid is opened", _H, _STOP, "lid", (_NOTICED,), lasts=True),
    FaultKind("below_n_min", "the disc needs a higher speed to turn at all", _H, _STOP,
              "set-point below the least speed",
              (Parameter("n_min_rpm", 5.0, "below this it stands", 0, 600),), lasts=True),
    FaultKind("disc_limited", "the disc is given another highest speed at its panel; set-points "
              "above it are clipped", _H, _STOP, "clipped",
              (Parameter("n_max_rpm", 1.0, "no faster than this", 0, 600),), lasts=True),
)

_SAFETY_KINDS = (
    FaultKind("shield_gas_low", "less shield gas flows", _S, _STOP, "shield gas",
              (Parameter("flow_L_min", 2.0, "so much", 0, 600),), lasts=True),
    FaultKind("chiller_fails", "the chiller's water flows slowly and gets warm", _S, _STOP,
              "chiller",
              (Parameter("flow_L_min", 2.0, "so much", 0, 600),
               Parameter("temperature_C", 40.0, "so warm", -50, 150)), lasts=True),
    FaultKind("oxygen_high", "oxygen rises in the chamber", _S, _STOP, "oxygen",
              (Parameter("ppm", 5000.0, "so much", 0, 1e6),), lasts=True),
    FaultKind("analyser_invalid", "the oxygen analyser calls its own reading invalid", _S, _STOP,
              "oxygen analyser", lasts=True),
    FaultKind("extraction_low", "the extraction draws no air", _S, _STOP, "extraction",
              (Parameter("pressure_Pa", 20, "pressure difference at the filter", -30_000, 30_000,
                         whole=True),), lasts=True),
    FaultKind("safety_stuck", "its inputs stand still, TICK with them; heartbeats are echoed", _S,
              _STOP, "same data", lasts=True),
    FaultKind("laser_enable_stuck", "the laser-enable contact stays as it is, or welds closed, "
              "whatever it is told", _S, _MAY, "laser-enable",
              (Parameter("contact", "closed", "how it stays", choices=("closed", "as it is")),),
              lasts=True),
    FaultKind("laser_enable_drops", "the laser-enable contact opens by itself", _S, _STOP,
              "laser-enable"),
    FaultKind("safety_restarts", "power off and on: its watchdog relay opens", _S, _STOP,
              "restarted"),
)

_CELL_KINDS = (
    FaultKind("estop", "somebody presses emergency stop: every device's chain opens", Strikes.CELL,
              _STOP, "emergency", lasts=True),
    FaultKind("door", "somebody opens the door: every input that knows of it", Strikes.CELL, _STOP,
              "door", lasts=True),
    FaultKind("host_killed", "the host's process is killed (SIGKILL), by whoever owns it",
              Strikes.HOST, _STOP, ""),
)

KINDS: Mapping[str, FaultKind] = MappingProxyType({
    kind.name: kind
    for kind in (*_MOTION_KINDS, *_LINK_KINDS, *_MODBUS_KINDS, *_FEEDER_KINDS, *_HOPPER_KINDS,
                 *_SAFETY_KINDS, *_CELL_KINDS)
})
