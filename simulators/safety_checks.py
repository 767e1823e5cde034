"""Safety checks on a bench run: beam, motion, powder and gas, in machine time.

All results come from the simulators' own record, which is exact in time. Only the comparison of
actual with commanded powder flow works in steps (`bench_record.MAX_PIECE_S`). Times are on the
loop's clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulators.beam_intervals import (
    SAME_TIME_TOLERANCE_S,
    TimeInterval,
    beam_on_below_speed,
    merge_intervals,
)
from simulators.bench_record import BeamOnPath, BenchRecord
from simulators.executed_path import (
    BeamOnLine,
    ExecutedLine,
    beam_on_length_by_line,
    executed_lines,
)
from simulators.faults.link_tap import LinkTap
from simulators.feeder.device import PmxFeederDevice
from simulators.motion.simulator import MotionSimulator

if TYPE_CHECKING:
    from simulators.bench import Bench

#: The beam may stay on for SLOW_S while the axes move slower than SLOW_MM_S or are at rest
#: (docs/explanation/safety-and-sequences.md, Sequences).
SLOW_MM_S, SLOW_S = 1.0, 0.05
#: Lower bound of the reference flow [g/s]; a smaller flow cannot be distinguished from zero.
_MIN_G_S = 0.005
#: A disc counts as stopped at this share of its speed.
_STOPPED_FRACTION = 0.01


@dataclass(frozen=True)
class PowderDeficit:
    """The beam was on from begin_s to end_s while a feeder's powder flow was wrong.

    reason : "not stable", or "flow off": the nozzle's flow differs from the flow commanded θ before
    """

    feeder: str
    reason: str
    begin_s: float
    end_s: float


@dataclass(frozen=True)
class PowderStop:
    """A feeder's discs were switched off at commanded_s and had stopped at stopped_s."""

    feeder: str
    commanded_s: float
    stopped_s: float


