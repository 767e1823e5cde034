"""The beam energy per millimetre that a status report shows, against the value of its line.

A report carries speed and power of the motion prepared last (`FS:`). Their quotient is a line's
energy per millimetre, whatever accelerations and feed overrides do under M4 (see `line_energy`).
"""

from __future__ import annotations

from firmware_protocol.status import StatusReport
from lmctl.run.program.job_window import JobWindow

#: How exactly the place reported is known in program time [s].
_KNOWN_WITHIN_S = 0.05

#: Speeds are reported in whole mm/min: at less than this share of the programmed speed the quotient
#: is too inaccurate.
_MIN_SHARE = 0.5


def reported_energy_ratio(
    window: JobWindow, report: StatusReport, s: float, rate: float, power_percent: int,
    lead_s: float,
) -> float | None:
    """Energy per millimetre reported, over that of the line it can belong to.

    s : program time of the place reported; rate : feed override; power_percent : power override
    lead_s : a report's feed and power are ahead of its place by up to so much
    Returns None where the report shows no beam in motion, or lies between lines.
    """
    if report.state != "Run" or not report.feed_mm_min or not report.spindle_speed:
        return None
    most_mm_s, energies_J_mm = window.commanded_between(
        s - _KNOWN_WITHIN_S, s + _KNOWN_WITHIN_S + lead_s * max(rate, 1.0))
    speed_mm_s = report.feed_mm_min / 60.0
    if speed_mm_s < _MIN_SHARE * min(rate, 1.0) * most_mm_s:
        return None
    manifest = window.manifest
    reported = report.spindle_speed * manifest.max_power_W / manifest.s_max / speed_mm_s
    asked = [energy for energy in energies_J_mm if energy > 0.0]
    if not asked:
        return None
    nearest = min(asked, key=lambda energy: abs(energy * power_percent / 100.0 - reported))
    return reported / nearest
