"""Which status reports are believed: a report has no checksum, and a changed digit still parses.

A report that a machine cannot have sent is held back until others agree with it; the next one is
asked for within 20 ms (`status_polling`). This module does not know what the program commands;
`lmctl.run.program` checks that.

- A machine at rest reports the same thing twice. So a report of a machine at rest counts when a
  second report agrees with it, or when it agrees with the last one.
- A moving machine gets no farther than its highest speed allows.
- Buffers are no larger than the controller has stated.
- Work offset and overrides come in few reports, and stay in force until the next one. A change
  counts when it was commanded here, or when a second report agrees.
"""

from __future__ import annotations

from collections.abc import Mapping

from firmware_protocol.realtime import RealtimeCommand
from firmware_protocol.status import StatusReport
from lmctl.machine.motion.identity import ControllerIdentity
from lmctl.machine.motion.override_arithmetic import NO_OVERRIDE, overrides_after_byte

#: Reports of one axis position that differ by less count as equal [mm].
_SAME_MM = 0.01

#: What delays of the link may add to the time between two reports [s], and rounding to a way [mm].
_JITTER_S, _SLACK_MM = 0.15, 0.5

#: $110 and up: highest speed of each axis [mm/min].
_HIGHEST_SPEED = 110

#: How many doubtful reports must agree before they are believed.
_AGREEING = 2

#: Doubtful reports kept for comparison.
_KEPT = 8

_MOVING = ("Run", "Jog", "Home")


