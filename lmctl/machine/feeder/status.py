"""A feeder's status in the terms of the cell: hoppers by name, flows in g/min."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from firmware_protocol.pmx import SYSTEM_BLOCK, FeederMode, FeederStateCode, FeederStatusBits
from firmware_protocol.pmx_alarms import SETPOINT_CLIPPED_BIT, FeederAlarm, describe_first_out_alarm
from firmware_protocol.registers import WordOrder
from lmctl.machine.feeder.readings import HopperReading
from lmctl.machine.feeder.warnings import FeederWarning, WarningReader

_TURNING = (FeederStateCode.STABILISING, FeederStateCode.FEEDING)
#: States in which gas flows because it is ordered, and not as post-flow.
GAS_ORDERED_STATES = (FeederStateCode.GAS_PREFLOW, *_TURNING)


class FeederStatus(NamedTuple):
    """One good status reply. time_s : loop time it arrived.

    alarm : the first-out alarm in words, with the others still active; None without one
    warnings : what it warns of; the same object for as long as that is the same
    clipped : it has clipped a set-point: what it feeds is not the recipe
    seq_applied : number of the recipe that is really running
    feeding : discs turn, whether or not the flow has settled
    stable : powder has run long enough to be steady at the nozzle
    """

    time_s: float
    state: FeederStateCode
    mode: FeederMode
    flags: FeederStatusBits
    alarm: FeederAlarm | None
    warnings: tuple[FeederWarning, ...]
    clipped: bool
    seq_applied: int
    heartbeat_age_s: float
    uptime_s: int
    tick_ms: int
    total_gas_L_min: float | None
    mixer_pressure_mbar: float | None
    hoppers: Mapping[str, HopperReading]
    gas_ok: bool
    feeding: bool
    stable: bool


#: The rows of the system block that a status is made of, by the device's word order.
_STATUS_ROWS = {
    order: SYSTEM_BLOCK.with_word_order(order).restricted_to((
        "STATUS", "ALARM", "WARNING", "FIRST_ALARM_CODE", "HEARTBEAT_AGE", "UPTIME", "MODE",
        "STATE", "MIXER_PRESSURE", "TOTAL_GAS", "SEQ_APPLIED", "TICK",
    ))
    for order in WordOrder
}


def read_feeder_status(
    words: Sequence[int], time_s: float, hoppers: Mapping[str, HopperReading],
    warnings: WarningReader, word_order: WordOrder = WordOrder.ABCD,
) -> FeederStatus:
    """The system block's words as a status. warnings : of this feeder, and who its hoppers are.

    Raises RegisterError where their number is wrong; ValueError for an unknown state.
    """
    values: dict[str, Any] = _STATUS_ROWS[word_order].decode(words)
    flags, state = FeederStatusBits(values["STATUS"]), FeederStateCode(values["STATE"])
    code, warned = values["FIRST_ALARM_CODE"], values["WARNING"]
    return FeederStatus(
        time_s=time_s,
        state=state,
        mode=FeederMode(values["MODE"]),
        flags=flags,
        alarm=(warnings.alarms.get(code)
               or describe_first_out_alarm(code, values["ALARM"], warnings.names))
        if code or FeederStatusBits.ALARM in flags else None,
        warnings=warnings.read(warned, hoppers),
        clipped=bool(warned & SETPOINT_CLIPPED_BIT),
        seq_applied=values["SEQ_APPLIED"],
        heartbeat_age_s=values["HEARTBEAT_AGE"] / 1000.0,
        uptime_s=values["UPTIME"],
        tick_ms=values["TICK"],
        total_gas_L_min=values["TOTAL_GAS"],
        mixer_pressure_mbar=values["MIXER_PRESSURE"],
        hoppers=hoppers,
        gas_ok=FeederStatusBits.GAS_OK in flags,
        feeding=state in _TURNING,
        stable=FeederStatusBits.STABLE in flags,
    )


def _ignore_status(status: FeederStatus) -> None:
    pass


def _ignore_fault(reason: str) -> None:
    pass


@dataclass
class FeederCallbacks:
    """Callables that receive a feeder's events; each returns at once.

    on_status : every good status reply
    on_fault : once, the first reason why the feeder can no longer be relied on
    """

    on_status: Callable[[FeederStatus], None] = field(default=_ignore_status)
    on_fault: Callable[[str], None] = field(default=_ignore_fault)
