"""Executes planned blocks in time; accelerations, holds and overrides are computed, not stepped.

Like the firmware's step segment buffer, the stepper works a little ahead of the motion. At time t
it has committed the motion until t + `lead_s` (but no more than `lead_blocks` blocks). The end of
the committed motion is the *head*; a hold or an override takes effect there, not at t. A block
leaves the planner when its last piece is committed. Committed motion goes to the trace. The rest
of the block at the head is a plan of at most three phases; a new exit speed, a hold or an override
causes a new plan.
"""

from __future__ import annotations

from collections import deque
from math import inf, sqrt

from simulators.motion.actions import BEAM_CONSTANT, BEAM_DYNAMIC, StraightMove, Vector
from simulators.motion.planner import LookAheadPlanner, PlannerBlock
from simulators.motion.recording import MotionRecording
from simulators.motion.speed_profile import SpeedRamp, braking_profile, fastest_profile

_TINY_MM = 1e-9
_ALIKE = 1e-9  # relative difference of squared speeds that counts as rounding
_SLACK_S = 1e-9  # a timer may come early by the clock's resolution


class Stepper:
    """Executes the blocks of a planner.

    running : blocks are taken from the planner
    holding : braking to rest along the path; at rest, `running` ends too
    end_s : end of the committed motion; the machine is then at rest unless more follows
    block : the block being executed at the head, or in which a hold has stopped
    standstill_power : beam power at standstill, before the override
    """

    def __init__(self, planner: LookAheadPlanner, trace: MotionRecording, lead_s: float,
                 lead_blocks: int) -> None:
        self.running = False
        self.holding = False
        self.end_s = 0.0
        self.last_line = 0
        self.block: PlannerBlock | None = None
        self.standstill_power = 0.0
        self.spindle_factor = 1.0
        self._planner = planner
        self._trace = trace
        self._lead_s = lead_s
        self._lead_blocks = lead_blocks
        self._head_s = 0.0
        self._ends: deque[float] = deque()  # of blocks fully committed and not yet finished
        self._motion: StraightMove | None = None  # of the block loaded last
        self._row = 0
        self._done_mm = 0.0  # of the block, at the start of the phase
        self._speed = 0.0  # at the start of the phase
        self._ramps: list[SpeedRamp] = []  # the block's phases, the next one last
        self._exit_sqr = 0.0  # exit speed² for which they were planned

    def start(self, now_s: float) -> None:
        """Take blocks from the planner, from rest or continuing the current motion."""
        self.running = True
        self.holding = False
        if self.end_s < now_s:
            self.end_s = now_s
        first = self._planner.first
        if first is not None and self._speed == 0.0:
            if self.block is not None:  # a hold stopped within this block
                self._place(self.block)
                self._planner.replan()
                self._plan(self.block)
            elif first.entry_speed_sqr > 0.0:  # a hold stopped exactly at its start
                first.entry_speed_sqr = 0.0
                self._planner.replan()
        self._head_s = self.end_s

    def brake(self, now_s: float) -> None:
        """Brake to rest along the path, from the head on."""
        self.advance(now_s)
        self._cut()
        if self._speed == 0.0:
            self.running = False  # at rest at the head, or when the committed motion ends
        else:
            self.holding = True
            if self.block is not None:
                self._plan(self.block)

    def set_overrides(self, feed: float, rapid: float, spindle: float, now_s: float) -> None:
        """Factors on programmed feed, rapid speed and S, from the head on."""
        self.advance(now_s)
        self._cut()
        if spindle != self.spindle_factor:
            self.spindle_factor = spindle
            self.set_standstill_power(self.standstill_power, self.end_s if self.running else now_s)
        self._planner.set_overrides(feed, rapid)
        if self.block is not None and self.running:
            self._plan(self.block)

    def stop_immediately(self, now_s: float) -> None:
        """Reset: motion ends at once at the current position; the plan is dropped."""
        self.advance(now_s)
        self._head_s = now_s
        self._cut()
        self._trace.truncate_at(now_s)
        self.end_s = min(self.end_s, now_s)
        self.discard_plan(now_s)

    def discard_plan(self, now_s: float) -> None:
        """Drop all planned motion that is not committed; the machine keeps its position."""
        self.block = None
        self._ramps.clear()
        self._ends.clear()
        self._speed = 0.0
        self.running = self.holding = False
        self._planner.clear(self._trace.position_at(now_s))

    def is_stopped(self, now_s: float) -> bool:
        """Standing still with nothing to do, or held."""
        return now_s >= self.end_s - _SLACK_S and (not self.running or self._planner.first is None)

    def next_event_s(self) -> float:
        """When, if nothing changes, a block leaves the planner next or motion ends."""
        if self.block is not None and self.running:
            rest_s = sum(ramp.duration for ramp in self._ramps)
            return self.end_s + rest_s - self._lead_s
        block = self._planner.first
        if block is not None and self.running:
            is_buffer_full = len(self._ends) >= self._lead_blocks
            loads_s = max(self.end_s - self._lead_s, self._ends[0] if is_buffer_full else 0.0)
            # Loading changes nothing yet: a block leaves when its last piece is committed.
            rest_s = sum(ramp.duration for ramp in self._profile(block, block.length))
            return max(loads_s, self.end_s + rest_s - self._lead_s)
        return self.end_s

    def advance(self, now_s: float) -> None:
        """Commit the motion that is certain at now_s."""
        planner, moved = self._planner, self._trace.moved
        block = self.block
        if block is not None and self.running and not self.holding:
            following = block.next_block
            exit_sqr = 0.0 if following is None else following.entry_speed_sqr
            if exit_sqr != self._exit_sqr:
                self._cut()
                self._plan(block)
        until_s = now_s + self._lead_s + _SLACK_S
        ends, ramps, end_s = self._ends, self._ramps, self.end_s
        while self.running:
            if block is None:
                block = planner.first
                if block is None or end_s >= until_s:
                    block = None
                    break
                while ends and ends[0] <= now_s + _SLACK_S:
                    ends.popleft()
                if len(ends) >= self._lead_blocks:
                    block = None
                    break
                self._load(block)
                over_s = self._cruised_s(block)
                if over_s <= until_s:  # most blocks: one phase, no planning needed
                    power = block.motion.power * self.spindle_factor
                    moved((end_s, over_s, 0.0, self._speed, 0.0, power, self._row))
                    self.end_s = end_s = over_s
                    planner.discard_first()
                    ends.append(end_s)
                    self.block = block = None
                    continue
                self._plan(block)
            acceleration, duration, distance, exit_speed = ramps[-1]
            over_s = end_s + duration
            if over_s > until_s:
                break
            power = block.motion.power * self.spindle_factor
            moved((end_s, over_s, self._done_mm, self._speed, acceleration, power, self._row))
            ramps.pop()
            self.end_s = end_s = over_s
            self._done_mm += distance
            self._speed = exit_speed
            if ramps:
                continue
            if self._done_mm >= block.length - _TINY_MM:
                planner.discard_first()
                ends.append(end_s)
                self.block = block = None
            if self.holding and (exit_speed == 0.0 or planner.first is None):
                self.running = self.holding = False
                self._speed = 0.0
        if block is None or not self.running:
            self._head_s = end_s
        else:
            self._head_s = until_s
            if planner.planned is block:  # the look-ahead starts from the block's present speed
                speed, done_mm = self._within_ramp(until_s)
                block.entry_speed_sqr = speed * speed
                block.ramp_sqr = 2.0 * block.acceleration * (block.length - done_mm)

    def commit(self) -> None:
        """Bring the record up to the head, in the middle of a phase too."""
        if self.block is None or not self.running or self._head_s <= self.end_s:
            return
        acceleration, duration, distance, exit_speed = self._ramps[-1]
        end_s, done_mm = self.end_s, self._done_mm
        self._cut()
        duration -= self.end_s - end_s
        distance -= self._done_mm - done_mm
        self._ramps[-1] = SpeedRamp(acceleration, duration, distance, exit_speed)

    def position_mm(self, now_s: float) -> Vector:
        """Position of the machine at now_s."""
        block = self.block
        if block is None or now_s <= self.end_s or not self.running:
            return self._trace.position_at(now_s)
        _, done_mm = self._within_ramp(now_s)
        part = done_mm / block.length
        (x0, y0, z0), (x1, y1, z1) = block.start, block.target
        return (x0 + (x1 - x0) * part, y0 + (y1 - y0) * part, z0 + (z1 - z0) * part)

    def reported_speed_and_power(self) -> tuple[float, float]:
        """Speed and laser S (as a fraction) at the head, which is what the firmware reports."""
        motion = self._motion
        if motion is None or not self.running or (self.block is None and self._speed == 0.0):
            return self._speed, min(1.0, self.standstill_power * self.spindle_factor)
        # Between two blocks: the values at the end of the previous one.
        speed = self._speed if self.block is None else self._within_ramp(self._head_s)[0]
        power = motion.power * self.spindle_factor
        if motion.beam == BEAM_DYNAMIC:
            power *= speed / motion.rate_mm_s
        return speed, min(power, 1.0)

    def set_standstill_power(self, power: float, when_s: float) -> None:
        """Set the beam power at standstill from when_s on."""
        self.standstill_power = power
        self._trace.record_standstill_power(when_s, min(1.0, power * self.spindle_factor))

    def _load(self, block: PlannerBlock) -> None:
        self.block = block
        self._row = self._trace.record_block(block)
        self._done_mm = 0.0
        if abs(self._speed * self._speed - block.entry_speed_sqr) < _ALIKE * block.entry_speed_sqr:
            self._speed = sqrt(block.entry_speed_sqr)  # else rounding errors would accumulate
        self._motion = motion = block.motion
        self.last_line = motion.line
        standstill_power = motion.power if motion.beam == BEAM_CONSTANT else 0.0
        if standstill_power != self.standstill_power:
            self.set_standstill_power(standstill_power, self.end_s)
        if motion.outputs:
            self._trace.outputs += [(self.end_s, *output) for output in motion.outputs]

    def _cruised_s(self, block: PlannerBlock) -> float:
        """When a block just loaded ends if its speed does not change in it; else infinite."""
        nominal, following = block.nominal_speed, block.next_block
        if self._speed != nominal or following is None or self.holding:
            return inf
        if following.entry_speed_sqr != nominal * nominal:
            return inf
        return self.end_s + block.length / nominal

    def _within_ramp(self, when_s: float) -> tuple[float, float]:
        """Speed, and distance into the block, at an instant of the phase being executed."""
        dt = when_s - self.end_s
        if dt <= 0.0:
            return self._speed, self._done_mm
        acceleration = self._ramps[-1][0]
        speed = self._speed + acceleration * dt
        return speed, self._done_mm + 0.5 * (self._speed + speed) * dt

    def _cut(self) -> None:
        """Commit the current phase up to the head, so that the rest can be planned again."""
        block, head_s = self.block, self._head_s
        if block is None or not self.running:
            return
        if head_s > self.end_s:
            acceleration = self._ramps[-1].acceleration
            power = block.motion.power * self.spindle_factor
            speed, done_mm = self._within_ramp(head_s)
            self._trace.moved(
                (self.end_s, head_s, self._done_mm, self._speed, acceleration, power, self._row)
            )
            self._speed, self._done_mm, self.end_s = speed, done_mm, head_s
        self._place(block)

    def _place(self, block: PlannerBlock) -> None:
        """Pass the planner the point where the look-ahead starts."""
        block.entry_speed_sqr = self._speed * self._speed
        block.ramp_sqr = 2.0 * block.acceleration * (block.length - self._done_mm)

    def _plan(self, block: PlannerBlock) -> None:
        """Plan the rest of the block at the head."""
        left_mm = block.length - self._done_mm
        if self.holding:
            self._ramps[:] = braking_profile(self._speed, left_mm, block.acceleration)
            return
        following = block.next_block
        self._exit_sqr = 0.0 if following is None else following.entry_speed_sqr
        self._ramps[:] = self._profile(block, left_mm)

    def _profile(self, block: PlannerBlock, left_mm: float) -> list[SpeedRamp]:
        """The rest of a block from the speed at the head, unless a hold brakes it."""
        following = block.next_block
        exit_sqr = 0.0 if following is None else following.entry_speed_sqr
        return fastest_profile(self._speed, left_mm, block.acceleration, block.nominal_speed,
                               exit_sqr)
