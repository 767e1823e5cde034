"""The judge's record: what the simulated machine did, exact at any instant, kept compactly.

Two tables grow as motion is executed. A *block* is one straight move: its N word, its ends and how
its beam is driven. A *phase* is a stretch of one block at constant acceleration, so position and
speed are polynomials of time within it. Between phases the machine stands still. A block and its
phases take about 200 bytes.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from struct import Struct

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulators.motion.actions import BEAM_DYNAMIC, Vector
from simulators.motion.laser_circuit import LaserCircuit
from simulators.motion.planner import Block

FloatArray = NDArray[np.float64]

_BLOCK = 11  # line, start xyz, end xyz, length, rate, beam, floor
_PHASE = 7  # t0, t1, distance at t0, speed at t0, acceleration, power, block
_STAND = 2  # from when, power
_BLOCK_ROW = Struct(f"{_BLOCK}d").pack  # in half the time that an array takes for so many numbers

Phase = tuple[float, float, float, float, float, float, float]
"""Its start and end [s], distance into the block and speed at its start, acceleration, beam power
before any scaling with speed, row of the block."""
_ROUNDING = 1e-6


@dataclass(frozen=True)
class TraceSample:
    """The machine at n instants.

    position_mm : (n, 3) machine coordinates
    speed_mm_s : (n,) along the path
    power_fraction : (n,) beam power over its maximum, 0 to 1
    block : (n,) int, row of `ExecutedBlocks` being executed, -1 when standing still
    """

    position_mm: FloatArray
    speed_mm_s: FloatArray
    power_fraction: FloatArray
    block: NDArray[np.int64]


@dataclass(frozen=True)
class ExecutedBlocks:
    """The moves executed, in order; one that a reset cut short ends where it stopped.

    line : (n,) int, N word, 0 without one
    start_s, end_s : (n,) when it began and ended, holds included
    start_mm, end_mm : (n, 3) machine coordinates
    rate_mm_s : (n,) programmed speed, 0 for a rapid
    beam : (n,) int, BEAM_OFF, BEAM_CONSTANT (M3) or BEAM_DYNAMIC (M4)
    complete : (n,) bool, moved to its end
    share : (n,) of its length that was moved
    """

    line: NDArray[np.int64]
    start_s: FloatArray
    end_s: FloatArray
    start_mm: FloatArray
    end_mm: FloatArray
    rate_mm_s: FloatArray
    beam: NDArray[np.int64]
    complete: NDArray[np.bool_]
    share: FloatArray


@dataclass(frozen=True)
class Phases:
    """Stretches of constant acceleration, in order: from start_s to end_s (n,) each, speed
    speed_mm_s + acceleration_mm_s2 · (t - start_s), in row `block` of `ExecutedBlocks`.

    distance_mm : (n,) into the block at start_s
    power : (n,) beam power over its maximum, before any scaling with speed
    """

    start_s: FloatArray
    end_s: FloatArray
    speed_mm_s: FloatArray
    acceleration_mm_s2: FloatArray
    block: NDArray[np.int64]
    distance_mm: FloatArray
    power: FloatArray


class Trace:
    """The record of one controller. Grows by `begin`, `moved` and `stood`, which the stepper calls.

    moved : to be called with each phase as it is committed
    outputs : (time, kind, port, value) of every digital ("D") or analog ("A") output switched
    laser : its safety circuit; while that is open there is no beam, here as at the nozzle
    """

    def __init__(self, position_mm: Vector) -> None:
        self.outputs: list[tuple[float, str, int, float]] = []
        self.laser = LaserCircuit()
        self._origin = position_mm
        self._blocks = array("d")
        self._phases = array("d")
        self._stands = array("d", (0.0, 0.0))
        self.moved: Callable[[Phase], None] = self._phases.extend
        self.rows = 0
        self._awaited: list[tuple[int, Callable[[int], None]]] = []
        self._rebased_s = -inf
        self._rebased_mm = position_mm
        self._shifts = [(-inf, (0.0, 0.0, 0.0))]

    def await_line(self, line: int, begun: Callable[[int], None]) -> Callable[[], None]:
        """Call begun(row) as the first block whose N word is at least `line` is about to move.

        What is returned stops the waiting.
        """
        waiting = (line, begun)
        self._awaited.append(waiting)
        return lambda: self._awaited.remove(waiting) if waiting in self._awaited else None

    def start_s(self, row: int) -> float | None:
        """When a block among the last ones began to move; None where it has not."""
        phases = self._phases
        began_s = None
        for at in range(len(phases) - _PHASE, -1, -_PHASE):
            if phases[at + _PHASE - 1] < row:
                break
            began_s = phases[at]
        return began_s

    @property
    def shift_mm(self) -> Vector:
        """Where the machine really is, less where its controller takes it to be."""
        return self._shifts[-1][1]

    def rebase(self, when_s: float, believed_mm: Vector, shift_mm: Vector) -> None:
        """Standing still, the controller takes the machine to be elsewhere from now on."""
        self._rebased_s, self._rebased_mm = when_s, believed_mm
        self._shifts.append((when_s, shift_mm))

    def begin(self, block: Block) -> int:
        """A block is about to move; its row."""
        motion = block.motion
        self._blocks.frombytes(
            _BLOCK_ROW(
                motion.line,
                *block.start,
                *block.target,
                block.length,
                0.0 if motion.rapid else motion.rate_mm_s,
                motion.beam,
                motion.floor,
            )
        )
        row = self.rows
        self.rows = row + 1
        if self._awaited:
            self._begun(motion.line, row)
        return row

    def _begun(self, line: int, row: int) -> None:
        for waiting in [one for one in self._awaited if one[0] <= line]:
            self._awaited.remove(waiting)
            waiting[1](row)

    def stood(self, when_s: float, power: float) -> None:
        """From when_s on, the beam burns with this power whenever the machine stands still."""
        stands = self._stands
        while stands[-2] > when_s:  # committed ahead of a reset
            del stands[-_STAND:]
        if stands[-1] != power:
            stands.extend((when_s, power))

    def truncate(self, when_s: float) -> None:
        """Motion stopped dead at when_s: forget what was committed beyond."""
        phases, blocks = self._phases, self._blocks
        while phases and phases[-_PHASE] >= when_s:
            del phases[-_PHASE:]
        if phases and phases[1 - _PHASE] > when_s:
            phases[1 - _PHASE] = when_s
        self.rows = int(phases[-1]) + 1 if phases else 0
        del blocks[self.rows * _BLOCK :]
        self.outputs = [switched for switched in self.outputs if switched[0] <= when_s]

    def position_at(self, when_s: float) -> Vector:
        """Where the controller took the machine to be, shortly before the end of the record.

        No arrays are built.
        """
        phases = self._phases
        at = len(phases) - _PHASE
        while at >= 0 and phases[at] > when_s:
            at -= _PHASE
        if at < 0 or phases[at] < self._rebased_s:
            return self._rebased_mm
        start_s, end_s, distance, speed, acceleration, _, row = phases[at : at + _PHASE]
        dt = min(when_s, end_s) - start_s
        return self._along(int(row), distance + (speed + 0.5 * acceleration * dt) * dt)

    def _along(self, row: int, distance_mm: float) -> Vector:
        _, x0, y0, z0, x1, y1, z1, length, *_ = self._blocks[row * _BLOCK : (row + 1) * _BLOCK]
        part = min(1.0, distance_mm / length)
        return (x0 + (x1 - x0) * part, y0 + (y1 - y0) * part, z0 + (z1 - z0) * part)

    def sample(self, times_s: ArrayLike) -> TraceSample:
        """The machine at any instants, in any order, (n,) seconds on the loop's clock."""
        t = np.atleast_1d(np.asarray(times_s, dtype=np.float64))
        phases, blocks = self._phase_rows(), self._block_rows()
        stands = self._stand_rows()
        standing_power = stands[np.searchsorted(stands[:, 0], t, side="right") - 1, 1]
        if not len(phases):
            still = np.zeros(len(t))
            where = np.tile(np.asarray(self._origin), (len(t), 1))
            return TraceSample(where, still, standing_power, np.full(len(t), -1))
        at = np.searchsorted(phases[:, 0], t, side="right") - 1
        begun = at >= 0
        t0, t1, distance0, speed0, acceleration, power, row = phases[np.maximum(at, 0)].T
        dt = np.clip(t, t0, t1) - t0
        moving = begun & (t < t1)
        speed = np.where(moving, speed0 + acceleration * dt, 0.0)
        block = blocks[row.astype(np.int64)]
        distance = distance0 + (speed0 + 0.5 * acceleration * dt) * dt
        part = np.where(begun, np.minimum(1.0, distance / block[:, 7]), 0.0)[:, None]
        position = block[:, 1:4] + (block[:, 4:7] - block[:, 1:4]) * part
        position += self._shift(t0)
        lit = _beam(power, speed, block)
        return TraceSample(
            position,
            speed,
            np.where(moving, lit, standing_power),
            np.where(moving, row, -1).astype(np.int64),
        )

    def blocks(self) -> ExecutedBlocks:
        """Every block that has begun, up to what is committed."""
        phases, blocks = self._phase_rows(), self._block_rows()
        row = phases[:, 6]
        index = np.arange(len(blocks))
        first = np.searchsorted(row, index, side="left")
        last = np.searchsorted(row, index, side="right") - 1
        begun = last >= first  # a block just loaded has no phase yet
        blocks, first, last = blocks[begun], first[begun], last[begun]
        t0, t1, distance, speed, acceleration = phases[last, :5].T
        dt = t1 - t0
        reached = (distance + (speed + 0.5 * acceleration * dt) * dt) / blocks[:, 7]
        share = np.minimum(1.0, reached)
        shift = self._shift(phases[first, 0])
        start = blocks[:, 1:4] + shift
        end = start + (blocks[:, 4:7] + shift - start) * share[:, None]
        return ExecutedBlocks(
            line=blocks[:, 0].astype(np.int64),
            start_s=phases[first, 0],
            end_s=t1,
            start_mm=start,
            end_mm=end,
            rate_mm_s=blocks[:, 8],
            beam=blocks[:, 9].astype(np.int64),
            complete=reached >= 1.0 - _ROUNDING,
            share=share,
        )

    def phases(self) -> Phases:
        """Every phase committed."""
        t0, t1, distance, speed, acceleration, power, row = self._phase_rows().T
        return Phases(t0, t1, speed, acceleration, row.astype(np.int64), distance, power)

    def standing(self) -> tuple[FloatArray, FloatArray]:
        """From when on the beam burns with which power whenever the machine stands still."""
        stands = self._stand_rows()
        return stands[:, 0], stands[:, 1]

    @property
    def size_bytes(self) -> int:
        """Memory the tables take."""
        return sum(
            table.itemsize * len(table) for table in (self._blocks, self._phases, self._stands)
        )

    def _shift(self, time_s: FloatArray) -> FloatArray:
        """(n, 3) what to add to the controller's positions at each time."""
        since_s, shift = zip(*self._shifts, strict=True)
        return np.asarray(shift)[np.searchsorted(since_s, time_s, side="right") - 1]

    def _phase_rows(self) -> FloatArray:
        return self.laser.darkened(np.array(self._phases, dtype=np.float64).reshape(-1, _PHASE))

    def _stand_rows(self) -> FloatArray:
        stands = np.array(self._stands, dtype=np.float64).reshape(-1, _STAND)
        return self.laser.darkened_stands(stands)

    def _block_rows(self) -> FloatArray:
        return np.array(self._blocks, dtype=np.float64).reshape(-1, _BLOCK)


def _beam(power: FloatArray, speed: FloatArray, block: FloatArray) -> FloatArray:
    """Power while moving: constant, or in proportion to actual over programmed speed."""
    rate, beam, floor = block[:, 8], block[:, 9], block[:, 10]
    dynamic = beam == BEAM_DYNAMIC
    scale = np.divide(speed, rate, out=np.ones_like(speed), where=dynamic & (rate > 0.0))
    wanted = power * scale
    return np.where(wanted > 0.0, np.clip(wanted, floor, 1.0), 0.0)
