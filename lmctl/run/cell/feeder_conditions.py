"""What a run requires of a powder feeder before its gas comes on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from firmware_protocol.pmx import FeederMode, FeederStatusBits, HopperStatusBits
from firmware_protocol.pmx_alarms import EMPTY, ESTOP, hopper_alarm_code
from lmctl.config.machine import FeederSettings, HopperSettings
from lmctl.machine.feeder.identity import FeederIdentity
from lmctl.machine.feeder.status import FeederStatus
from lmctl.machine.feeder.warnings import SUBSTITUTE_REMEDIES
from lmctl.run.cell.condition import StartCondition

#: A heartbeat younger than this is another host's [s].
_FOREIGN_S = 5.0
_CLOCK_SLACK = 0.2
#: Alarm codes of what also shows in a flag or a value; there it is named once, by the alarm.
_MIXER, _CONFIGURATION, _LID_NUMBER = 103, 105, 6


@dataclass(frozen=True)
class FeederSnapshot:
    """What a feeder reports about itself: all inputs of the run conditions.

    hopper_limits : of each hopper by name: N_MIN, N_MAX [rpm], CARRIER_MIN, CARRIER_MAX [L/min];
        empty where they have not been read
    is_commanded_by_this_host : whether this host commands it already
    clock_ratio, reply_time_s : as in `FeederInspection`; None where they have not been measured
    """

    identity: FeederIdentity
    status: FeederStatus
    hopper_limits: Mapping[str, Mapping[str, float]]
    is_commanded_by_this_host: bool = False
    clock_ratio: float | None = None
    reply_time_s: float | None = None


def feeder_conditions(
    reading: FeederSnapshot, feeder: FeederSettings, hoppers: Sequence[HopperSettings], *,
    send_horizon_s: float
) -> Iterator[StartCondition]:
    """hoppers : those of the profile that are on it."""
    identity, status = reading.identity, reading.status
    took = ("" if reading.reply_time_s is None
            else f"; answers in {1000 * reading.reply_time_s:.0f} ms")
    yield StartCondition(True, f"{_device_text(identity)}, hoppers: {identity.n_hoppers}{took}")
    missing = dict(identity.substitutions)
    for feature, meaning in missing.items():
        if feature not in SUBSTITUTE_REMEDIES:  # those are among its warnings
            yield StartCondition(True, f"no {feature.replace('_', ' ')}: {meaning}")
    if reading.clock_ratio is not None and identity.reports_tick:
        yield StartCondition(abs(reading.clock_ratio - 1.0) <= _CLOCK_SLACK,
                             f"its clock runs {reading.clock_ratio:.2f} times as fast as ours",
                             "data may be old: restart it, and any gateway before it")
    if not reading.is_commanded_by_this_host and not identity.device:
        yield _alone(status)
    if FeederStatusBits.REMOTE not in identity.unreported:
        yield StartCondition(status.mode is not FeederMode.LOCAL, f"switch at {status.mode.name}",
                             "turn it to REMOTE", refuses_run=True)
    if "alarm" not in missing or status.alarm is not None:
        yield from _alarm(
            status, has_watchdog=FeederStatusBits.WATCHDOG_TRIPPED not in identity.unreported)
    alarmed = None if status.alarm is None else status.alarm.code
    for flag, code, fine, bad, hint in (
        (FeederStatusBits.ESTOP_CHAIN_OK, ESTOP, "e-stop chain closed", "e-stop chain open",
         "release it"),
        (FeederStatusBits.LID_CLOSED, _lid_alarm(alarmed), "lids closed", "a lid is open",
         "close it"),
        (FeederStatusBits.CONFIG_VALID, _CONFIGURATION, "stored configuration valid",
         "stored configuration not valid", "calibrate it at its own display"),
    ):
        if flag in identity.unreported:
            continue
        good = flag in status.flags
        if good or alarmed is None or alarmed != code:  # else its alarm shows it
            yield StartCondition(good, fine if good else bad, hint, refuses_run=True)
    if status.mixer_pressure_mbar is not None and alarmed != _MIXER:
        yield _mixer(status.mixer_pressure_mbar, feeder.mixer_pressure_max_mbar)
    for warning in status.warnings:
        yield StartCondition(False, warning.text, warning.remedy)
    allowed_s = feeder.watchdog_s + min((h.dead_time_s for h in hoppers), default=0.0)
    if "watchdog" not in missing:  # else the relay that stops powder stops motion, too
        yield StartCondition(send_horizon_s < allowed_s,
                             f"send horizon {send_horizon_s:g} s, its watchdog and least dead "
                             f"time {allowed_s:g} s",
                             "lower motion.send_horizon_s: beam must not outlast powder")
    for hopper in hoppers:
        yield from _hopper(reading, hopper)


def _device_text(identity: FeederIdentity) -> str:
    """What the device is, as far as it says."""
    if identity.device:
        return f"{identity.device}, by its register map"
    major, minor = identity.map_version
    return (f"PMX map {major}.{minor}, firmware {identity.firmware[0]}.{identity.firmware[1]}, "
            f"serial {identity.serial}")


def _lid_alarm(code: int | None) -> int | None:
    """The code itself where it is the alarm of some hopper's lid."""
    return code if code is not None and code >= hopper_alarm_code(1,
                                                                  0) and code % 100 == _LID_NUMBER \
        else None


