"""Stop powder while the beam stays off for long, and bring it back steady before it comes on.

Powder that flows through a wait is lost, and a wait for heat is often longer than the layer it
precedes. So all hoppers stop together where a gap is long enough for that: they fall as fast as
their hoses let them, rest, and rise again at the mixture of the next bead. That mixture then stands
for as long as a run lets powder settle at its start, before the beam comes on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.machine import MachineProfile
from lmctl.field.kernel import inner_kernel
from lmctl.plan.recipe import Recipe
from lmctl.plan.sequence.mixture_ramps import COURSE_KNOTS, fastest_course

#: Knots of a pause: those of both courses, but the rise's first, which is nothing still.
PAUSE_KNOTS = 2 * len(COURSE_KNOTS)


@dataclass(frozen=True)
class PowderPause:
    """When powder stops in a gap between beads.

    steady_s : the next bead's flow is at the nozzle so long before it
    least_off_s : no flow is wanted for so long at least: shorter stops save little, and the hose
        would not run empty
    """

    steady_s: float
    least_off_s: float


def powder_pause_of(recipe: Recipe, profile: MachineProfile) -> PowderPause:
    """The pauses of a cell: what a feeder counts as stable when a run starts (`stabilise_s` from
    the first set-point on, or θ + 4τ) holds after each of them, too."""
    names = {hopper.feeder for hopper in recipe.hoppers}
    stable_s = max(feeder.stabilise_s for feeder in profile.feeder if feeder.name in names)
    least_dead_time_s, settled_s = float(recipe.dead_time_s.min()), 4 * float(recipe.lag_s.max())
    return PowderPause(
        max(settled_s, stable_s - least_dead_time_s),
        float(recipe.dead_time_s.max()) + settled_s)


@inner_kernel
def pause_knots(
    before: FloatArray, wanted: FloatArray, gap_s: float, lag: FloatArray, most: FloatArray,
    steady_s: float, least_off_s: float, times: FloatArray, flow: FloatArray,
) -> int:
    """Write knots of a pause from a gap's start on; how many, 0 where the gap is too short.

    before, wanted, lag, most : (m,) flows before and after [g/s], lags [s], greatest flows [g/s]
    times : (k,), flow : (k, m), of which the first `PAUSE_KNOTS` are written
    """
    nothing = np.zeros(len(before))
    fall_s = fastest_course(before, nothing, lag, most)
    rise_s = fastest_course(nothing, wanted, lag, most)
    rise_from_s = gap_s - steady_s - rise_s[-1]
    if rise_from_s - fall_s[-1] < least_off_s:
        return 0
    n = len(COURSE_KNOTS)
    for k in range(n):
        times[k], times[n + k] = fall_s[k], rise_from_s + rise_s[k]
        for m in range(len(before)):
            flow[k, m] = (1.0 - COURSE_KNOTS[k]) * before[m]
            flow[n + k, m] = COURSE_KNOTS[k] * wanted[m]
    return 2 * n
