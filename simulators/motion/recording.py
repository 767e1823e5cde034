"""Compact record of a simulated machine's motion and beam, exact at any instant.

Two tables grow. A *block* is one straight move: its N word, its ends and how its beam is driven. A
*phase* is a stretch of one block at constant acceleration, so position and speed are polynomials of
time within it. Between phases the machine is at rest; a third table holds the beam power during
standstill. A block and its phases take about 200 bytes. `trace` reads the tables.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from math import inf
from struct import Struct

from simulators.motion.actions import Vector
from simulators.motion.laser_circuit import LaserSafetyCircuit
from simulators.motion.planner import PlannerBlock

#: Columns of the tables, numbers in a row.
BLOCK_COLUMN_COUNT = 11  # line, start xyz, end xyz, length, rate, beam, floor
PHASE_COLUMN_COUNT = 7  # as `Phase`
STANDSTILL_COLUMN_COUNT = 2  # from when, power

# in half the time that an array takes for so many numbers
_BLOCK_ROW = Struct(f"{BLOCK_COLUMN_COUNT}d").pack

Phase = tuple[float, float, float, float, float, float, float]
"""Its start and end [s], distance into the block and speed at its start, acceleration, beam power
before any scaling with speed, row of the block."""


class MotionRecording:
    """Record of one controller. The stepper adds to it.

    moved : called with each phase as it is committed
    outputs : (time, kind, port, value) of every digital ("D") or analog ("A") output switched
    laser : the laser's safety circuit; while it is open the recorded beam is off
    """

    def __init__(self, position_mm: Vector) -> None:
        self.outputs: list[tuple[float, str, int, float]] = []
        self.laser = LaserSafetyCircuit()
        self._origin = position_mm
        self._blocks = array("d")
        self._phases = array("d")
        self._standstill = array("d", (0.0, 0.0))
        self.moved: Callable[[Phase], None] = self._phases.extend
        self.rows = 0
        self._awaited: list[tuple[int, Callable[[int], None]]] = []
        self._rebased_s = -inf
        self._rebased_mm = position_mm
        self._shifts = [(-inf, (0.0, 0.0, 0.0))]

    def call_at_line(self, line: int, begun: Callable[[int], None]) -> Callable[[], None]:
        """Call begun(row) as the first block whose N word is at least `line` is about to move.

        Call the returned function to cancel.
        """
        waiting = (line, begun)
        self._awaited.append(waiting)
        return lambda: self._awaited.remove(waiting) if waiting in self._awaited else None

    def block_start_s(self, row: int) -> float | None:
        """When one of the last blocks began to move; None if it has not started."""
        phases = self._phases
        began_s = None
        for at in range(len(phases) - PHASE_COLUMN_COUNT, -1, -PHASE_COLUMN_COUNT):
            if phases[at + PHASE_COLUMN_COUNT - 1] < row:
                break
            began_s = phases[at]
        return began_s

    @property
    def position_error_mm(self) -> Vector:
        """True position less the position that the controller assumes."""
        return self._shifts[-1][1]

    def record_position_shift(self, when_s: float, believed_mm: Vector, shift_mm: Vector) -> None:
        """At standstill, record that the controller assumes another position from now on."""
        self._rebased_s, self._rebased_mm = when_s, believed_mm
        self._shifts.append((when_s, shift_mm))

    def record_block(self, block: PlannerBlock) -> int:
        """Add a block that is about to move. Returns its row."""
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

    def record_standstill_power(self, when_s: float, power: float) -> None:
        """Record the beam power at standstill from when_s on."""
        standstill = self._standstill
        while standstill[-2] > when_s:  # committed ahead of a reset
            del standstill[-STANDSTILL_COLUMN_COUNT:]
        if standstill[-1] != power:
            standstill.extend((when_s, power))

    def truncate_at(self, when_s: float) -> None:
        """Motion stopped at once at when_s: drop what was committed after it."""
        phases, blocks = self._phases, self._blocks
        while phases and phases[-PHASE_COLUMN_COUNT] >= when_s:
            del phases[-PHASE_COLUMN_COUNT:]
        if phases and phases[1 - PHASE_COLUMN_COUNT] > when_s:
            phases[1 - PHASE_COLUMN_COUNT] = when_s
        self.rows = int(phases[-1]) + 1 if phases else 0
        del blocks[self.rows * BLOCK_COLUMN_COUNT :]
        self.outputs = [switched for switched in self.outputs if switched[0] <= when_s]

    def position_at(self, when_s: float) -> Vector:
        """Position that the controller assumed, at a time shortly before the end of the record.

        No arrays are built.
        """
        phases = self._phases
        at = len(phases) - PHASE_COLUMN_COUNT
        while at >= 0 and phases[at] > when_s:
            at -= PHASE_COLUMN_COUNT
        if at < 0 or phases[at] < self._rebased_s:
            return self._rebased_mm
        start_s, end_s, distance, speed, acceleration, _, row = phases[at : at + PHASE_COLUMN_COUNT]
        dt = min(when_s, end_s) - start_s
        return self._along(int(row), distance + (speed + 0.5 * acceleration * dt) * dt)

    def _along(self, row: int, distance_mm: float) -> Vector:
        _, x0, y0, z0, x1, y1, z1, length, *_ = self._blocks[
            row * BLOCK_COLUMN_COUNT : (row + 1) * BLOCK_COLUMN_COUNT]
        part = min(1.0, distance_mm / length)
        return (x0 + (x1 - x0) * part, y0 + (y1 - y0) * part, z0 + (z1 - z0) * part)

    @property
    def size_bytes(self) -> int:
        """Memory used by the tables."""
        return sum(
            table.itemsize * len(table) for table in (self._blocks, self._phases, self._standstill)
        )