def _alone(status: FeederStatus) -> StartCondition:
    alone = status.heartbeat_age_s >= _FOREIGN_S or FeederStatusBits.REMOTE not in status.flags
    return StartCondition(alone, "no other host drives it" if alone else
                          "another host drives it: its heartbeat came "
                          f"{status.heartbeat_age_s:.1f} s ago",
                          "end what it runs, then start this one")


def _alarm(status: FeederStatus, *, has_watchdog: bool) -> Iterator[StartCondition]:
    """The latched alarm; a watchdog trip is named by itself where it is not that alarm."""
    alarm = status.alarm
    if alarm is not None:
        yield StartCondition(False, alarm.text, f"{alarm.remedy}, then `lmctl machine unlock`",
                             refuses_run=True)
        return
    yield StartCondition(True, "no alarm")
    if not has_watchdog:
        return
    tripped = FeederStatusBits.WATCHDOG_TRIPPED in status.flags
    yield StartCondition(not tripped, "watchdog " + ("tripped" if tripped else "quiet"),
                         "`lmctl machine unlock`", refuses_run=True)


def _mixer(mbar: float, most_mbar: float | None) -> StartCondition:
    if most_mbar is None:
        return StartCondition(True,
                              f"mixer pressure {mbar:g} mbar, and no mixer_pressure_max_mbar in "
                               "the profile: only its own alarm reports a clog")
    return StartCondition(mbar <= most_mbar,
                          f"mixer pressure {mbar:g} mbar, {most_mbar:g} mbar is allowed",
                          "look for a clogged nozzle or kinked hose", refuses_run=True)


def _hopper(reading: FeederSnapshot, hopper: HopperSettings) -> Iterator[StartCondition]:
    of_hopper = reading.status.hoppers.get(hopper.name)
    name = f"hopper {hopper.name} ({hopper.material})"
    if of_hopper is not None:
        alarm = reading.status.alarm
        alarmed = alarm is not None and alarm.code == hopper_alarm_code(hopper.channel, EMPTY)
        present = HopperStatusBits.PRESENT in of_hopper.flags
        empty = HopperStatusBits.LEVEL_EMPTY in of_hopper.flags
        level = ("" if of_hopper.level_percent is None
                 else f", level {of_hopper.level_percent:.0f} %")
        if not (present and empty and alarmed):
            yield StartCondition(present and not empty,
                                 f"{name}: " + ("not there" if not present else "empty" if empty
                                                else "there") + level,
                                 "fill it" if present else "fit it, or take it out of the profile",
                                 refuses_run=True)
    limits = reading.hopper_limits.get(hopper.name)
    if limits is None:
        return
    factor = reading.identity.feed_factor_g_rev[hopper.name]
    least, most = factor * limits["N_MIN"], factor * limits["N_MAX"]
    good = least <= hopper.min_flow_g_min and hopper.max_flow_g_min <= most
    yield StartCondition(good,
                         f"{name}: {factor:g} g/rev, {least:.2f} to {most:.1f} g/min; the profile "
                          f"has {hopper.min_flow_g_min:g} to {hopper.max_flow_g_min:g}",
                         "correct min_flow_g_min and max_flow_g_min in the profile")
    low_gas, high_gas = limits["CARRIER_MIN"], limits["CARRIER_MAX"]
    yield StartCondition(low_gas <= hopper.carrier_L_min <= high_gas,
                         f"{name}: carrier gas {hopper.carrier_L_min:g} L/min of {low_gas:g} to "
                         f"{high_gas:g}", "correct carrier_L_min in the profile")
