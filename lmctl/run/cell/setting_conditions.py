"""Is this controller set as the profile describes? Every setting that matters is compared.

What could hurt part or machine refuses a run; what only makes it worse than planned is shown by
`lmctl machine doctor`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from firmware_protocol.dialect import GRBLHAL
from lmctl.config.machine import MachineProfile
from lmctl.machine.motion.identity import (
    HOMING,
    LASER_MODE,
    MOST_SPINDLE,
    REPORT_MASK,
    REPORT_OVERRIDES,
    ControllerIdentity,
    is_homing_enabled,
    unsuitable_settings,
)
from lmctl.run.cell.condition import StartCondition

_JUNCTION, _INCHES, _SOFT_LIMITS, _HOMING_TOWARDS, _LEAST_SPINDLE = 11, 13, 20, 23, 31
_MOST_RATE, _ACCELERATION, _TRAVEL = 110, 120, 130
_FORCE_ORIGIN = 8  # bit of grblHAL's $22: zero is where the switches are
_ALIKE = 0.01  # relative difference of settings that does not matter
_SLACK_MM = 0.01
_AXES = "XYZ"


def setting_conditions(
    identity: ControllerIdentity, settings: Mapping[int, str], offset_mm: tuple[float, ...] | None,
    profile: MachineProfile,
) -> Iterator[StartCondition]:
    """Every setting that matters, compared with the profile.

    offset_mm : work = machine - offset
    """
    motion, laser = profile.motion, profile.laser
    yield from _fit_for_programs(identity, settings)
    yield _full_power(settings, laser.s_max)
    yield _equal(settings, _INCHES, 0, "reports in mm", "every position would be misread")
    yield _least_power(settings)
    yield from _per_axis(
        settings, _MOST_RATE, [60.0 * v for v in motion.max_speed_mm_s], "speed", "mm/min",
        lambda has, wants: has >= wants * (1 - _ALIKE), "moves would last longer than planned",
        "or lower motion.max_speed_mm_s",
    )
    yield from _per_axis(
        settings, _ACCELERATION, motion.acceleration_mm_s2, "acceleration", "mm/s²",
        lambda has, wants: abs(has - wants) <= _ALIKE * wants, "planned times would be wrong",
        "or correct motion.acceleration_mm_s2",
    )
    yield _near(settings, _JUNCTION, motion.junction_deviation_mm, "junction deviation",
                "planned times would be wrong", "or correct motion.junction_deviation_mm")
    yield _blocks(identity, motion.planner_blocks)
    yield from _limits(identity, settings, offset_mm, profile)


def _fit_for_programs(identity: ControllerIdentity,
                      settings: Mapping[int, str]) -> Iterator[StartCondition]:
    """$32 and $10, without which no controller is sent a program."""
    unsuitable = {setting.number: setting for setting in unsuitable_settings(identity, settings)}
    for number, fine in (
        (LASER_MODE, f"laser mode is on (${LASER_MODE})"),
        (REPORT_MASK, f"status reports show which lines are executed (${REPORT_MASK})"),
    ):
        wrong = unsuitable.get(number)
        yield StartCondition(wrong is None, fine if wrong is None else wrong.text,
                             "" if wrong is None else _send(number, wrong.value, ""),
                             refuses_run=True)
    if identity.dialect is GRBLHAL and REPORT_MASK not in unsuitable:
        mask = int(number_of(settings, REPORT_MASK) or 0)
        if not mask & REPORT_OVERRIDES:
            yield StartCondition(False,
                                 f"status reports carry no overrides (${REPORT_MASK}={mask}): "
                                   "those pressed at the panel stay unseen",
                                 _send(REPORT_MASK, mask | REPORT_OVERRIDES, ""))


def _limits(
    identity: ControllerIdentity, settings: Mapping[int, str], offset_mm: tuple[float, ...] | None,
    profile: MachineProfile,
) -> Iterator[StartCondition]:
    """Travel, soft limits and homing, which belong together."""
    travel = profile.motion.travel_mm
    ranges = (travel.x, travel.y, travel.z)
    homing = is_homing_enabled(settings)
    yield from _per_axis(
        settings, _TRAVEL, [high - low for low, high in ranges], "travel", "mm",
        lambda has, wants: has >= wants - _SLACK_MM, "programs could leave it",
        "or correct motion.travel_mm", refuses_run=homing,
    )
    if not homing:
        yield StartCondition(True,
                             f"no homing (${HOMING}=0): position is what the operator says, and "
                          "only lmctl keeps axes inside the travel")
        return
    on = settings.get(_SOFT_LIMITS) == "1"
    yield StartCondition(on, f"soft limits {'on' if on else 'off'} (${_SOFT_LIMITS})",
                _send(_SOFT_LIMITS, 1, ""), refuses_run=True)
    if offset_mm is None:
        return
    for axis, (low, high) in enumerate(ranges):
        least, most = _machine_range(identity, settings, axis)
        offset = offset_mm[axis] if axis < len(offset_mm) else 0.0
        yield StartCondition(
            low + offset >= least - _SLACK_MM and high + offset <= most + _SLACK_MM,
            f"{_AXES[axis]} of the profile, {low:g} to {high:g} mm, is {low + offset:g} to "
            f"{high + offset:g} on the controller, which has {least:g} to {most:g}",
            f"`lmctl machine offset {_AXES[axis]}{least - low:g}`, or correct motion.travel_mm",
            refuses_run=True,
        )


def _machine_range(
    identity: ControllerIdentity, settings: Mapping[int, str], axis: int
) -> tuple[float, float]:
    """Reach of an axis in machine coordinates: below zero, unless grblHAL's origin is forced."""
    length = number_of(settings, _TRAVEL + axis) or 0.0
    forced = identity.dialect is GRBLHAL and int(number_of(settings, HOMING) or 0) & _FORCE_ORIGIN
    at_low_end = int(number_of(settings, _HOMING_TOWARDS) or 0) >> axis & 1
    return (0.0, length) if forced and at_low_end else (-length, 0.0)


