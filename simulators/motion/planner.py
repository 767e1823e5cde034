"""Look-ahead planner: a bounded queue of straight blocks and the speeds at their junctions.

The method is the firmware's (Grbl 1.1 `planner.c`; S. Jeon, "Improving Grbl: Cornering
Algorithm", 2011): junction deviation limits the speed in a corner. A backward pass limits
every entry speed so that the last block can end at rest; a forward pass limits it to what
acceleration can reach. Everything before `planned` is optimal and is not recalculated, which makes
the work per line constant in practice.

Speeds in mm/s, their squares in mm²/s², accelerations in mm/s². Targets are rounded to whole
steps, as on the machine: the direction of a very short block is that of its steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from simulators.motion.actions import StraightMove, Vector

_MIN_SPEED_MM_S = 1.0 / 60.0  # MINIMUM_FEED_RATE
_UNBOUNDED = 1.0e38
_STRAIGHT = 0.999999  # cosine beyond which a junction is straight on, or a reversal


@dataclass(frozen=True)
class Kinematics:
    """Limits of the machine, one value per axis. Rates and accelerations above 0."""

    steps_per_mm: Vector
    max_rate_mm_s: Vector
    acceleration_mm_s2: Vector
    junction_deviation_mm: float


class PlannerBlock:
    """A planned straight move. `previous` and `following` link the queue."""

    __slots__ = (
        "acceleration",
        "entry_speed_sqr",
        "length",
        "max_entry_sqr",
        "max_junction_sqr",
        "motion",
        "next_block",
        "nominal_speed",
        "previous_block",
        "ramp_sqr",
        "rapid_rate",
        "start",
        "target",
    )

    acceleration: float
    entry_speed_sqr: float
    next_block: PlannerBlock | None
    length: float
    max_entry_sqr: float
    max_junction_sqr: float
    motion: StraightMove
    nominal_speed: float
    previous_block: PlannerBlock | None
    ramp_sqr: float  # speed² gained or lost over the rest of the block
    rapid_rate: float
    start: Vector
    target: Vector


class LookAheadPlanner:
    """The queue. `first` is the block being executed, `count` blocks are in it."""

    def __init__(self, capacity: int, kinematics: Kinematics) -> None:
        self.capacity = capacity
        self.count = 0
        self.first: PlannerBlock | None = None
        self.planned: PlannerBlock | None = None
        self.feed_factor = 1.0
        self.rapid_factor = 1.0
        self._last: PlannerBlock | None = None
        self._last_nominal = 0.0
        self._last_unit: Vector = (0.0, 0.0, 0.0)
        self._steps = (0, 0, 0)
        self._at: Vector = (0.0, 0.0, 0.0)  # the same in mm
        self.kinematics = kinematics

    @property
    def kinematics(self) -> Kinematics:
        return self._kinematics

    @kinematics.setter
    def kinematics(self, kinematics: Kinematics) -> None:
        self._kinematics = kinematics
        self._per_mm = kinematics.steps_per_mm
        self._rates = kinematics.max_rate_mm_s
        self._accelerations = kinematics.acceleration_mm_s2
        self._deviation = kinematics.junction_deviation_mm
        self._alike = len({*self._rates}) == 1 and len({*self._accelerations}) == 1
        self._set_standstill(self._at)

    @property
    def position_mm(self) -> Vector:
        """End position of the last block, in whole steps."""
        return self._at

    def clear(self, position_mm: Vector) -> None:
        """Drop every block; the next one starts at position_mm."""
        self.first = self._last = self.planned = None
        self.count = 0
        self._set_standstill(position_mm)

    def _set_standstill(self, position_mm: Vector) -> None:
        (x, y, z), (sx, sy, sz) = position_mm, self._per_mm
        self._steps = nx, ny, nz = round(x * sx), round(y * sy), round(z * sz)
        self._at = (nx / sx, ny / sy, nz / sz)

    def add(self, motion: StraightMove) -> PlannerBlock | None:
        """Append a move and plan it; None where it is shorter than a step. Needs room."""
        x, y, z = motion.target_mm
        sx, sy, sz = self._per_mm
        was_x, was_y, was_z = self._steps
        now_x, now_y, now_z = round(x * sx), round(y * sy), round(z * sz)
        dx = (now_x - was_x) / sx
        dy = (now_y - was_y) / sy
        dz = (now_z - was_z) / sz
        length = sqrt(dx * dx + dy * dy + dz * dz)
        if length == 0.0:
            return None
        ux, uy, uz = dx / length, dy / length, dz / length

        block = PlannerBlock()
        block.motion = motion
        block.length = length
        block.start = self._at
        block.target = self._at = (now_x / sx, now_y / sy, now_z / sz)
        if self._alike:  # equal axes, the usual machine: half the time
            steepest = max(ux, -ux, uy, -uy, uz, -uz)
            acceleration = self._accelerations[0] / steepest
            block.rapid_rate = self._rates[0] / steepest
        else:
            acceleration = _along(self._accelerations, ux, uy, uz)
            block.rapid_rate = _along(self._rates, ux, uy, uz)
        block.acceleration = acceleration
        block.ramp_sqr = 2.0 * acceleration * length
        block.next_block = None
        block.nominal_speed = nominal = self._nominal(motion, block.rapid_rate)

        last = self._last
        if last is None:
            block.max_junction_sqr = block.max_entry_sqr = block.entry_speed_sqr = 0.0
            block.previous_block = None
            self.first = self.planned = block
        else:
            block.max_junction_sqr = junction_sqr = self._junction_sqr(ux, uy, uz)
            slower = self._last_nominal if self._last_nominal < nominal else nominal
            slower *= slower
            block.max_entry_sqr = slower if slower < junction_sqr else junction_sqr
            block.entry_speed_sqr = 0.0
            block.previous_block = last
            last.next_block = block
        self._last = block
        self._last_nominal = nominal
        self._last_unit = (ux, uy, uz)
        self._steps = (now_x, now_y, now_z)
        self.count += 1
        if last is not None:
            self._recalculate()
        return block

    def discard_first(self) -> None:
        """Remove the first block after its execution."""
        block = self.first
        assert block is not None
        following = block.next_block
        if self.planned is block:
            self.planned = following
        if following is None:
            self._last = None
        else:
            following.previous_block = None
            block.next_block = None
        self.first = following
        self.count -= 1

    def set_overrides(self, feed_factor: float, rapid_factor: float) -> None:
        """Change the speeds of every queued block and plan the whole queue again."""
        self.feed_factor = feed_factor
        self.rapid_factor = rapid_factor
        before = _UNBOUNDED
        block = self.first
        while block is not None:
            block.nominal_speed = nominal = self._nominal(block.motion, block.rapid_rate)
            slower = min(before, nominal)
            block.max_entry_sqr = min(slower * slower, block.max_junction_sqr)
            before = nominal
            block = block.next_block
        self._last_nominal = before
        self.replan()

    def replan(self) -> None:
        """Plan the whole queue again from the speed at which its first block now is."""
        self.planned = self.first
        self._recalculate(thorough=True)

    def _nominal(self, motion: StraightMove, rapid_rate: float) -> float:
        if motion.rapid:
            speed = rapid_rate * self.rapid_factor
        else:
            speed = motion.rate_mm_s * self.feed_factor
            if speed > rapid_rate:
                speed = rapid_rate
        return speed if speed > _MIN_SPEED_MM_S else _MIN_SPEED_MM_S

    def _junction_sqr(self, ux: float, uy: float, uz: float) -> float:
        """Greatest speed² at which the corner deviates by no more than the setting allows."""
        px, py, pz = self._last_unit
        cos_theta = -(px * ux + py * uy + pz * uz)  # of the angle between the two legs
        if cos_theta > _STRAIGHT:
            return 0.0
        if cos_theta < -_STRAIGHT:
            return _UNBOUNDED
        jx, jy, jz = ux - px, uy - py, uz - pz
        size = sqrt(jx * jx + jy * jy + jz * jz)
        if self._alike:
            acceleration = self._accelerations[0] * size / max(jx, -jx, jy, -jy, jz, -jz)
        else:
            acceleration = _along(self._accelerations, jx / size, jy / size, jz / size)
        sin_half = sqrt(0.5 * (1.0 - cos_theta))
        return acceleration * self._deviation * sin_half / (1.0 - sin_half)

    def _recalculate(self, thorough: bool = False) -> None:
        block, planned = self._last, self.planned
        if block is None or planned is None or block is planned:
            return
        # Backward pass: limit each entry speed so that the last block can end at rest.
        reachable_sqr = block.ramp_sqr
        if reachable_sqr > block.max_entry_sqr:
            reachable_sqr = block.max_entry_sqr
        block.entry_speed_sqr = reachable_sqr
        before = block.previous_block
        while before is not planned:
            assert before is not None
            reachable_sqr += before.ramp_sqr
            if reachable_sqr > before.max_entry_sqr:
                reachable_sqr = before.max_entry_sqr
            if reachable_sqr == before.entry_speed_sqr and not thorough:
                break  # nothing further back can change
            before.entry_speed_sqr = reachable_sqr
            before = before.previous_block
        # Forward pass: limit each entry speed to what acceleration can reach.
        assert before is not None
        current, following = before, before.next_block
        while following is not None:
            if current.entry_speed_sqr < following.entry_speed_sqr:
                reached_sqr = current.entry_speed_sqr + current.ramp_sqr
                if reached_sqr < following.entry_speed_sqr:
                    following.entry_speed_sqr = reached_sqr
                    planned = following
            if following.entry_speed_sqr == following.max_entry_sqr:
                planned = following
            current, following = following, following.next_block
        self.planned = planned


def _along(limits: Vector, ux: float, uy: float, uz: float) -> float:
    """Greatest value along a direction that exceeds no axis' limit."""
    lx, ly, lz = limits
    best = _UNBOUNDED
    if ux:
        best = lx / ux if ux > 0.0 else -lx / ux
    if uy:
        along_y = ly / uy if uy > 0.0 else -ly / uy
        if along_y < best:
            best = along_y
    if uz:
        along_z = lz / uz if uz > 0.0 else -lz / uz
        if along_z < best:
            best = along_z
    return best
