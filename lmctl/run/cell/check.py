"""Is this the machine that the profile describes, in the state that a program may be sent to?

Every setting that matters is compared with the profile. What could hurt part or machine keeps a
run from starting; what only makes it worse than planned is told by `lmctl machine doctor`.

Where the machine is, counts as known when somebody has said so. With homing enabled ($22) that is
the homing cycle: this session's own, or one that grblHAL still vouches for (`H:1`). Without homing
it is the operator, who has put the axes to zero or set the work offset; an alarm or a reset in
motion takes it back until the controller is unlocked, which is the operator's word again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from firmware_protocol.dialect import GRBLHAL
from lmctl.config.machine import MachineProfile
from lmctl.errors import MachineError
from lmctl.machine.motion.driver import MotionDriver
from lmctl.machine.motion.identify import HOMING, LASER_MODE, MOST_SPINDLE, Identity, homing_enabled
from lmctl.run.cell.devices import is_idle

_JUNCTION, _INCHES, _SOFT_LIMITS, _HOMING_TOWARDS, _LEAST_SPINDLE = 11, 13, 20, 23, 31
_MOST_RATE, _ACCELERATION, _TRAVEL = 110, 120, 130
_FORCE_ORIGIN = 8  # bit of grblHAL's $22: zero is where the switches are
_ALIKE = 0.01  # relative difference of settings that does not matter
_SLACK_MM = 0.01
_AXES = "XYZ"


@dataclass(frozen=True)
class Check:
    """One thing looked at. good : it is as it should be; dangerous : no run may begin otherwise.

    text : what was found, in words; hint : what to do, where it is not good
    """

    good: bool
    text: str
    hint: str = ""
    dangerous: bool = False


def check_motion(motion: MotionDriver, profile: MachineProfile) -> None:
    """Raise MachineError where a run must not begin, with all reasons at once."""
    place = f"motion controller at {profile.motion.endpoint}"
    if not is_idle(motion.status):
        state = "unknown" if motion.status is None else motion.status.state
        raise MachineError(
            f"the motion controller is not ready: its state is {state}", where=place,
            hint="find the reason, then `lmctl machine home` or `lmctl machine unlock`",
        )
    found = [
        Check(motion.position_trusted, "the machine has not been homed: nobody knows where it is",
              "`lmctl machine home`", dangerous=True),
        *judge_settings(motion.identity, motion.settings, motion.offset_mm, profile),
    ]
    wrong = [check for check in found if check.dangerous and not check.good]
    if wrong:
        first, *others = wrong
        raise MachineError(
            first.text, where=[place, *(f"also: {check.text}" for check in others)],
            hint="; ".join(dict.fromkeys(check.hint for check in wrong)),
        )


def judge_settings(
    identity: Identity, settings: Mapping[int, str], offset_mm: tuple[float, ...] | None,
    profile: MachineProfile,
) -> Iterator[Check]:
    """Every setting that matters, compared with the profile. offset_mm : work = machine - offset.

    ($10 is judged when a link is opened, by `identify.refuse_unfit`.)
    """
    motion, laser = profile.motion, profile.laser
    yield _equal(settings, LASER_MODE, 1, "laser mode", "M4 would leave the beam on at standstill")
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


def _limits(
    identity: Identity, settings: Mapping[int, str], offset_mm: tuple[float, ...] | None,
    profile: MachineProfile,
) -> Iterator[Check]:
    """Travel, soft limits and homing, which belong together."""
    travel = profile.motion.travel_mm
    ranges = (travel.x, travel.y, travel.z)
    homing = homing_enabled(settings)
    yield from _per_axis(
        settings, _TRAVEL, [high - low for low, high in ranges], "travel", "mm",
        lambda has, wants: has >= wants - _SLACK_MM, "programs could leave it",
        "or correct motion.travel_mm", dangerous=homing,
    )
    if not homing:
        yield Check(True, f"no homing (${HOMING}=0): position is what the operator says, and "
                          "only lmctl keeps axes inside the travel")
        return
    on = settings.get(_SOFT_LIMITS) == "1"
    yield Check(on, f"soft limits {'on' if on else 'off'} (${_SOFT_LIMITS})",
                f"send ${_SOFT_LIMITS}=1 to the controller", dangerous=True)
    if offset_mm is None:
        return
    for axis, (low, high) in enumerate(ranges):
        least, most = _machine_range(identity, settings, axis)
        offset = offset_mm[axis] if axis < len(offset_mm) else 0.0
        yield Check(
            low + offset >= least - _SLACK_MM and high + offset <= most + _SLACK_MM,
            f"{_AXES[axis]} of the profile, {low:g} to {high:g} mm, is {low + offset:g} to "
            f"{high + offset:g} on the controller, which has {least:g} to {most:g}",
            f"`lmctl machine offset {_AXES[axis]}{least - low:g}`, or correct motion.travel_mm",
            dangerous=True,
        )


def _machine_range(
    identity: Identity, settings: Mapping[int, str], axis: int
) -> tuple[float, float]:
    """Reach of an axis in machine coordinates: below zero, unless grblHAL's origin is forced."""
    length = number(settings, _TRAVEL + axis) or 0.0
    forced = identity.dialect is GRBLHAL and int(number(settings, HOMING) or 0) & _FORCE_ORIGIN
    at_low_end = int(number(settings, _HOMING_TOWARDS) or 0) >> axis & 1
    return (0.0, length) if forced and at_low_end else (-length, 0.0)