def number_of(settings: Mapping[int, str], setting: int) -> float | None:
    """A setting's value, or None where it is missing or no number."""
    try:
        return float(settings.get(setting, ""))
    except ValueError:
        return None


def _equal(
    settings: Mapping[int, str], setting: int, wanted: float, name: str, otherwise: str,
) -> StartCondition:
    """A setting without which no run may begin."""
    stated = settings.get(setting, "missing")
    good = number_of(settings, setting) == wanted
    text = f"{name}: ${setting}={stated}"
    return StartCondition(good, text if good else f"{text}, not {wanted:g}: {otherwise}",
                 _send(setting, wanted, ""), refuses_run=True)


def _full_power(settings: Mapping[int, str], s_max: int) -> StartCondition:
    stated = settings.get(MOST_SPINDLE, "missing")
    good = number_of(settings, MOST_SPINDLE) == s_max
    return StartCondition(
        good, f"full power is S{stated} on the controller (${MOST_SPINDLE})"
        + ("" if good else f", but S{s_max} in the profile: every power would be wrong"),
        _send(MOST_SPINDLE, s_max, "or correct laser.s_max"), refuses_run=True,
    )


def _least_power(settings: Mapping[int, str]) -> StartCondition:
    """$31 is what the beam has at least while it is on: M4 no longer takes it down with the speed.

    A hundredth of full power melts nothing and only makes thin beads a little hotter.
    """
    least, most = number_of(settings, _LEAST_SPINDLE), number_of(settings, MOST_SPINDLE)
    stated = settings.get(_LEAST_SPINDLE, "missing")
    text = f"least power: ${_LEAST_SPINDLE}={stated}"
    if least == 0:
        return StartCondition(True, text)
    return StartCondition(
        False, f"{text}, not 0: low powers, and those of slow moves and corners, would be raised "
               "to it", _send(_LEAST_SPINDLE, 0.0, ""),
        refuses_run=least is None or not most or abs(least) > _ALIKE * most,
    )


def _near(
    settings: Mapping[int, str], setting: int, wanted: float, name: str, otherwise: str,
    or_else: str = "",
) -> StartCondition:
    stated = number_of(settings, setting)
    good = stated is not None and abs(stated - wanted) <= _ALIKE * wanted
    text = f"{name}: ${setting}={settings.get(setting, 'missing')}"
    return StartCondition(good, text if good else f"{text}, not {wanted:g}: {otherwise}",
                 _send(setting, wanted, or_else))


def _per_axis(
    settings: Mapping[int, str], first: int, wanted: list[float] | tuple[float, ...], name: str,
    unit: str, good: Callable[[float, float], bool], otherwise: str, or_else: str, *,
    refuses_run: bool = False,
) -> Iterator[StartCondition]:
    """$first to $first+2, one check for all axes that are good and one for each that is not."""
    fine = []
    for axis, want in enumerate(wanted):
        has = number_of(settings, first + axis)
        stated = settings.get(first + axis, "missing")
        if has is not None and good(has, want):
            fine.append(f"{_AXES[axis]} {has:g}")
            continue
        yield StartCondition(
            False, f"{name} of {_AXES[axis]}: ${first + axis}={stated}, the profile has "
                   f"{want:g} {unit}: {otherwise}",
            _send(first + axis, want, or_else), refuses_run,
        )
    if fine:
        yield StartCondition(True, f"{name}: {', '.join(fine)} {unit}")


def _blocks(identity: ControllerIdentity, wanted: int) -> StartCondition:
    has = identity.planner_blocks
    return StartCondition(
        has >= wanted, f"planner: {has} blocks, receive buffer {identity.rx_bytes} bytes"
        + ("" if has >= wanted else f"; the profile has {wanted} blocks: look-ahead is shorter "
           "than planned"),
        f"set motion.planner_blocks = {has} in the profile and plan again",
    )


def _send(setting: int, value: float, or_else: str) -> str:
    """The command that mends a setting."""
    return f"`lmctl machine settings {setting}={value:.6g}`" + (f", {or_else}" if or_else else "")
