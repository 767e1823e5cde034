"""What a feeder says about itself, in the terms of the cell: hoppers by name, flows in g/min."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from firmware_protocol.pmx import HopperFlags, Mode, State, Status
from firmware_protocol.pmx_alarms import Alarm


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


@dataclass(frozen=True)
class FeederStatus:
    """One good status reply. time_s : loop time it arrived.

    alarm : the first-out alarm in words, None without one
    seq_applied : number of the recipe that is really running
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

    @property
    def gas_ok(self) -> bool:
        return Status.GAS_OK in self.flags

    @property
    def feeding(self) -> bool:
        """Discs turn, whether or not the flow has settled."""
        return self.state in (State.STABILISING, State.FEEDING)

    @property
    def stable(self) -> bool:
        """Powder has run long enough to be steady at the nozzle."""
        return Status.STABLE in self.flags


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
