"""One hopper: disc, drive, powder and hose, driven by events and never stepped in time.

set-point → ramp → disc (dead band below n_min, ceiling n_max, offset and g/rev) → drive lag →
dead time θ → lag τ (docs/explanation/powder-delivery.md, Feeders) → noise and pulsation.
A command costs the same whatever the history; flows are exact at any instant. A slope that drifts
is constant between commands; its device calls `follow_drift` often enough.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

from simulators.array_types import FloatArray
from simulators.feeder.config import HopperConfig
from simulators.feeder.flow_noise import CorrelatedNoise
from simulators.feeder.hose import SimulatedHose

_SECONDS_PER_H = 3600.0


class _Piece(NamedTuple):
    """Flow off the disc [g/s] from start_s on: c0 + c1·x + c2·exp(−x/τ_d); fed_g before it."""

    start_s: float
    c0: float
    c1: float
    c2: float
    fed_g: float


class HopperProcess:
    """The powder of one hopper. Times are the simulation's, and never go back.

    empty_s : when the hopper runs (or, as commanded now, will run) empty; inf while it never does
    """

    def __init__(self, config: HopperConfig) -> None:
        self.config = config
        self.empty_s = math.inf
        self._fill_g = config.fill_g
        self._speed = self._share = 1.0
        self._n_min_rpm = config.n_min_rpm
        self._hose = SimulatedHose(config.dead_time_s, config.lag_s, config.drive_lag_s)
        self._noise = CorrelatedNoise(config.noise_time_s, config.seed, config.channel)
        self._first_turn_s = math.inf
        self._slope = config.slope_factor
        self._ramp = (-math.inf, 0.0, -math.inf, 0.0)  # from time, rpm; to time, rpm
        self._pieces = [_Piece(-math.inf, 0.0, 0.0, 0.0, 0.0)]

    def command_rpm(self, time_s: float, rpm: float, ramp_s: float = 0.0) -> None:
        """From time_s on, ramp linearly to `rpm` within ramp_s.

        Raises ValueError for a time before the last command, and a speed that is no number ≥ 0.
        """
        if not (math.isfinite(rpm) and rpm >= 0 and ramp_s >= 0):
            raise ValueError(f"a disc cannot go to {rpm} rpm in {ramp_s} s")
        if not self._ramp[0] <= time_s < math.inf:
            raise ValueError(f"a command at {time_s} s comes after one at {self._ramp[0]} s")
        flow_g_s, fed_g = self.disc_flow_g_s(time_s), self.fed_g(time_s)
        start_rpm, end_rpm = self.setpoint_rpm(time_s), min(rpm, self.config.n_max_rpm)
        if rpm > 0:
            self._first_turn_s = min(self._first_turn_s, time_s)
        self._slope = self._slope_at(time_s, fed_g)
        self._ramp = (time_s, start_rpm, time_s + ramp_s, end_rpm)
        self._pieces = self._disc_pieces(time_s, start_rpm, end_rpm, ramp_s, flow_g_s, fed_g)
        self._feed_hose(time_s)

    def disturb(
        self, time_s: float, *, speed: float | None = None, share: float | None = None,
        n_min_rpm: float | None = None,
    ) -> None:
        """From time_s on, the process is disturbed, until it is disturbed again.

        speed : of the disc over its set-point, 0 stalls it
        share : of the powder fed that gets through the hose
        """
        self._speed = self._speed if speed is None else speed
        self._share = self._share if share is None else share
        self._n_min_rpm = self._n_min_rpm if n_min_rpm is None else n_min_rpm
        self._command_again(time_s)

    def set_remaining_g(self, time_s: float, left_g: float) -> None:
        """Set the powder left in the hopper from time_s on."""
        fed_g = self.fed_g(time_s)
        if time_s >= self.empty_s:
            self._pieces = [_Piece(time_s, 0.0, 0.0, 0.0, fed_g)]
        self._fill_g = fed_g + left_g
        self.empty_s = math.inf
        self._command_again(time_s)

    def set_carrier_L_min(self, time_s: float, carrier_L_min: float) -> None:
        """The carrier gas from time_s on; powder that is in the hose then arrives as before."""
        config = self.config
        factor = 1.0
        if carrier_L_min > 0:
            own = 1.0 - config.carrier_share
            factor = own + config.carrier_share * config.carrier_L_min / carrier_L_min
        self._hose.set_transport(config.dead_time_s * factor, config.lag_s * factor)
        if self._ramp[0] > -math.inf:
            self._command_again(time_s)

    def follow_drift(self, time_s: float) -> None:
        """Let the slope be from time_s on what drift and level have made of it."""
        self._command_again(time_s)

    def _slope_at(self, time_s: float, fed_g: float) -> float:
        """True slope over the feed factor, by time since the first turn and by level."""
        config = self.config
        hours = max(0.0, time_s - self._first_turn_s) / _SECONDS_PER_H
        drift = config.slope_drift_per_h * hours
        emptied = max(0.0, 1.0 - (self._fill_g - fed_g) / config.fill_g)
        level = config.slope_change_to_empty * emptied
        return config.slope_factor * max(0.0, 1.0 + drift + level)

    def _command_again(self, time_s: float) -> None:
        """Repeat the last command."""
        _, _, end_s, end_rpm = self._ramp
        self.command_rpm(time_s, end_rpm, max(0.0, end_s - time_s))

    def setpoint_rpm(self, time_s: float) -> float:
        """The set-point as ramped so far."""
        start_s, start_rpm, end_s, end_rpm = self._ramp
        if time_s >= end_s:
            return end_rpm
        return start_rpm + (end_rpm - start_rpm) * (time_s - start_s) / (end_s - start_s)

    def is_ramping(self, time_s: float) -> bool:
        return time_s < self._ramp[2]

    def disc_rpm(self, time_s: float) -> float:
        """The disc's own speed, behind ramp, dead band and drive."""
        over_g_min = 60.0 * self.disc_flow_g_s(time_s) - self.config.offset_g_min
        return max(0.0, over_g_min / self._factor_g_rev) if self._factor_g_rev else 0.0

    def fed_g(self, time_s: float) -> float:
        """Powder that left the hopper so far."""
        if time_s >= self.empty_s:
            return self._fill_g
        piece = self._piece_at(time_s)
        return min(self._fill_g, piece.fed_g + self._fed_in(piece, time_s - piece.start_s))

    def remaining_g(self, time_s: float) -> float:
        """Powder left in the hopper."""
        return self._fill_g - self.fed_g(time_s)

    def time_when_remaining_s(self, left_g: float) -> float:
        """When this mass is left, as commanded now; at the latest now if less is left already."""
        return self._time_fed(self._fill_g - left_g)

    def nozzle_flow_g_s(self, time_s: FloatArray) -> FloatArray:
        """Flow out of the nozzle at each time, of any shape; exact but for the noise added."""
        time_s = np.asarray(time_s, dtype=np.float64)
        return self._hose.outflow_g_s(time_s) * self._unsteadiness(time_s)

    def delivered_g(self, time_s: float) -> float:
        """Powder that has come to the nozzle so far, without the noise and before the lag."""
        return float(self._hose.arrived_g(np.array([time_s]))[0])

    def _unsteadiness(self, time_s: FloatArray) -> FloatArray:
        """Factor on the flow, never negative, 1 on average: noise, and a pulse a groove."""
        config, factor = self.config, np.ones_like(time_s)
        if config.noise_rsd:
            since_s = time_s - self._first_turn_s
            factor += config.noise_rsd * self._noise.values(since_s)
        if config.pulsation_rsd:
            revolutions = self._hose.arrived_g(time_s) / config.feed_factor_g_rev
            pulse = np.sin(2 * np.pi * config.pulses_per_rev * revolutions)
            factor += config.pulsation_rsd * math.sqrt(2.0) * pulse
        return np.maximum(factor, 0.0)

    @property
    def _factor_g_rev(self) -> float:
        return self.config.feed_factor_g_rev * self._slope

    def _disc_pieces(
        self, time_s: float, start_rpm: float, end_rpm: float, ramp_s: float, flow_g_s: float,
        fed_g: float,
    ) -> list[_Piece]:
        """Flow off the disc: the target flow, line by line, through the drive's lag.

        A line p + q·x is followed as p − q·τ_d + q·x + (s0 − p + q·τ_d)·exp(−x/τ_d).
        """
        drive_s = self.config.drive_lag_s
        pieces: list[_Piece] = []
        for begin_s, value, slope in self._wanted(
            start_rpm * self._speed, end_rpm * self._speed, ramp_s
        ):
            if pieces:
                length = time_s + begin_s - pieces[-1].start_s
                flow_g_s = self._value(pieces[-1], length)
                fed_g = pieces[-1].fed_g + self._fed_in(pieces[-1], length)
            late = flow_g_s - value + slope * drive_s if drive_s > 0 else 0.0
            pieces.append(_Piece(time_s + begin_s, value - slope * drive_s, slope, late, fed_g))
        return pieces

    def _wanted(
        self, start_rpm: float, end_rpm: float, ramp_s: float
    ) -> list[tuple[float, float, float]]:
        """The target flow as lines: (begin after the command [s], value [g/s], slope [g/s²])."""
        lines: list[tuple[float, float, float]] = []
        if start_rpm == end_rpm:
            ramp_s = 0.0
        if ramp_s > 0:
            climb = (end_rpm - start_rpm) / ramp_s
            crossing_s = (self._n_min_rpm - start_rpm) / climb
            edges = [0.0, crossing_s, ramp_s] if 0 < crossing_s < ramp_s else [0.0, ramp_s]
            for begin_s, end_s in itertools.pairwise(edges):
                if start_rpm + climb * (begin_s + end_s) / 2 >= self._n_min_rpm:
                    value = self._law_g_s(start_rpm + climb * begin_s)
                    lines.append((begin_s, value, self._factor_g_rev * climb / 60.0))
                else:
                    lines.append((begin_s, 0.0, 0.0))
        turns = end_rpm >= self._n_min_rpm and end_rpm > 0
        lines.append((ramp_s, self._law_g_s(end_rpm) if turns else 0.0, 0.0))
        return lines

    def _law_g_s(self, rpm: float) -> float:
        return (self.config.offset_g_min + self._factor_g_rev * rpm) / 60.0

    def _feed_hose(self, time_s: float) -> None:
        """Pass the pieces to the hose, until the powder runs out."""
        if self.empty_s <= time_s:
            return
        self._hose.discard_from(time_s)
        self.empty_s = self._time_fed(self._fill_g)
        share = self._share
        for piece in self._pieces:
            if piece.start_s < self.empty_s:
                self._hose.add_inflow(
                    piece.start_s, piece.c0 * share, piece.c1 * share, piece.c2 * share
                )
        if self.empty_s < math.inf:
            self._hose.add_inflow(self.empty_s, 0.0, 0.0, 0.0)

    def _time_fed(self, mass_g: float) -> float:
        """When the powder fed reaches mass_g, by the pieces at hand; inf if it never does."""
        ends = [piece.start_s for piece in self._pieces[1:]] + [math.inf]
        for piece, end_s in zip(self._pieces, ends, strict=True):
            length = end_s - piece.start_s
            missing_g = mass_g - piece.fed_g
            if missing_g <= 0:
                return piece.start_s
            if length < math.inf and self._fed_in(piece, length) < missing_g:
                continue
            if length == math.inf:
                if piece.c0 <= 0 and abs(piece.c2) * self.config.drive_lag_s <= missing_g:
                    return math.inf
                length = self._longest(piece, missing_g)
            return piece.start_s + self._solve(piece, missing_g, length)
        return math.inf

    def _longest(self, piece: _Piece, missing_g: float) -> float:
        """A time by which a lasting piece has surely fed missing_g."""
        late_g = piece.c2 * self.config.drive_lag_s
        if piece.c0 <= 0:
            return 60.0 * self.config.drive_lag_s
        return (missing_g + abs(late_g)) / piece.c0

    def _solve(self, piece: _Piece, missing_g: float, longest_s: float) -> float:
        """When a piece has fed missing_g; flow is never negative, so bisection finds it."""
        if piece.c1 == 0 and piece.c2 == 0:
            return missing_g / piece.c0
        settled_s = (
            (missing_g - piece.c2 * self.config.drive_lag_s) / piece.c0
            if piece.c1 == 0 and piece.c0 > 0 else 0.0
        )
        if settled_s > 40.0 * self.config.drive_lag_s:
            return settled_s  # the transient is long over, to the last bit
        low, high = 0.0, longest_s
        for _ in range(60):
            middle = (low + high) / 2
            if self._fed_in(piece, middle) < missing_g:
                low = middle
            else:
                high = middle
        return high

    def _piece_at(self, time_s: float) -> _Piece:
        for piece in reversed(self._pieces):
            if piece.start_s <= time_s:
                return piece
        return _Piece(time_s, 0.0, 0.0, 0.0, 0.0)

    def disc_flow_g_s(self, time_s: float) -> float:
        """Flow the disc would give with powder in it."""
        piece = self._piece_at(time_s)
        return self._value(piece, time_s - piece.start_s)

    def _value(self, piece: _Piece, x: float) -> float:
        value = piece.c0 + (piece.c1 * x if piece.c1 else 0.0)
        if piece.c2:
            value += piece.c2 * math.exp(-x / self.config.drive_lag_s)
        return max(0.0, value)

    def _fed_in(self, piece: _Piece, x: float) -> float:
        fed = (piece.c0 * x if piece.c0 else 0.0) + (piece.c1 * x * x / 2 if piece.c1 else 0.0)
        if piece.c2:
            fed -= piece.c2 * self.config.drive_lag_s * math.expm1(-x / self.config.drive_lag_s)
        return max(0.0, fed)
