"""Pulses of several hoppers over one scale during a purge: which, when, and how well they tell.

All hoppers run evenly at a low flow. One after the other is raised and lowered again, so that its
two edges reach the scale by themselves: a change of one hopper is over before that of the next
arrives. As many rounds are planned as the wanted interval needs, and no more than the time allows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.calibration.hose_fit import HoseBelief, ScaleFacts, predicted_hoses
from lmctl.calibration.step_response import SetpointHistory
from lmctl.config.machine import HopperSettings
from lmctl.machine.measuring.step_plan import step_levels_g_min

#: Edges arrive so many lags apart, of the slowest hose and the scale together: 95 % has come.
_LAGS_APART = 3.0
_LEAST_APART_S = 2.0
#: The low flow has settled after so many lags. Before the first edge it is weighed for a while,
#: which also leaves room for powder that comes sooner than is believed.
_LAGS_TO_SETTLE = 5.0
_BEFORE_FIRST_EDGE_S = 2.5
_LONG_AGO_S = 1e3
_TICK_S = 0.1


@dataclass(frozen=True)
class SetpointChange:
    """at_s : after powder was switched on; hopper : its place in the order; flow_g_min : from then
    on"""

    at_s: float
    hopper: int
    flow_g_min: float


@dataclass(frozen=True)
class PurgePulses:
    """lows_g_min : at which the hoppers start; changes : in order of time
    weigh_from_s, end_s : the scale is read between them, counted from powder on
    response_half_s : predicted half widths of the 95 % intervals of θ + τ
    """

    lows_g_min: tuple[float, ...]
    changes: tuple[SetpointChange, ...]
    weigh_from_s: float
    end_s: float
    response_half_s: tuple[float, ...]


def plan_pulses(
    hoppers: Sequence[HopperSettings], beliefs: Sequence[HoseBelief], facts: ScaleFacts, *,
    period_s: float, within_s: float, wanted_half_s: float,
) -> PurgePulses | None:
    """The shortest pulses that tell every hose as well as wanted; the best that fit where none do.

    period_s : between readings of the scale; within_s : time there is, from powder on
    returns : None where not even one pulse of each hopper fits
    Raises ConfigError where a hopper's range does not hold such steps.
    """
    levels = [step_levels_g_min(hopper) for hopper in hoppers]
    best: PurgePulses | None = None
    rounds = 1
    while True:
        pulses = _pulses(rounds, levels, beliefs, facts)
        if pulses.end_s > within_s:
            return best
        best = _with_prediction(pulses, beliefs, facts, period_s)
        if max(best.response_half_s) <= wanted_half_s:
            return best
        rounds += 1


def shortest_pulses_s(
    hoppers: Sequence[HopperSettings], beliefs: Sequence[HoseBelief], facts: ScaleFacts
) -> float:
    """Time that one pulse of each hopper takes, from powder on."""
    levels = [step_levels_g_min(hopper) for hopper in hoppers]
    return _pulses(1, levels, beliefs, facts).end_s


def _pulses(
    rounds: int, levels: Sequence[tuple[float, float]], beliefs: Sequence[HoseBelief],
    facts: ScaleFacts,
) -> PurgePulses:
    slowest_s = max(one.lag_s for one in beliefs) + facts.lag_s.value
    apart_s = max(_LEAST_APART_S, _LAGS_APART * slowest_s)
    weigh_from_s = max(one.dead_time_s for one in beliefs) + _LAGS_TO_SETTLE * slowest_s
    arrives_s = weigh_from_s + _BEFORE_FIRST_EDGE_S
    changes = []
    # the hopper whose powder comes first is first, so that set-points are in order, too
    order = sorted(range(len(beliefs)), key=lambda at: beliefs[at].dead_time_s)
    for _ in range(rounds):
        for hopper in order:
            for level in reversed(levels[hopper]):
                at_s = round((arrives_s - beliefs[hopper].dead_time_s) / _TICK_S) * _TICK_S
                changes.append(SetpointChange(at_s, hopper, level))
                arrives_s += apart_s
    return PurgePulses(tuple(low for low, _ in levels),
                       tuple(sorted(changes, key=lambda change: change.at_s)),
                       weigh_from_s, arrives_s, ())


def _with_prediction(
    pulses: PurgePulses, beliefs: Sequence[HoseBelief], facts: ScaleFacts, period_s: float
) -> PurgePulses:
    time_s = np.arange(pulses.weigh_from_s, pulses.end_s, period_s)
    predicted = predicted_hoses(setpoint_histories(pulses.lows_g_min, pulses.changes), time_s,
                                facts, beliefs)
    return PurgePulses(pulses.lows_g_min, pulses.changes, pulses.weigh_from_s, pulses.end_s,
                       tuple(one.response.half_width for one in predicted))


def setpoint_histories(
    lows_g_min: Sequence[float], changes: Sequence[SetpointChange]
) -> tuple[SetpointHistory, ...]:
    """Set-points of each hopper; the low ones count as set since long before."""
    times: list[list[float]] = [[-_LONG_AGO_S] for _ in lows_g_min]
    flows: list[list[float]] = [[low] for low in lows_g_min]
    for change in changes:
        times[change.hopper].append(change.at_s)
        flows[change.hopper].append(change.flow_g_min)
    return tuple(SetpointHistory(_array(at_s), _array(flow))
                 for at_s, flow in zip(times, flows, strict=True))


def _array(values: list[float]) -> FloatArray:
    return np.array(values, dtype=np.float64)
