"""What a feeder's register map says beyond its registers: which of them is flow, which is an alarm.

A host knows quantities (flow set-point), conditions (powder runs) and commands (gas on); a map
names the registers behind them, and what takes the place of those that a device does not have.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from firmware_protocol.registers import RegisterValue

#: Quantities of the whole device, each with its unit. ALARM_CODE: first-out, 0 for none.
DEVICE_QUANTITIES = {
    "alarm_code": "", "refusal_code": "", "uptime_s": "s", "tick_ms": "ms",
    "total_gas_L_min": "L/min", "mixer_pressure_mbar": "mbar", "stabilise_s": "s",
    "post_flow_s": "s",
}
#: Those that a host writes: times of the profile that the device keeps by itself.
WRITTEN_QUANTITIES = ("stabilise_s", "post_flow_s")
#: Quantities of each hopper.
HOPPER_QUANTITIES = {
    "flow_setpoint_g_min": "g/min", "carrier_setpoint_L_min": "L/min", "flow_g_min": "g/min",
    "weighed_flow_g_min": "g/min", "weight_g": "g", "level_percent": "%", "carrier_L_min": "L/min",
}
#: Quantities that a recipe writes.
SETPOINTS = ("flow_setpoint_g_min", "carrier_setpoint_L_min")
#: Conditions of the whole device, and of each hopper.
DEVICE_CONDITIONS = (
    "remote", "gas_ok", "feeding", "stable", "alarm", "watchdog_tripped", "estop_closed",
    "lids_closed", "config_valid",
)
HOPPER_CONDITIONS = ("level_low", "empty", "clipped", "pressurised", "refilling")
#: Commands in the order in which they are switched on; they are switched off in reverse.
COMMANDS = ("remote", "gas", "feed", "refill", "alarm_reset")

#: How many of the unit on the right one unit of a register is, by the unit of the quantity.
UNIT_FACTORS: Mapping[str, Mapping[str, float]] = {
    "g/min": {"g/min": 1.0, "g/s": 60.0, "g/h": 1 / 60, "kg/h": 1000 / 60, "mg/s": 0.06},
    "L/min": {"L/min": 1.0, "L/h": 1 / 60, "mL/min": 0.001},
    "g": {"g": 1.0, "kg": 1000.0},
    "%": {"%": 1.0, "1": 100.0},
    "mbar": {"mbar": 1.0, "bar": 1000.0, "Pa": 0.01, "kPa": 10.0},
    "s": {"s": 1.0, "ms": 0.001, "min": 60.0, "h": 3600.0},
    "ms": {"ms": 1.0, "s": 1000.0},
    "": {"": 1.0},
}

#: Features that a map either places in registers or declares missing, each with the ways in which a
#: host replaces it: {feature: {way: what it means, in words}}.
SUBSTITUTES: Mapping[str, Mapping[str, str]] = {
    "identity": {"none": "another device at this address is not recognised as such"},
    "atomic_recipe": {"ordered_writes": "set-points are written one after the other and read back: "
                                        "for some milliseconds a mixture is half changed"},
    "watchdog": {"interlock": "powder goes on when the host stops: the watchdog relay of the "
                              "safety device must switch the feeder off"},
    "remote": {"always": "it obeys any host that writes: its own switch is not seen"},
    "feed": {"zero_flow": "powder stops by set-points of 0"},
    "gas": {"by_hand": "the carrier gas is switched by hand, and is taken to flow"},
    "gas_ok": {"timed": "gas counts as flowing after the pre-flow time of the profile"},
    "feeding": {"commanded": "powder counts as running when its command has been read back"},
    "stable": {"timed": "powder counts as stable after the time of the profile"},
    "post_flow": {"timed": "gas flows on for the post-flow time of the profile, timed by this "
                           "host"},
    "flow": {"none": "no flow is reported: a jammed disc is not noticed"},
    "alarm": {"none": "it reports no alarms"},
    "clock": {"none": "old data and a restart of the device are not recognised"},
}


@dataclass(frozen=True)
class MappedQuantity:
    """A quantity in a register: quantity = (register value − zero) · factor.

    register : name of the row; in_hopper : whether each hopper has one
    zero : what the register holds, in its own unit, for 0 of the quantity
    factor : units of the quantity in one unit of the register
    """

    register: str
    in_hopper: bool
    zero: float = 0.0
    factor: float = 1.0

    def from_register(self, value: RegisterValue) -> float | None:
        """The quantity in its unit; None where the register reports none."""
        if not isinstance(value, int | float):
            return None
        return (value - self.zero) * self.factor

    def to_register(self, quantity: float) -> float:
        """What the register is to hold, in its own unit."""
        return quantity / self.factor + self.zero


@dataclass(frozen=True)
class MappedCondition:
    """Whether something is so, by a bit or by the code that a register holds.

    mask : 1 for a coil or a discrete input; else bits of which one must be set; 0: `codes` decides
    codes : values for which it is so
    inverted : it is so where the bit is 0, or the code none of these
    of_all : of a register that each hopper has: in all hoppers, not in any
    """

    register: str
    in_hopper: bool
    mask: int = 0
    codes: tuple[int, ...] = ()
    inverted: bool = False
    of_all: bool = False

    def is_met(self, value: RegisterValue) -> bool:
        """Whether it is so by the register's value; not where the register reports none."""
        if not isinstance(value, int | float):
            return False
        found = bool(int(value) & self.mask) if self.mask else int(value) in self.codes
        return found is not self.inverted


