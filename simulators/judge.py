"""What a bench did, asked in the words of safety: beam, motion, powder and gas, in machine time.

Everything comes from the simulators' own record, which is exact in time (`lit`, `drawn`); only
powder against what was told is looked at in steps (`record.STEP_S`). Times are the loop's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulators.drawn import DrawnLine, ExecutedLine, drawn_lines, executed_lines
from simulators.faults.edge import Edge
from simulators.feeder.device import PmxDevice
from simulators.lit import SAME_S, Interval, joined, lit_below
from simulators.motion.sim import MotionSim
from simulators.record import BeamPath, BenchRecord

if TYPE_CHECKING:
    from simulators.bench import Bench

#: The beam may be lit so long while the machine stands, or nearly (process.md 5.5).
SLOW_MM_S, SLOW_S = 1.0, 0.05
#: Flows are compared to at least so much [g/s]; less cannot be told from nothing.
_LEAST_G_S = 0.005
#: Discs count as standing at so small a share of their speed.
_STANDS = 0.01


@dataclass(frozen=True)
class PowderLack:
    """The beam was lit from begin_s to end_s while a feeder's powder was not as it should be.

    why : "not stable", or "flow off": the nozzle's flow differs from what was told θ before
    """

    feeder: str
    why: str
    begin_s: float
    end_s: float


@dataclass(frozen=True)
class PowderStop:
    """A feeder's discs were switched off at told_s, and stood at stood_s."""

    feeder: str
    told_s: float
    stood_s: float


class Judge:
    """Asks one bench what it did so far; also after it has been left."""

    def __init__(self, bench: Bench) -> None:
        self._motion: MotionSim = bench.motion
        self._feeders: dict[str, PmxDevice] = dict(bench.feeders)
        self._edges: dict[str, Edge] = dict(bench.edges)
        self.record: BenchRecord = bench.record

    # --- beam and motion

    def beam(self) -> tuple[Interval, ...]:
        """When the beam was lit."""
        return lit_below(math.inf, self._motion.trace, self._now_s())

    def beam_standing(
        self, below_mm_s: float = SLOW_MM_S, longer_than_s: float = SLOW_S
    ) -> tuple[Interval, ...]:
        """When the beam was lit below this speed for longer than that; should be never."""
        slow = lit_below(below_mm_s, self._motion.trace, self._now_s())
        return tuple(one for one in slow if one.lasting_s > longer_than_s)

    def dark_s(self, after_s: float) -> float:
        """The first instant from after_s on at which the beam is dark."""
        at_s = after_s
        for lit in self.beam():
            if lit.begin_s <= at_s < lit.end_s:
                at_s = lit.end_s
        return at_s

    def lit_again_s(self, after_s: float) -> float | None:
        """When the beam is lit next after having been dark from after_s on; None: not so far."""
        dark_s = self.dark_s(after_s)
        return next((lit.begin_s for lit in self.beam() if lit.begin_s >= dark_s), None)

    def last_lit_s(self) -> float | None:
        """When the beam went dark for the last time so far, or now if it is lit; None: never lit"""
        lit = self.beam()
        return lit[-1].end_s if lit else None

    def stood_s(self, after_s: float) -> float:
        """The first instant from after_s on at which the axes stand."""
        phases = self._motion.trace.phases()
        at_s = after_s
        for begin_s, end_s in zip(phases.start_s, phases.end_s, strict=True):
            if begin_s <= at_s + SAME_S and at_s < end_s:
                at_s = float(end_s)
        return at_s

    # --- powder and gas

    def powder_lacks(self, off_by: float = 0.2) -> tuple[PowderLack, ...]:
        """When the beam was lit and moving without the powder it should have had.

        off_by : share of the flow told by which a nozzle's flow may differ. Feeders that never
        fed are not looked at, unless none did.
        """
        path = self.record.beam_path()
        found: list[PowderLack] = []
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
        """The first stop of a feeder's discs from after_s on; None where they still turn."""
        device = self._feeders[feeder]
        device.settle()
        for span in device.spans:
            if after_s <= span.end_s < math.inf:
                slowest_s = max(h.config.drive_lag_s for h in device.hoppers.values())
                return PowderStop(feeder, span.end_s, span.end_s - slowest_s * math.log(_STANDS))
        return None

    def powder_on(self, feeder: str) -> bool:
        """Whether its discs are on now."""
        device = self._feeders[feeder]
        device.settle()
        return device.discs_on

    def gas_off_s(self, feeder: str, after_s: float = -math.inf) -> float | None:
        """When its carrier gas went off first from after_s on; None where it has not."""
        device = self._feeders[feeder]
        device.settle()
        return next((at_s for at_s, on in device.gas if not on and at_s >= after_s), None)

    def gas_on(self, feeder: str, at_s: float) -> bool:
        """Whether its carrier gas was on until at_s."""
        device = self._feeders[feeder]
        device.settle()
        return next((on for since_s, on in reversed(device.gas) if since_s < at_s), False)

    # --- lines

    def lines(self) -> tuple[ExecutedLine, ...]:
        """Every move begun by now, in order."""
        return executed_lines(self._motion.trace, self._now_s())

    def drawn(self) -> tuple[DrawnLine, ...]:
        """What the beam drew, by N word; moves without one are left out."""
        return drawn_lines(self.lines())

    # --- links

    def host_went_s(self, device: str = "motion") -> tuple[float, ...]:
        """When the host's connections to a device ended."""
        return tuple(at_s for at_s, came in self._edges[device].host_was_there if not came)

    @property
    def overruns(self) -> int:
        """Bytes the controller lost because its receive buffer was full."""
        return self._motion.overruns

    def _now_s(self) -> float:
        return self._motion.now_s

    def _flow_off(self, feeder: PmxDevice, path: BeamPath, off_by: float) -> NDArray[np.bool_]:
        off = np.zeros(len(path.time_s), dtype=bool)
        for hopper in feeder.hoppers.values():
            told = hopper.told.nozzle_flow_g_s(path.time_s)
            flow = hopper.process.nozzle_flow_g_s(path.time_s)
            off |= np.abs(flow - told) > off_by * np.maximum(told, _LEAST_G_S)
        return off


def _lacks(
    feeder: str, why: str, path: BeamPath, wrong: NDArray[np.bool_]
) -> list[PowderLack]:
    half = path.duration_s[wrong] / 2
    stretches = np.column_stack([path.time_s[wrong] - half, path.time_s[wrong] + half])
    return [PowderLack(feeder, why, one.begin_s, one.end_s) for one in joined(stretches)]
