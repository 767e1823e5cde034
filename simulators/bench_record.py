"""The record of a bench: what came out of the nozzle along the path with the beam on.

It uses only the simulators' own record of motion and powder, not the planning of the job.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulators.array_types import FloatArray
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.hopper import FeedInterval
from simulators.feeder.process import HopperProcess
from simulators.motion.trace import ExecutedBlocks, MotionTrace

#: The beam path is sampled at least once per this length and once per this time.
MAX_PIECE_MM = 0.1
MAX_PIECE_S = 0.02
#: Sampling step of the beam while the machine is at rest.
_STANDING_STEP_S = 0.005
_CHUNK = 500_000


@dataclass(frozen=True)
class BeamOnPath:
    """The path moved with the beam on, in n pieces so short that values are constant within one.

    materials : in the order of the columns below
    time_s, duration_s : (n,) middle and length of each piece in time
    length_mm : (n,) exact path length
    position_mm : (n, 3) at the middle, machine coordinates
    direction : (n, 3) unit vectors along the path, 0 for a move without length
    line : (n,) int, N word of the program line, 0 without one
    power_fraction : (n,) beam power over its maximum
    flow_g_s : (n, n_materials) mass flow at the nozzle
    deposit_mm3_s : (n, n_materials) volume that stays on the part at the best standoff, m·η/ρ
    """

    materials: tuple[str, ...]
    time_s: FloatArray
    duration_s: FloatArray
    length_mm: FloatArray
    position_mm: FloatArray
    direction: FloatArray
    line: NDArray[np.int64]
    power_fraction: FloatArray
    flow_g_s: FloatArray
    deposit_mm3_s: FloatArray

    @property
    def volume_rate_mm3_s(self) -> FloatArray:
        """(n,) total volume deposited per second."""
        return np.asarray(self.deposit_mm3_s.sum(axis=1))

    @property
    def fractions(self) -> FloatArray:
        """(n, n_materials) volume fractions V_i = (m_i η_i/ρ_i)/Σ; NaN where nothing arrives."""
        total = self.volume_rate_mm3_s[:, None]
        return np.divide(
            self.deposit_mm3_s, total, out=np.full_like(self.deposit_mm3_s, np.nan),
            where=total > 0,
        )

    def designed_fractions(self, lines: NDArray[np.integer], fractions: FloatArray) -> FloatArray:
        """Return the designed fractions along the path: (n, n_materials), by each piece's N word.

        lines : (m,) N words; fractions : (m, n_materials) designed for each, in `materials`' order.
        Raises ValueError if the N word of a piece is not in lines.
        """
        order = np.argsort(lines, kind="stable")
        found = np.searchsorted(lines, self.line, sorter=order)
        row = order[np.minimum(found, len(order) - 1)] if len(order) else found
        undesigned = self.line[lines[row] != self.line] if len(order) else self.line
        if len(undesigned):
            raise ValueError(f"the beam drew line {undesigned[0]}, which the design does not have")
        return np.asarray(fractions, dtype=np.float64)[row]

    def length_fraction_within_tolerance(self, designed: FloatArray, tolerance: float) -> float:
        """Share of the path length where every fraction is within tolerance of the designed.

        designed : (n, n_materials). NaN without a path.
        """
        worst = np.abs(self.fractions - designed).max(axis=1, initial=0.0)
        good = np.where(np.isnan(worst), False, worst <= tolerance)
        total = self.length_mm.sum()
        return float(self.length_mm[good].sum() / total) if total > 0 else float("nan")


class BenchRecord:
    """Record of a bench: its motion trace and its feeders. Times are on the loop's clock."""

    def __init__(self, trace: MotionTrace, feeders: Sequence[PmxFeederDevice]) -> None:
        self._trace = trace
        self._feeders = tuple(feeders)

    @property
    def hopper_processes(self) -> tuple[HopperProcess, ...]:
        """The powder of every hopper, with what is true of it, up to now."""
        for feeder in self._feeders:
            feeder.advance_to_now()
        return tuple(
            hopper.process for feeder in self._feeders for hopper in feeder.hoppers.values())

    @property
    def now_s(self) -> float:
        """The feeders' clock; 0 without feeders."""
        return max((feeder.advance_to_now() for feeder in self._feeders), default=0.0)

    def beam_on_path(self, step_mm: float = MAX_PIECE_MM) -> BeamOnPath:
        """Return the path moved with the beam on, cut into pieces of at most step_mm."""
        time_s, duration_s = self._pieces(step_mm)
        kept: list[tuple[NDArray[Any], ...]] = []
        for at in range(0, len(time_s), _CHUNK):
            t, dt = time_s[at : at + _CHUNK], duration_s[at : at + _CHUNK]
            sample = self._trace.sample(t)
            on = (sample.power_fraction > 0) & (sample.block >= 0)
            kept.append((t[on], dt[on], (sample.speed_mm_s * dt)[on], sample.position_mm[on],
                         sample.block[on], sample.power_fraction[on]))
        if not kept:
            kept = [(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros((0, 3)),
                     np.zeros(0, dtype=np.int64), np.zeros(0))]
        t, dt, length, position, block, power = map(np.concatenate, zip(*kept, strict=True))
        materials, flow, deposit = self._powder(t)
        blocks = self._trace.blocks()
        return BeamOnPath(
            materials, t, dt, length, position, _directions(blocks)[block], blocks.line[block],
            power, flow, deposit,
        )

    def beam_on_without_motion(self, longer_than_s: float = 0.0) -> FloatArray:
        """(k, 2) begin and end of the times the beam was on with the machine at rest [s]."""
        phases = self._trace.phases()
        ends = np.concatenate([[0.0], phases.end_s])
        begins = np.concatenate([phases.start_s, [self.now_s]])
        found = [
            _stretches(t[beam_on], np.full(int(beam_on.sum()), _STANDING_STEP_S))
            for begin_s, end_s in zip(ends, begins, strict=True)
            if end_s - begin_s > _STANDING_STEP_S
            for t in [np.arange(begin_s + _STANDING_STEP_S / 2, end_s, _STANDING_STEP_S)]
            for beam_on in [self._trace.sample(t).power_fraction > 0]
            if beam_on.any()
        ]
        stretches = np.concatenate(found) if found else np.zeros((0, 2))
        return stretches[stretches[:, 1] - stretches[:, 0] > longer_than_s]

    def beam_on_without_stable_powder(self) -> FloatArray:
        """(k, 2) begin and end of the times the beam moved while powder was not stable [s].

        Powder is stable while every feeder that was used reports it as stable.
        """
        path = self.beam_on_path()
        used = [feeder.spans for feeder in self._feeders if feeder.spans]
        stable = np.full(len(path.time_s), bool(used))
        for spans in used:
            stable &= _within(path.time_s, spans)
        return _stretches(path.time_s[~stable], path.duration_s[~stable])

    def fed_g(self) -> dict[str, float]:
        """Powder that left the hoppers so far, by material."""
        total: dict[str, float] = {}
        for feeder in self._feeders:
            time_s = feeder.advance_to_now()
            for hopper in feeder.hoppers.values():
                name = hopper.config.material
                total[name] = total.get(name, 0.0) + hopper.process.fed_g(time_s)
        return total

    def _pieces(self, step_mm: float) -> tuple[FloatArray, FloatArray]:
        """Middles and lengths in time of equal parts of every phase.

        Speed is linear within a phase, so its value at the middle times the length is exact.
        """
        phases = self._trace.phases()
        phase_s = phases.end_s - phases.start_s
        beam = self._trace.blocks().beam[phases.block] > 0
        start_s, phase_s = phases.start_s[beam], phase_s[beam]
        speed = phases.speed_mm_s[beam] + 0.5 * phases.acceleration_mm_s2[beam] * phase_s
        parts = np.maximum(np.ceil(speed * phase_s / step_mm), np.ceil(phase_s / MAX_PIECE_S))
        count = np.maximum(parts, 1).astype(np.int64)
        first = np.repeat(np.cumsum(count) - count, count)
        number = np.arange(count.sum()) - first
        part_s = np.repeat(phase_s / count, count)
        return np.repeat(start_s, count) + (number + 0.5) * part_s, part_s

    def _powder(self, time_s: FloatArray) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
        """Materials, and (n, n_materials) flow [g/s] and deposit [mm³/s] at the nozzle."""
        processes = self.hopper_processes
        materials = tuple(dict.fromkeys(process.config.material for process in processes))
        by_hopper = [process.nozzle_flow_g_s(time_s) for process in processes]
        total = np.sum(by_hopper, axis=0) if by_hopper else np.zeros(len(time_s))
        flow = np.zeros((len(time_s), len(materials)))
        deposit = np.zeros_like(flow)
        for process, g_s in zip(processes, by_hopper, strict=True):
            column = materials.index(process.config.material)
            flow[:, column] += g_s
            config = process.config
            caught = config.catch_efficiency * g_s
            if config.catch_in_mixture:
                others = 1.0 - np.divide(g_s, total, out=np.ones_like(total), where=total > 0)
                caught *= 1.0 + config.catch_in_mixture * others
            deposit[:, column] += caught / config.density_g_mm3
        return materials, flow, deposit