@dataclass(frozen=True)
class MappedAction:
    """One write that a command takes: a bit of a register, or a value for on and one for off.

    mask : bits that are 1 while the command is on; 0: `on` and `off` are written
    off : None: nothing is written to end it, as of a reset. A reset with both is a pulse
    """

    register: str
    in_hopper: bool
    mask: int = 0
    on: int = 1
    off: int | None = 0


@dataclass(frozen=True)
class MappedAlarm:
    """An alarm in plain words. code : of `alarm_code`, or None where `condition` shows it"""

    text: str
    remedy: str
    code: int | None = None
    condition: MappedCondition | None = None


@dataclass(frozen=True)
class FeederMap:
    """How a feeder is commanded and read, in names of its map's rows.

    quantities, hopper_quantities : by their names above; those that the device has
    conditions, hopper_conditions : likewise
    commands : the writes of each command, by its name
    settings : (row, value in its unit), written as the device is opened
    recipe_order : set-points, in the order in which they are written
    commit : row whose change makes the set-points written before it the recipe; applied : row that
        shows the number of the recipe that runs
    heartbeat, watchdog_timeout : rows of the device's own watchdog
    missing : the substitute for each feature that the device lacks
    """

    quantities: Mapping[str, MappedQuantity]
    hopper_quantities: Mapping[str, MappedQuantity]
    conditions: Mapping[str, MappedCondition]
    hopper_conditions: Mapping[str, MappedCondition]
    commands: Mapping[str, tuple[MappedAction, ...]]
    settings: tuple[tuple[str, float], ...] = ()
    recipe_order: tuple[str, ...] = SETPOINTS
    commit: str | None = None
    applied: str | None = None
    heartbeat: str | None = None
    watchdog_timeout: str | None = None
    alarms: tuple[MappedAlarm, ...] = ()
    refusals: Mapping[int, str] = field(default_factory=dict)
    missing: Mapping[str, str] = field(default_factory=dict)

    @property
    def has_watchdog(self) -> bool:
        return self.heartbeat is not None

    def provided_features(self) -> set[str]:
        """Features of `SUBSTITUTES` that have registers, the identity left out."""
        has: dict[str, Any] = {
            "atomic_recipe": self.commit, "watchdog": self.heartbeat,
            "remote": self.conditions.get("remote"), "feed": self.commands.get("feed"),
            "gas": self.commands.get("gas"), "gas_ok": self.conditions.get("gas_ok"),
            "feeding": self.conditions.get("feeding"), "stable": self.conditions.get("stable"),
            "post_flow": self.quantities.get("post_flow_s"),
            "flow": self.hopper_quantities.get("flow_g_min"),
            "alarm": self.alarms or self.conditions.get("alarm")
            or self.quantities.get("alarm_code"),
            "clock": self.quantities.get("tick_ms") or self.quantities.get("uptime_s"),
        }
        return {feature for feature, found in has.items() if found}

    def substitutions(self) -> list[tuple[str, str]]:
        """What is missing and what takes its place: (feature, in words)."""
        return [(feature, SUBSTITUTES[feature][way]) for feature, way in self.missing.items()]

#: What each name in a map file stands for, in words.
MEANINGS: Mapping[str, str] = {
    "alarm_code": "the first-out alarm; 0 for none",
    "refusal_code": "why the last write was refused; 0 for none",
    "uptime_s": "time since power-up: shows a restart",
    "tick_ms": "time stamp of the data: shows old data",
    "total_gas_L_min": "carrier gas of all hoppers",
    "mixer_pressure_mbar": "over ambient; rises when the nozzle clogs",
    "stabilise_s": "time that the device waits before it calls powder stable; written",
    "post_flow_s": "time that its gas flows on after powder; written",
    "flow_setpoint_g_min": "flow that is set; written and read back",
    "carrier_setpoint_L_min": "carrier gas that is set; written and read back",
    "flow_g_min": "flow that the device reports",
    "weighed_flow_g_min": "flow by loss in weight",
    "weight_g": "powder left",
    "level_percent": "level of the hopper",
    "carrier_L_min": "carrier gas that flows",
    "remote": "the host is in command",
    "gas_ok": "carrier gas flows, and its pre-flow is over",
    "feeding": "powder runs",
    "stable": "powder is steady at the nozzle",
    "alarm": "an alarm is latched",
    "watchdog_tripped": "heartbeats stopped, and the device has stopped powder",
    "estop_closed": "the emergency-stop chain is closed",
    "lids_closed": "all lids are closed",
    "config_valid": "the device's stored configuration is valid",
    "level_low": "the level is low",
    "empty": "the hopper is empty",
    "clipped": "the device feeds less than is set",
    "pressurised": "the hopper is under pressure and must not be opened",
    "refilling": "weighing is frozen for a refill",
    "gas": "carrier gas on and off",
    "feed": "powder on and off",
    "refill": "weighing frozen, for a refill",
    "alarm_reset": "clears alarms whose cause is gone",
    "identity": "how the device is told from others",
    "atomic_recipe": "set-points that change at once",
    "watchdog": "the device stops powder when heartbeats stop",
    "post_flow": "gas after powder, timed by the device",
    "flow": "a reported flow",
    "clock": "a time stamp or an uptime",
}
