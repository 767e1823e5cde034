"""How much slower a bead must be for powder to follow its mixture.

On a slower bead the mixture changes more slowly in time, and less flow is needed: half the speed
halves what the lag demands. Where no speed is slow enough, the result is the speed at which the
mixture is wrong for the least time. A jump takes the hoses the same time at any speed, so it does
not slow the bead.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IndexArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.plan.recipe import Recipe
from lmctl.plan.sequence.mixture_ramps import (
    MAX_KNOT_SPACING_S,
    NO_LAG_S,
    approach_flow,
    deliverable_ramp_fraction,
    has_caught_up,
    powder_limits_of,
)

#: Volume fraction within which a predicted mixture counts as right.
MIXTURE_TOLERANCE_FRACTION = 0.02
#: Where the mixture changes too fast along a path, the path is slowed down, but not below this.
SPEED_FACTORS = (1.0, 0.85, 0.7, 0.6, 0.5)
#: A slower speed has to leave no more than this part of the time with a wrong mixture.
_WORTH = 0.9


def speed_factors(
    durations_s: FloatArray, flow_g_s: FloatArray, starts: IndexArray, so_far: FloatArray,
    least: FloatArray, varies: NDArray[np.bool_], recipe: Recipe,
) -> FloatArray:
    """The greatest factor (m,) on the speed of each bead at which powder can follow its mixture.

    durations_s : (v,) from the vertex before; flow_g_s : (v, hoppers) at the recipe's speed
    starts : (m + 1,) bead k is vertices starts[k] to starts[k + 1]
    so_far : (m,) speed factors the beads have already; least : (m,) not to go below in all
    varies : (m,) bool, whose mixture changes; the others keep their speed
    """
    limits = powder_limits_of(recipe)
    return np.asarray(_factors(
        durations_s, flow_g_s, starts, so_far, least, varies,
        np.maximum(limits.lag_s, NO_LAG_S), limits.max_flow_g_s, limits.volume_mm3_g,
        np.array(SPEED_FACTORS)))


@kernel
def _factors(
    durations: FloatArray, flow: FloatArray, starts: IndexArray, so_far: FloatArray,
    least: FloatArray, varies: NDArray[np.bool_], lag: FloatArray, most: FloatArray,
    volume: FloatArray, choices: FloatArray,
) -> FloatArray:
    result = np.ones(len(varies))
    now = np.empty(flow.shape[1])
    goal = np.empty(flow.shape[1])
    for bead in range(len(varies)):
        if not varies[bead]:
            continue
        best_off = np.inf
        for choice in choices:
            scale = so_far[bead] * choice
            if choice != choices[0] and scale < least[bead]:
                break
            for m in range(len(now)):
                now[m] = flow[starts[bead], m] * scale
            off = 0.0
            for k in range(starts[bead] + 1, starts[bead + 1]):
                lasting = durations[k] / choice
                for m in range(len(goal)):
                    goal[m] = flow[k - 1, m] * scale
                follows = has_caught_up(now, goal, most)
                for m in range(len(goal)):
                    goal[m] = flow[k, m] * scale
                follows = follows and deliverable_ramp_fraction(now, goal, lasting, lag,
                                                                most) >= 1 - 1e-9
                pieces = 1 if follows else max(1, int(np.ceil(lasting / MAX_KNOT_SPACING_S)))
                for piece in range(1, pieces + 1):
                    t = piece / pieces
                    for m in range(len(goal)):
                        goal[m] = (flow[k - 1, m] + t * (flow[k, m] - flow[k - 1, m])) * scale
                    share = deliverable_ramp_fraction(now, goal, lasting / pieces, lag, most)
                    approach_flow(now, goal, min(share, 1.0))
                    if _is_off(now, goal, volume):
                        off += lasting / pieces
            if off == 0.0:
                result[bead] = choice
                break
            if off < _WORTH * best_off:
                result[bead], best_off = choice, off
    return result


@inner_kernel
def _is_off(flow: FloatArray, wanted: FloatArray, volume: FloatArray) -> bool:
    """Whether flows deposit another mixture than wanted."""
    total, other = 0.0, 0.0
    for m in range(len(flow)):
        total += flow[m] * volume[m]
        other += wanted[m] * volume[m]
    for m in range(len(flow)):
        if abs(flow[
            m] * volume[m] / total - wanted[m] * volume[m] / other) > MIXTURE_TOLERANCE_FRACTION:
            return True
    return False
