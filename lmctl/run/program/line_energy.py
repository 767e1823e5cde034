"""Checks reported feed and beam power against the lines that may be running.

G-code has no checksum: a feed or power damaged in transmission that is still a number is answered
`ok`, and stays in force until the next one. But a status report gives feed and beam power (`FS:`).
In M4 both firmwares scale power with speed, during acceleration as under an override, so watts over
millimetres a second stay what the program commands for a line: its energy per millimetre. That
value alone is enough to check a report made anywhere on the line.

A line that ends between two reports is not checked, and a difference below the slack is not found.
"""

from __future__ import annotations

import math

from firmware_protocol.status import StatusReport
from lmctl.run.interlocks.inputs import UncommandedOutput
from lmctl.run.program.job_window import JobWindow

#: How exactly the place reported is known in program time [s].
_KNOWN_WITHIN_S = 0.05

#: So many reports in a row must show the same uncommanded output: one digit may be damaged.
_AGREEING = 3

#: Reports doubted in a row that are compared with the newest.
_KEPT = 8

#: Differences of no consequence: a share of what is asked; of full power, which melts nothing (or
#: a whole S, as power is reported, where the scale is that coarse); and of speed, reported in whole
#: mm/min. Reports agree with the program within a tenth of these.
_SHARE, _OF_FULL, _SPEED_MM_S = 0.03, 0.01, 0.05


class LineEnergyCheck:
    """Looks at the reports of one run.

    lead_s : feed and power are those of the motion prepared last, ahead of the place by so much
    uncommanded_output : reported output that no line which may be running commands, or None
    is_in_doubt : the last report showed it, and too few others agree yet
    bead_short_from_s : program time from which the bead had too little power, inf where it had not

    An override turned at the panel is reported with the feed that shows it, or with the next one,
    so before three reports agree it is known. Where one of them was lost, overrides have to be
    reported anew first, unless the program has the beam off: no override gives that power.
    """

    def __init__(self, window: JobWindow, lead_s: float) -> None:
        self.uncommanded_output: UncommandedOutput | None = None
        self.bead_short_from_s = math.inf
        self._window = window
        self._lead_s = lead_s
        self._full_W = window.manifest.max_power_W
        self._per_S = window.manifest.max_power_W / window.manifest.s_max
        self._least_W = max(_OF_FULL * self._full_W, self._per_S)
        self._overrides: tuple[int, ...] = (100, 100, 100)  # feed, rapid, power, as last reported
        self._rate = 1.0
        self.is_in_doubt = False
        # since the last report that agreed with the program
        self._unconfirmed: list[UncommandedOutput] = []
        self._good_s = -math.inf  # where the last report was that agreed with the program

    def on_report(
        self, report: StatusReport, s: float, rate: float, *, overrides_known: bool = True
    ) -> None:
        """Take a report.

        s : program time of the place it reports; rate : feed override
        overrides_known : no report can have been lost that showed an override
        """
        overrides = (self._overrides if report.override_percents is None
                     else report.override_percents)
        overridden = overrides != self._overrides or rate != self._rate
        self._overrides, self._rate = overrides, rate
        if overridden:  # feed and power before it, and perhaps this one, are of another override
            self._unconfirmed.clear()
        self.is_in_doubt = False
        if self.uncommanded_output is not None:
            return
        found = self._output_not_commanded(report, s, rate)
        if found is None:
            self._good_s, self.bead_short_from_s = s, math.inf
            self._unconfirmed.clear()
            return
        is_beam_uncommanded = found.power_W > 0.0 and not any(found.commanded_powers_W)
        if overridden and not is_beam_uncommanded:
            return
        agreeing = 1 + sum(self._agree(one, found) for one in self._unconfirmed)
        self._unconfirmed = [*self._unconfirmed[-_KEPT:], found]
        if found.power_W < max(found.commanded_powers_W, default=0.0):
            self.bead_short_from_s = self._good_s
        if agreeing >= _AGREEING and (overrides_known or is_beam_uncommanded):
            self.uncommanded_output = found
        else:
            self.is_in_doubt = True

    def _agree(self, one: UncommandedOutput, other: UncommandedOutput) -> bool:
        """Whether two reports agree on feed and power, wherever on a ramp they were made."""
        slack_W = self._least_W + 2.0 * _SHARE * other.power_W
        expected_W = other.power_W
        if one.speed_mm_s > 0.0:
            expected_W = one.power_W * other.speed_mm_s / one.speed_mm_s
        same_energy = abs(expected_W - other.power_W) <= slack_W
        fastest = max(one.speed_mm_s, other.speed_mm_s)
        same_speed = abs(one.speed_mm_s - other.speed_mm_s) <= _SPEED_MM_S + _SHARE * fastest
        same_power = abs(one.power_W - other.power_W) <= slack_W
        return same_energy or (same_speed and same_power)

    def _output_not_commanded(
        self, report: StatusReport, s: float, rate: float
    ) -> UncommandedOutput | None:
        """What is reported but commanded by no line; None too where no motion is reported."""
        if report.state != "Run" or report.feed_mm_min is None or report.spindle_speed is None:
            return None
        speed_mm_s, power_W = report.feed_mm_min / 60.0, report.spindle_speed * self._per_S
        most_mm_s, energies_J_mm = self._window.commanded_between(
            s - _KNOWN_WITHIN_S, s + _KNOWN_WITHIN_S + self._lead_s * max(rate, 1.0)
        )
        most_mm_s *= rate
        slack_W = self._least_W + _SHARE * power_W
        is_asked = any(
            abs(self._power_W(energy, speed_mm_s) - power_W) <= slack_W
            for energy in energies_J_mm or (0.0,)
        )
        # Where all lines wait no speed is asked, and the one before may not be over.
        is_fast = 0.0 < most_mm_s < (speed_mm_s - _SPEED_MM_S) / (1.0 + _SHARE)
        if is_asked and not is_fast:
            return None
        asked_W = {self._power_W(energy, speed_mm_s) for energy in energies_J_mm}
        return UncommandedOutput(speed_mm_s, most_mm_s, power_W, tuple(sorted(asked_W)))

    def _power_W(self, energy_J_mm: float, speed_mm_s: float) -> float:
        asked_W = energy_J_mm * speed_mm_s * self._overrides[2] / 100.0
        return asked_W if asked_W < self._full_W else self._full_W
