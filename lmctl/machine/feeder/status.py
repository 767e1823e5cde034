"""What a feeder says about itself, in the terms of the cell: hoppers by name, flows in g/min."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from firmware_protocol.pmx import (
    PMX,
    SYSTEM_BLOCK,
    HopperFlags,
    Mode,
    State,
    Status,
    hopper_names,
    hopper_row,
    mirrored_at,
)
from firmware_protocol.pmx_alarms import Alarm, alarm
from lmctl.config.machine import Hopper


@dataclass(frozen=True)
class HopperReading:
    """One hopper as last read; None where the device says "not available".

    time_s : loop time of the reply; hoppers are read less often than the device itself
    setpoint_g_min : what the disc is asked to feed now, after the device's ramp
    flow_est_g_min : disc speed times feed factor
    flow_weighed_g_min : from the load cell
    """

    time_s: float
    flags: HopperFlags
    setpoint_g_min: float
    flow_est_g_min: float | None
    flow_weighed_g_min: float | None
    weight_g: float | None
    level_percent: float | None
    carrier_L_min: float | None


_TURNING = (State.STABILISING, State.FEEDING)


class FeederStatus(NamedTuple):
    """One good status reply. time_s : loop time it arrived.

    alarm : the first-out alarm in words, None without one
    seq_applied : number of the recipe that is really running
    feeding : discs turn, whether or not the flow has settled
    stable : powder has run long enough to be steady at the nozzle
    """

    time_s: float
    state: State
    mode: Mode
    flags: Status
    alarm: Alarm | None
    alarm_count: int
    warnings: int
    seq_applied: int
    heartbeat_age_s: float
    uptime_s: int
    tick_ms: int
    total_flow_g_min: float | None
    total_gas_L_min: float | None
    mixer_pressure_mbar: float | None
    hoppers: Mapping[str, HopperReading]
    gas_ok: bool
    feeding: bool
    stable: bool


#: The rows of the system block that a status is made of.
_STATUS_ROWS = SYSTEM_BLOCK.only((
    "STATUS", "WARNING", "FIRST_ALARM_CODE", "ALARM_COUNT", "HEARTBEAT_AGE", "UPTIME", "MODE",
    "STATE", "TOTAL_FLOW", "MIXER_PRESSURE", "TOTAL_GAS", "SEQ_APPLIED", "TICK",
))


def feeder_status(
    words: Sequence[int], time_s: float, hoppers: Mapping[str, HopperReading],
    names: Mapping[int, str],
) -> FeederStatus:
    """The system block's words as a status. names : of the hoppers, by channel.

    Raises RegisterError where their number is wrong; ValueError for a state nobody knows.
    """
    values: dict[str, Any] = _STATUS_ROWS.decode(words)
    flags, state = Status(values["STATUS"]), State(values["STATE"])
    code = values["FIRST_ALARM_CODE"]
    return FeederStatus(
        time_s=time_s,
        state=state,
        mode=Mode(values["MODE"]),
        flags=flags,
        alarm=alarm(code, names) if code or Status.ALARM in flags else None,
        alarm_count=values["ALARM_COUNT"],
        warnings=values["WARNING"],
        seq_applied=values["SEQ_APPLIED"],
        heartbeat_age_s=values["HEARTBEAT_AGE"] / 1000.0,
        uptime_s=values["UPTIME"],
        tick_ms=values["TICK"],
        total_flow_g_min=values["TOTAL_FLOW"],
        total_gas_L_min=values["TOTAL_GAS"],
        mixer_pressure_mbar=values["MIXER_PRESSURE"],
        hoppers=hoppers,
        gas_ok=Status.GAS_OK in flags,
        feeding=state in _TURNING,
        stable=Status.STABLE in flags,
    )


#: Rows of a hopper that a reading holds: the first of its block, in one read.
_READ = 11


class HopperReader:
    """Reads one hopper. address, count : of its input registers; mirrored : which of the mirror's.

    feed_factor_g_rev : what the device believes, to tell set-points in g/min
    """

    def __init__(self, hopper: Hopper, feed_factor_g_rev: float) -> None:
        wanted = [
            name for name in hopper_names(hopper.channel)
            if PMX[name].address < 100 * hopper.channel + _READ
        ]
        (self._block,) = PMX.plan_reads(wanted)
        self.address, self.count = self._block.address, self._block.count
        at = mirrored_at(hopper.channel)
        self.mirrored = slice(at, at + self.count)
        self._hopper = hopper
        self._factor = feed_factor_g_rev

    def reading(self, words: Sequence[int], time_s: float) -> HopperReading:
        """Raises RegisterError where the number of words is wrong."""
        values: dict[str, Any] = self._block.decode(words)

        def value(name: str) -> Any:
            return values[hopper_row(self._hopper.channel, name)]

        return HopperReading(
            time_s=time_s,
            flags=HopperFlags(value("STATUS")),
            setpoint_g_min=(value("DISC_RAMPED") or 0.0) * self._factor,
            flow_est_g_min=value("FLOW_EST"),
            flow_weighed_g_min=value("FLOW_LIW"),
            weight_g=value("WEIGHT"),
            level_percent=value("LEVEL"),
            carrier_L_min=value("CARRIER_ACT"),
        )


def _ignore_status(status: FeederStatus) -> None:
    pass


def _ignore_fault(reason: str) -> None:
    pass


@dataclass
class FeederListener:
    """Who hears of a feeder: callables that return at once.

    on_status : every good status reply
    on_fault : once, the first reason why the feeder can no longer be relied on
    """

    on_status: Callable[[FeederStatus], None] = field(default=_ignore_status)
    on_fault: Callable[[str], None] = field(default=_ignore_fault)