class StatusReportFilter:
    """Looks at the reports of one controller, in the order they arrive.

    overrides : feed, rapid, spindle [%], as far as they are known
    overrides_missed : a report may have been lost since, and with it the news of an override
    """

    def __init__(self) -> None:
        self.overrides: tuple[int, int, int] = NO_OVERRIDE
        self.overrides_missed = False
        self._commanded = NO_OVERRIDE
        self._claimed_overrides: tuple[int, int, int] | None = None  # reported once
        self._new_overrides: tuple[int, int, int] | None = None  # to go with the next report
        self._offset_mm: tuple[float, ...] | None = None
        self._new_offset_mm: tuple[float, ...] | None = None
        self._claimed_offset_mm: tuple[float, ...] | None = None
        self._blocks_most = self._rx_most = 1 << 30
        self._highest_mm_s: tuple[float, ...] = ()
        self._believed: tuple[float, StatusReport] | None = None
        self._doubtful: list[tuple[float, StatusReport]] = []

    @property
    def is_unsure(self) -> bool:
        """Whether another report is needed to believe an offset or override, or disprove it."""
        return self._claimed_overrides is not None or self._claimed_offset_mm is not None

    def set_controller_info(self, identity: ControllerIdentity,
                            settings: Mapping[int, str]) -> None:
        """Use what the controller has stated of its buffers and axes."""
        self._blocks_most, self._rx_most = identity.planner_blocks, identity.rx_bytes
        stated = [settings.get(_HIGHEST_SPEED + axis, "") for axis in range(3)]
        try:
            self._highest_mm_s = tuple(float(value) / 60.0 for value in stated)
        except ValueError:
            self._highest_mm_s = ()

    def set_work_offset(self, offset_mm: tuple[float, ...]) -> None:
        """The work offset as the controller lists it; counts more than that of one report."""
        self._offset_mm, self._claimed_offset_mm = offset_mm, None

    def on_realtime_sent(self, byte: RealtimeCommand) -> None:
        """A real-time byte was sent: an override reported as commanded is believed at once."""
        self._commanded = overrides_after_byte(byte, self._commanded)

    def on_restart(self) -> None:
        """The controller restarted: overrides are back at 100 %, and it may be anywhere."""
        self.overrides = self._commanded = NO_OVERRIDE
        self.overrides_missed = False
        self._claimed_overrides = None
        self._believed = None
        self._doubtful.clear()

    def on_missed_report(self) -> None:
        """A report was lost or could not be read."""
        self.overrides_missed = True

    def believed_report(self, report: StatusReport, t: float) -> StatusReport | None:
        """The report as far as it is believed, or None where others must agree with it first.

        t : loop time [s]. Offset and overrides are left out of it while they are not believed,
        and go with the next report where they came to be believed by one that was held back.
        """
        if report.override_percents is not None:
            self._take_overrides(report.override_percents)
        if report.offset_mm is not None:
            self._take_offset(report.offset_mm)
        if self._is_doubtful(t, report) and not self._is_confirmed(t, report):
            self._doubtful = [*self._doubtful[1 - _KEPT:], (t, report)]
            return None
        self._believed = t, report
        self._doubtful.clear()
        overrides, self._new_overrides = self._new_overrides, None
        offset_mm, self._new_offset_mm = self._new_offset_mm, None
        if overrides is report.override_percents and offset_mm is report.offset_mm:
            return report
        return report._replace(override_percents=overrides, offset_mm=offset_mm)

    # --- one report ---------------------------------------------------------------------------

    def _is_doubtful(self, t: float, report: StatusReport) -> bool:
        if _place(report) is None:
            return True
        if (report.planner_blocks_free or 0) > self._blocks_most or (
            report.rx_bytes_free or 0) > self._rx_most:
            return True
        if self._believed is None:
            return not _is_moving(report)
        if _is_moving(report):
            return not self._is_reachable(self._believed, t, report)
        return not _says_the_same(self._believed[1], report)

    def _is_confirmed(self, t: float, report: StatusReport) -> bool:
        if _is_moving(report):
            agreeing = [one for one in self._doubtful if self._is_reachable(one, t, report)]
        else:
            agreeing = [one for one in self._doubtful if _says_the_same(one[1], report)]
        return len(agreeing) + 1 >= _AGREEING

    def _is_reachable(
        self, before: tuple[float, StatusReport], t: float, report: StatusReport
    ) -> bool:
        """Whether the machine can have moved so far since an earlier report."""
        from_mm, to_mm = _place(before[1]), _place(report)
        if from_mm is None or to_mm is None or (report.machine_mm is None) is not (
            before[1].machine_mm is None
        ):
            return False
        lasting_s = t - before[0] + _JITTER_S
        return all(
            abs(b - a) <= highest * lasting_s + _SLACK_MM
            for a, b, highest in zip(from_mm, to_mm, self._highest_mm_s, strict=False)
        )

    # --- fields that stay in force ------------------------------------------------------------

    def _take_overrides(self, overrides: tuple[int, int, int]) -> None:
        if overrides in (self.overrides, self._commanded, self._claimed_overrides):
            self.overrides = self._commanded = self._new_overrides = overrides
            self._claimed_overrides, self.overrides_missed = None, False
        else:
            self._claimed_overrides = overrides

    def _take_offset(self, offset_mm: tuple[float, ...]) -> None:
        if self._offset_mm is None or offset_mm in (self._offset_mm, self._claimed_offset_mm):
            self._offset_mm = self._new_offset_mm = offset_mm
            self._claimed_offset_mm = None
        else:
            self._claimed_offset_mm = offset_mm


def _place(report: StatusReport) -> tuple[float, ...] | None:
    return report.work_mm if report.machine_mm is None else report.machine_mm


def _is_moving(report: StatusReport) -> bool:
    return report.state in _MOVING or (report.state in ("Hold", "Door") and not report.is_held)


def _says_the_same(one: StatusReport, other: StatusReport) -> bool:
    """Whether two reports of a machine at rest agree in everything that it would act on."""
    if one[:2] != other[:2] or one.planner_blocks_free != other.planner_blocks_free:
        return False
    a, b = _place(one), _place(other)
    return a is not None and b is not None and one.line_number == other.line_number and all(
        abs(x - y) < _SAME_MM for x, y in zip(a, b, strict=False)
    )
