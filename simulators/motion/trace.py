"""Reads the record of motion: the simulated machine at any instant, and block by block.

`recording` holds what the stepper writes. This module gives the true axis positions, whatever the
controller assumed, and the beam power including the effect of an open safety circuit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulators.array_types import FloatArray
from simulators.motion.actions import BEAM_DYNAMIC
from simulators.motion.recording import (
    BLOCK_COLUMN_COUNT,
    PHASE_COLUMN_COUNT,
    STANDSTILL_COLUMN_COUNT,
    MotionRecording,
)

_ROUNDING = 1e-6


@dataclass(frozen=True)
class TraceSample:
    """The machine at n instants.

    position_mm : (n, 3) machine coordinates
    speed_mm_s : (n,) along the path
    power_fraction : (n,) beam power over its maximum, 0 to 1
    block : (n,) int, row of `ExecutedBlocks` being executed, -1 at standstill
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
    is_complete : (n,) bool, moved to its end
    executed_fraction : (n,) of its length that was moved
    """

    line: NDArray[np.int64]
    start_s: FloatArray
    end_s: FloatArray
    start_mm: FloatArray
    end_mm: FloatArray
    rate_mm_s: FloatArray
    beam: NDArray[np.int64]
    is_complete: NDArray[np.bool_]
    executed_fraction: FloatArray


@dataclass(frozen=True)
class ConstantAccelerationPhases:
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


class MotionTrace(MotionRecording):
    """A recording that can be read while it grows; every read builds new arrays."""

    def sample(self, times_s: ArrayLike) -> TraceSample:
        """The machine at any instants, in any order, (n,) seconds on the loop's clock."""
        t = np.atleast_1d(np.asarray(times_s, dtype=np.float64))
        phases, blocks = self._phase_rows(), self._block_rows()
        standstill = self._standstill_rows()
        standstill_power = standstill[np.searchsorted(standstill[:, 0], t, side="right") - 1, 1]
        if not len(phases):
            still = np.zeros(len(t))
            where = np.tile(np.asarray(self._origin), (len(t), 1))
            return TraceSample(where, still, standstill_power, np.full(len(t), -1))
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
        power_on = _beam(power, speed, block)
        return TraceSample(
            position,
            speed,
            np.where(moving, power_on, standstill_power),
            np.where(moving, row, -1).astype(np.int64),
        )

    def blocks(self) -> ExecutedBlocks:
        """Every block that has begun, up to the head of the committed motion."""
        phases, blocks = self._phase_rows(), self._block_rows()
        row = phases[:, 6]
        index = np.arange(len(blocks))
        first = np.searchsorted(row, index, side="left")
        last = np.searchsorted(row, index, side="right") - 1
        begun = last >= first  # a newly loaded block has no phase yet
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
            is_complete=reached >= 1.0 - _ROUNDING,
            executed_fraction=share,
        )

    def phases(self) -> ConstantAccelerationPhases:
        """Every committed phase."""
        t0, t1, distance, speed, acceleration, power, row = self._phase_rows().T
        return ConstantAccelerationPhases(t0, t1, speed, acceleration, row.astype(np.int64),
                                          distance, power)

    def standstill_power(self) -> tuple[FloatArray, FloatArray]:
        """Beam power at standstill: start times and powers."""
        standstill = self._standstill_rows()
        return standstill[:, 0], standstill[:, 1]

    def _shift(self, time_s: FloatArray) -> FloatArray:
        """Offset (n, 3) to add to the controller's positions at each time."""
        since_s, shift = zip(*self._shifts, strict=True)
        return np.asarray(shift)[np.searchsorted(since_s, time_s, side="right") - 1]

    def _phase_rows(self) -> FloatArray:
        return self.laser.split_phases(np.array(self._phases,
                                                dtype=np.float64).reshape(-1, PHASE_COLUMN_COUNT))

    def _standstill_rows(self) -> FloatArray:
        standstill = np.array(self._standstill, dtype=np.float64)
        standstill = standstill.reshape(-1, STANDSTILL_COLUMN_COUNT)
        return self.laser.split_standstill(standstill)

    def _block_rows(self) -> FloatArray:
        return np.array(self._blocks, dtype=np.float64).reshape(-1, BLOCK_COLUMN_COUNT)


def _beam(power: FloatArray, speed: FloatArray, block: FloatArray) -> FloatArray:
    """Power while moving: constant, or in proportion to actual over programmed speed."""
    rate, beam, floor = block[:, 8], block[:, 9], block[:, 10]
    dynamic = beam == BEAM_DYNAMIC
    scale = np.divide(speed, rate, out=np.ones_like(speed), where=dynamic & (rate > 0.0))
    wanted = power * scale
    return np.where(wanted > 0.0, np.clip(wanted, floor, 1.0), 0.0)