def _directions(blocks: ExecutedBlocks) -> FloatArray:
    """(m, 3) unit vectors of the moves, 0 for one without length."""
    along = blocks.end_mm - blocks.start_mm
    length = np.linalg.norm(along, axis=1, keepdims=True)
    return np.asarray(np.divide(along, length, out=np.zeros_like(along), where=length > 0))


def _within(time_s: FloatArray, spans: Sequence[FeedInterval]) -> NDArray[np.bool_]:
    """Whether each time lies in the stable part of a span."""
    begins = np.array([span.stable_s for span in spans])
    ends = np.array([span.end_s for span in spans])
    at = np.searchsorted(begins, time_s, side="right") - 1
    return (at >= 0) & (time_s < ends[np.maximum(at, 0)])


def _stretches(time_s: FloatArray, duration_s: FloatArray) -> FloatArray:
    """(k, 2) begin and end of pieces that follow on each other, given their middles, in order."""
    if not len(time_s):
        return np.zeros((0, 2))
    begin, end = time_s - duration_s / 2, time_s + duration_s / 2
    breaks = np.flatnonzero(begin[1:] - end[:-1] > 1e-6)
    return np.column_stack(
        [begin[np.concatenate([[0], breaks + 1])], end[np.concatenate([breaks, [len(end) - 1]])]]
    )