class SafetyChecks:
    """Checks what one bench did so far; also works after the bench has closed."""

    def __init__(self, bench: Bench) -> None:
        self._motion: MotionSimulator = bench.motion
        self._feeders: dict[str, PmxFeederDevice] = dict(bench.feeders)
        self._edges: dict[str, LinkTap] = dict(bench.edges)
        self.record: BenchRecord = bench.record

    # --- beam and motion

    def beam_on_intervals(self) -> tuple[TimeInterval, ...]:
        """Return the intervals with the beam on."""
        return beam_on_below_speed(math.inf, self._motion.trace, self._now_s())

    def beam_on_without_motion(
        self, below_mm_s: float = SLOW_MM_S, longer_than_s: float = SLOW_S
    ) -> tuple[TimeInterval, ...]:
        """Return beam-on intervals below this speed and longer than that; there should be none."""
        slow = beam_on_below_speed(below_mm_s, self._motion.trace, self._now_s())
        return tuple(one for one in slow if one.duration_s > longer_than_s)

    def beam_off_at_s(self, after_s: float) -> float:
        """Return the first instant from after_s on at which the beam is off."""
        at_s = after_s
        for beam_on in self.beam_on_intervals():
            if beam_on.begin_s <= at_s < beam_on.end_s:
                at_s = beam_on.end_s
        return at_s

    def beam_on_again_at_s(self, after_s: float) -> float | None:
        """Return when the beam next comes on after going off from after_s on; None: not so far."""
        beam_off_s = self.beam_off_at_s(after_s)
        return next((span.begin_s for span in self.beam_on_intervals()
                     if span.begin_s >= beam_off_s), None)

    def beam_last_on_s(self) -> float | None:
        """Return when the beam last went off, or now if it is on; None if it never was on."""
        beam_on = self.beam_on_intervals()
        return beam_on[-1].end_s if beam_on else None

    def axes_stopped_at_s(self, after_s: float) -> float:
        """Return the first instant from after_s on at which the axes are at rest."""
        phases = self._motion.trace.phases()
        at_s = after_s
        for begin_s, end_s in zip(phases.start_s, phases.end_s, strict=True):
            if begin_s <= at_s + SAME_TIME_TOLERANCE_S and at_s < end_s:
                at_s = float(end_s)
        return at_s

    # --- powder and gas

    def powder_deficits(self, off_by: float = 0.2) -> tuple[PowderDeficit, ...]:
        """Return the intervals in which the beam was on and moving without the correct powder flow.

        off_by : share of the commanded flow by which a nozzle's flow may differ. Feeders that
        never fed are not checked, unless no feeder fed.
        """
        path = self.record.beam_on_path()
        found: list[PowderDeficit] = []
        used = {name: f for name, f in self._feeders.items() if f.spans}
        for name, feeder in (used or self._feeders).items():
            stable = np.zeros(len(path.time_s), dtype=bool)
            for span in feeder.spans:
                stable |= (path.time_s >= span.stable_s) & (path.time_s < span.end_s)
            off = stable & self._flow_off(feeder, path, off_by)
            found += _lacks(name, "not stable", path, ~stable)
            found += _lacks(name, "flow off", path, off)
        return tuple(sorted(found, key=lambda lack: lack.begin_s))

    def powder_stop(self, feeder: str, after_s: float = -math.inf) -> PowderStop | None:
        """Return the first stop of a feeder's discs from after_s on; None while they still turn."""
        device = self._feeders[feeder]
        device.advance_to_now()
        for span in device.spans:
            if after_s <= span.end_s < math.inf:
                slowest_s = max(h.config.drive_lag_s for h in device.hoppers.values())
                return PowderStop(
                    feeder, span.end_s, span.end_s - slowest_s * math.log(_STOPPED_FRACTION))
        return None

    def is_powder_on(self, feeder: str) -> bool:
        """Whether the feeder's discs are on now."""
        device = self._feeders[feeder]
        device.advance_to_now()
        return device.discs_on

    def gas_off_at_s(self, feeder: str, after_s: float = -math.inf) -> float | None:
        """Return when the carrier gas first went off from after_s on; None if it has not."""
        device = self._feeders[feeder]
        device.advance_to_now()
        return next((at_s for at_s, on in device.gas if not on and at_s >= after_s), None)

    def is_gas_on(self, feeder: str, at_s: float) -> bool:
        """Whether the feeder's carrier gas was on until at_s."""
        device = self._feeders[feeder]
        device.advance_to_now()
        return next((on for since_s, on in reversed(device.gas) if since_s < at_s), False)

    # --- lines

    def executed_lines(self) -> tuple[ExecutedLine, ...]:
        """Return every move that has begun by now, in order."""
        return executed_lines(self._motion.trace, self._now_s())

    def beam_on_length_by_line(self) -> tuple[BeamOnLine, ...]:
        """Return the beam-on length by N word; moves without an N word are left out."""
        return beam_on_length_by_line(self.executed_lines())

    # --- links

    def host_disconnected_at_s(self, device: str = "motion") -> tuple[float, ...]:
        """Return the times at which the host's connections to a device ended."""
        return tuple(at_s for at_s, came in self._edges[device].host_was_there if not came)

    @property
    def rx_overrun_bytes(self) -> int:
        """Bytes the controller lost because its receive buffer was full."""
        return self._motion.rx_overrun_bytes

    def _now_s(self) -> float:
        return self._motion.now_s

    def _flow_off(self, feeder: PmxFeederDevice, path: BeamOnPath,
                  off_by: float) -> NDArray[np.bool_]:
        off = np.zeros(len(path.time_s), dtype=bool)
        for hopper in feeder.hoppers.values():
            expected = hopper.fault_free_process.nozzle_flow_g_s(path.time_s)
            flow = hopper.process.nozzle_flow_g_s(path.time_s)
            off |= np.abs(flow - expected) > off_by * np.maximum(expected, _MIN_G_S)
        return off


def _lacks(
    feeder: str, why: str, path: BeamOnPath, wrong: NDArray[np.bool_]
) -> list[PowderDeficit]:
    half = path.duration_s[wrong] / 2
    stretches = np.column_stack([path.time_s[wrong] - half, path.time_s[wrong] + half])
    return [PowderDeficit(feeder, why, one.begin_s,
                          one.end_s) for one in merge_intervals(stretches)]