def number(settings: Mapping[int, str], setting: int) -> float | None:
    """A setting's value, or None where it is missing or no number."""
    try:
        return float(settings.get(setting, ""))
    except ValueError:
        return None


def _equal(
    settings: Mapping[int, str], setting: int, wanted: float, name: str, otherwise: str,
) -> Check:
    """A setting without which no run may begin."""
    stated = settings.get(setting, "missing")
    good = number(settings, setting) == wanted
    text = f"{name}: ${setting}={stated}"
    return Check(good, text if good else f"{text}, not {wanted:g}: {otherwise}",
                 _send(setting, wanted, ""), dangerous=True)


def _full_power(settings: Mapping[int, str], s_max: int) -> Check:
    stated = settings.get(MOST_SPINDLE, "missing")
    good = number(settings, MOST_SPINDLE) == s_max
    return Check(
        good, f"full power is S{stated} on the controller (${MOST_SPINDLE})"
        + ("" if good else f", but S{s_max} in the profile: every power would be wrong"),
        _send(MOST_SPINDLE, s_max, "or correct laser.s_max"), dangerous=True,
    )


def _least_power(settings: Mapping[int, str]) -> Check:
    """$31 is what the beam has at least while it is on: M4 no longer takes it down with the speed.

    A hundredth of full power melts nothing and only makes thin beads a little hotter.
    """
    least, most = number(settings, _LEAST_SPINDLE), number(settings, MOST_SPINDLE)
    stated = settings.get(_LEAST_SPINDLE, "missing")
    text = f"least power: ${_LEAST_SPINDLE}={stated}"
    if least == 0:
        return Check(True, text)
    return Check(
        False, f"{text}, not 0: low powers, and those of slow moves and corners, would be raised "
               "to it", _send(_LEAST_SPINDLE, 0.0, ""),
        dangerous=least is None or not most or abs(least) > _ALIKE * most,
    )


def _near(
    settings: Mapping[int, str], setting: int, wanted: float, name: str, otherwise: str,
    or_else: str = "",
) -> Check:
    stated = number(settings, setting)
    good = stated is not None and abs(stated - wanted) <= _ALIKE * wanted
    text = f"{name}: ${setting}={settings.get(setting, 'missing')}"
    return Check(good, text if good else f"{text}, not {wanted:g}: {otherwise}",
                 _send(setting, wanted, or_else))


def _per_axis(
    settings: Mapping[int, str], first: int, wanted: list[float] | tuple[float, ...], name: str,
    unit: str, good: Callable[[float, float], bool], otherwise: str, or_else: str, *,
    dangerous: bool = False,
) -> Iterator[Check]:
    """$first to $first+2, one check for all axes that are good and one for each that is not."""
    fine = []
    for axis, want in enumerate(wanted):
        has = number(settings, first + axis)
        stated = settings.get(first + axis, "missing")
        if has is not None and good(has, want):
            fine.append(f"{_AXES[axis]} {has:g}")
            continue
        yield Check(
            False, f"{name} of {_AXES[axis]}: ${first + axis}={stated}, the profile has "
                   f"{want:g} {unit}: {otherwise}",
            _send(first + axis, want, or_else), dangerous,
        )
    if fine:
        yield Check(True, f"{name}: {', '.join(fine)} {unit}")


def _blocks(identity: Identity, wanted: int) -> Check:
    has = identity.planner_blocks
    return Check(
        has >= wanted, f"planner: {has} blocks, receive buffer {identity.rx_bytes} bytes"
        + ("" if has >= wanted else f"; the profile has {wanted} blocks: look-ahead is shorter "
           "than planned"),
        f"set motion.planner_blocks = {has} in the profile and plan again",
    )


def _send(setting: int, value: float, or_else: str) -> str:
    return f"send ${setting}={value:g} to the controller" + (f", {or_else}" if or_else else "")
