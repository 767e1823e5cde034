"""Everything that can be checked of a cell without moving or writing anything, all at once."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from firmware_protocol.codes import alarm_meaning
from firmware_protocol.pmx import HopperFlags, Mode, Status
from lmctl.config.machine import Feeder, Hopper, MachineProfile, Safety
from lmctl.errors import LmctlError
from lmctl.machine.by_hand.look_modbus import FeederLook, look_at_feeder, look_at_safety
from lmctl.machine.by_hand.look_motion import MotionLook, look_at_motion
from lmctl.machine.motion.identify import refuse_unfit
from lmctl.machine.safety.status import SafetyStatus
from lmctl.run.cell.check import Check, judge_settings
from lmctl.run.interlocks.facts import Facts, OffProgram
from lmctl.run.interlocks.rule import Finding
from lmctl.run.interlocks.rules import RULES

#: A heartbeat younger than this is another host's [s].
_FOREIGN_S = 5.0
_CLOCK_SLACK = 0.2


@dataclass(frozen=True)
class CellLook:
    """One look at every device of a profile, or the error that it failed with.

    feeders : by name, in the profile's order; safety is None where the profile has none
    """

    motion: MotionLook | LmctlError
    feeders: dict[str, FeederLook | LmctlError]
    safety: SafetyStatus | LmctlError | None


async def look_at(profile: MachineProfile) -> CellLook:
    """Look at all devices at once; one that fails keeps no other from being looked at."""
    names = [feeder.name for feeder in profile.feeder]
    motion, safety, *feeders = await asyncio.gather(
        _or_error(look_at_motion(profile.motion.endpoint, baud=profile.motion.baud)),
        _or_error(look_at_safety(profile.safety)) if profile.safety else asyncio.sleep(0),
        *(_or_error(look_at_feeder(f, hoppers_on(profile, f.name))) for f in profile.feeder),
    )
    return CellLook(motion, dict(zip(names, feeders, strict=True)), safety)


def hoppers_on(profile: MachineProfile, feeder: str) -> list[Hopper]:
    return [hopper for hopper in profile.hopper if hopper.feeder == feeder]


def examine(look: CellLook, profile: MachineProfile) -> dict[str, list[Check]]:
    """What a look has found, device by device."""
    found = {"motion": list(_motion(look.motion, profile))}
    for feeder in profile.feeder:
        hoppers = hoppers_on(profile, feeder.name)
        found[f"feeder {feeder.name}"] = list(
            _feeder(look.feeders[feeder.name], feeder, hoppers, profile)
        )
    if look.safety is not None and profile.safety is not None:
        found["safety"] = list(_safety(look.safety, profile.safety))
    return found


async def _or_error(look: Coroutine[Any, Any, Any]) -> Any:
    try:
        return await look
    except LmctlError as error:
        return error


def _unreachable(error: LmctlError) -> Check:
    return Check(False, "; ".join([error.what, *error.where]), error.hint, dangerous=True)


def _motion(look: MotionLook | LmctlError, profile: MachineProfile) -> Iterator[Check]:
    if isinstance(look, LmctlError):
        yield _unreachable(look)
        return
    state = look.report.state
    if look.identity is None:
        relay = profile.safety is not None and profile.safety.relay_timeout_s is not None
        yield Check(
            False, f"it is in state {state}: settings cannot be read",
            "close the door" + (
                "; with the door closed it is the watchdog relay, which is open while no host "
                "heartbeats, as it should be: a run closes it and checks the settings" if relay
                else ""
            ) if state == "Door" else "wait until it stands, or end the hold, then try again",
        )
        return
    identity = look.identity
    yield Check(True, f"{identity.dialect.name} {identity.version} answers"
                      + (" (the bench)" if identity.is_bench else ""))
    yield Check(not look.damaged, f"link: {look.damaged} damaged messages",
                "check cable, shielding and baud rate")
    yield _state(look)
    yield Check(look.position_trusted, "position is "
                + ("trusted" if look.position_trusted else "not to be trusted"),
                "`lmctl machine home`", dangerous=True)
    if not look.settings:
        yield Check(False, "it does not tell its settings", "clear its alarm, then try again")
        return
    try:
        refuse_unfit(identity, look.settings, profile.motion.endpoint)
        yield Check(True, "status reports tell executed lines from planned ones ($10)")
    except LmctlError as error:
        yield Check(False, error.what, error.hint, dangerous=True)
    yield from judge_settings(identity, look.settings, look.offset_mm, profile)


def _state(look: MotionLook) -> Check:
    report = look.report
    if report.state != "Alarm" or look.identity is None:
        return Check(report.state == "Idle", f"state {report.state}", "bring it to Idle")
    if report.substate is None:
        return Check(False, "it is locked by an alarm",
                     "`lmctl machine home` or `lmctl machine unlock`", dangerous=True)
    meaning = alarm_meaning(report.substate, look.identity.dialect)
    return Check(False, f"alarm {report.substate}: {meaning.words}", meaning.remedy, dangerous=True)


def _feeder(
    look: FeederLook | LmctlError, feeder: Feeder, hoppers: Sequence[Hopper],
    profile: MachineProfile,
) -> Iterator[Check]:
    if isinstance(look, LmctlError):
        yield _unreachable(look)
        return
    identity, status = look.identity, look.status
    major, minor = identity.map_version
    yield Check(True, f"PMX map {major}.{minor}, firmware {identity.firmware[0]}."
                      f"{identity.firmware[1]}, serial {identity.serial}, hoppers: "
                      f"{identity.n_hoppers}; answers in {1000 * look.answer_s:.0f} ms")
    yield Check(abs(look.clock_ratio - 1.0) <= _CLOCK_SLACK,
                f"its clock runs {look.clock_ratio:.2f} times as fast as ours",
                "data may be old: restart it, and any gateway before it", dangerous=True)
    yield Check(status.mode is not Mode.LOCAL, f"switch at {status.mode.name}",
                "turn it to REMOTE", dangerous=True)
    yield Check(status.alarm is None, status.alarm.text if status.alarm else "no alarm",
                f"{status.alarm.hint}, then `lmctl machine unlock`" if status.alarm else "",
                dangerous=True)
    tripped = Status.WATCHDOG_TRIPPED in status.flags
    yield Check(not tripped, "watchdog " + ("tripped" if tripped else "quiet"),
                "`lmctl machine unlock`", dangerous=True)
    alone = status.heartbeat_age_s >= _FOREIGN_S or Status.REMOTE not in status.flags
    yield Check(alone, "no other host drives it" if alone else
                f"another host drives it: its heartbeat came {status.heartbeat_age_s:.1f} s ago",
                "end that first", dangerous=True)
    for flag, fine, bad, hint in (
        (Status.ESTOP_CHAIN_OK, "e-stop chain closed", "e-stop chain open", "release it"),
        (Status.LID_CLOSED, "lids closed", "a lid is open", "close it"),
        (Status.CONFIG_VALID, "stored configuration valid", "stored configuration not valid",
         "calibrate it at its own display"),
    ):
        good = flag in status.flags
        yield Check(good, fine if good else bad, hint, dangerous=True)
    if status.mixer_pressure_mbar is not None:
        yield _mixer(status.mixer_pressure_mbar, feeder.mixer_pressure_max_mbar)
    for warning in status.warnings:
        yield Check(False, warning.what, warning.hint)
    horizon_s = profile.motion.send_horizon_s
    allowed_s = feeder.watchdog_s + min((h.dead_time_s for h in hoppers), default=0.0)
    yield Check(horizon_s < allowed_s,
                f"send horizon {horizon_s:g} s, its watchdog and least dead time {allowed_s:g} s",
                "lower motion.send_horizon_s: beam must not outlast powder")
    for hopper in hoppers:
        yield from _hopper(look, hopper)


def _mixer(mbar: float, most_mbar: float | None) -> Check:
    if most_mbar is None:
        return Check(True, f"mixer pressure {mbar:g} mbar, and no mixer_pressure_max_mbar in the "
                           "profile: only its own alarm tells of a clog")
    return Check(mbar <= most_mbar, f"mixer pressure {mbar:g} mbar, {most_mbar:g} mbar is allowed",
                 "look for a clogged nozzle or kinked hose", dangerous=True)


def _hopper(look: FeederLook, hopper: Hopper) -> Iterator[Check]:
    reading, limits = look.status.hoppers[hopper.name], look.limits[hopper.name]
    factor = look.identity.feed_factor_g_rev[hopper.name]
    name = f"hopper {hopper.name} ({hopper.material})"
    present = HopperFlags.PRESENT in reading.flags
    empty = HopperFlags.LEVEL_EMPTY in reading.flags
    level = "" if reading.level_percent is None else f", level {reading.level_percent:.0f} %"
    yield Check(present and not empty,
                f"{name}: " + ("not there" if not present else "empty" if empty else "there")
                + level, "fill it" if present else "fit it, or take it out of the profile",
                dangerous=True)
    least, most = factor * limits["N_MIN"], factor * limits["N_MAX"]
    good = least <= hopper.min_flow_g_min and hopper.max_flow_g_min <= most
    yield Check(good, f"{name}: {factor:g} g/rev, {least:.2f} to {most:.1f} g/min; the profile "
                      f"has {hopper.min_flow_g_min:g} to {hopper.max_flow_g_min:g}",
                "correct min_flow_g_min and max_flow_g_min in the profile")
    low_gas, high_gas = limits["CARRIER_MIN"], limits["CARRIER_MAX"]
    yield Check(low_gas <= hopper.carrier_L_min <= high_gas,
                f"{name}: carrier gas {hopper.carrier_L_min:g} L/min of {low_gas:g} to "
                f"{high_gas:g}", "correct carrier_L_min in the profile")


def _safety(status: SafetyStatus | LmctlError, limits: Safety) -> Iterator[Check]:
    if isinstance(status, LmctlError):
        yield _unreachable(status)
        return
    yield Check(status.self_test_ok, "self-test " + ("passed" if status.self_test_ok else "failed"),
                "see the device's own display", dangerous=True)
    wrong = list(_holding(status, limits))
    if not wrong:
        yield Check(True, "every fitted input is good, every value within its limits")
    for one in wrong:
        yield Check(False, one.what, one.hint, dangerous=True)
    oxygen_ppm, warn_ppm = status.oxygen_ppm, limits.oxygen_warn_ppm
    if oxygen_ppm is not None and warn_ppm is not None and oxygen_ppm > warn_ppm:
        yield Check(False, f"oxygen is at {oxygen_ppm:g} ppm, a warning from {warn_ppm:g} ppm on",
                    "purge the chamber")
    if status.first_out is not None:
        yield Check(True, f"what opened first since the last reset: {status.first_out.text}")


def _holding(status: SafetyStatus, limits: Safety) -> Iterator[Finding]:
    """What a run would be refused for. (An open watchdog relay it closes itself.)"""
    facts = Facts(motion=None, still_s=0.0, off_program=OffProgram(), motion_age_s=0.0,
                  motion_period_s=1.0, feeders=(), answers=(),
                  safety=status, safety_age_s=0.0, limits=limits)
    for rule in RULES:
        if rule.of_safety and not rule.latched:
            yield from rule.look(facts)
