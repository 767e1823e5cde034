"""Was this job planned for this machine, and does it stay within what the machine can do?

Planning checks this at its end. Running checks it again before anything moves, since a profile may
have changed in between.
"""

from __future__ import annotations

from collections.abc import Sequence

from lmctl.config.machine import MachineProfile
from lmctl.errors import JobError
from lmctl.job.schema import JobManifest

#: Lines a controller must be able to hold ahead, so that motion never starves within the horizon.
LINES_PER_HORIZON = 4
#: Rounding of times and positions.
_SLACK = 1e-6


def check_job(manifest: JobManifest, profile: MachineProfile) -> None:
    """Refuse a job the machine must not run.

    Raises JobError: a job of some layers only, and what `check_limits` finds.
    """
    if manifest.excerpt is not None:
        raise JobError(
            "the job holds layers {} to {} of the part only, for looking".format(*manifest.excerpt),
            where="they would be deposited on nothing", hint="plan the part without --layers")
    check_limits(manifest, profile)


def check_limits(manifest: JobManifest, profile: MachineProfile) -> None:
    """Refuse a job that is not within what the machine can do; all reasons at once.

    Raises JobError: planned for another profile (digest), outside the travel, a line longer than
    the send horizon allows, hoppers with other powders or less flow, power beyond the laser.
    """
    if manifest.profile_digest != profile.planning_digest():
        same_name = manifest.machine == profile.name
        raise JobError(
            f"the job was planned for {manifest.machine!r}"
            + (" as it was then; its profile has changed since" if same_name
               else f", not for {profile.name!r}"),
            where=_differences(manifest, profile),
            hint="plan the part again for this machine",
        )
    wrong = [*travel_violations(*manifest.bounds_mm, profile), *_lines(manifest, profile),
             *_flows(manifest, profile)]
    if wrong:
        raise JobError(f"the job cannot run on {profile.name!r}", where=wrong,
                       hint="plan the part again; `lmctl check` says what is in the way")


def _differences(manifest: JobManifest, profile: MachineProfile) -> list[str]:
    """What visibly differs between the job's machine and the profile."""
    by_name = {hopper.name: hopper for hopper in profile.hopper}
    found = []
    for used in manifest.hoppers:
        hopper = by_name.get(used.name)
        if hopper is None:
            found.append(f"there is no hopper {used.name}")
        elif hopper.material != used.material:
            found.append(f"hopper {used.name} holds {hopper.material}, not {used.material}")
        elif hopper.max_flow_g_min != used.max_flow_g_min:
            found.append(f"hopper {used.name} delivers at most {hopper.max_flow_g_min:g} g/min, "
                         f"not {used.max_flow_g_min:g}")
    for what, planned, now in (
        ("S word of full power", manifest.s_max, profile.laser.s_max),
        ("full power in W", manifest.max_power_W, profile.laser.max_power_W),
        ("send horizon in s", manifest.send_horizon_s, profile.motion.send_horizon_s),
    ):
        if planned != now:
            found.append(f"{what}: {now:g}, planned with {planned:g}")
    return found or ["travel, dynamics, limits or another value planning used"]


def travel_violations(
    low_mm: Sequence[float], high_mm: Sequence[float], profile: MachineProfile
) -> list[str]:
    """One line an axis in which motion between these corners, (3,) each, leaves the travel."""
    travel = profile.motion.travel_mm
    return [
        f"{axis}: reaches {low_mm[i]:.1f} to {high_mm[i]:.1f} mm, "
        f"has {limits[0]:g} to {limits[1]:g}"
        for i, (axis, limits) in enumerate((("x", travel.x), ("y", travel.y), ("z", travel.z)))
        if low_mm[i] < limits[0] - _SLACK or high_mm[i] > limits[1] + _SLACK
    ]


def _lines(manifest: JobManifest, profile: MachineProfile) -> list[str]:
    longest = float(manifest.totals.get("longest_line_s", 0.0))
    allowed = profile.motion.send_horizon_s / LINES_PER_HORIZON
    if longest <= allowed + _SLACK:
        return []
    return [f"its longest line lasts {longest:.3f} s; the send horizon allows {allowed:g}"]


def _flows(manifest: JobManifest, profile: MachineProfile) -> list[str]:
    by_name = {hopper.name: hopper for hopper in profile.hopper}
    peaks: dict[str, float] = manifest.totals.get("peak_flow_g_min", {})
    wrong = []
    for used in manifest.hoppers:
        hopper = by_name.get(used.name)
        if hopper is None or hopper.material != used.material:
            wrong.append(f"there is no hopper {used.name} with {used.material}")
        elif peaks.get(used.name, 0.0) > hopper.max_flow_g_min * (1 + _SLACK):
            wrong.append(f"hopper {used.name} would deliver {peaks[used.name]:.1f} g/min, at most "
                         f"{hopper.max_flow_g_min:g}")
    power = float(manifest.totals.get("peak_power_W", 0.0))
    if power > profile.laser.max_power_W * (1 + _SLACK):
        wrong.append(f"it wants {power:g} W; the laser has {profile.laser.max_power_W:g}")
    return wrong
