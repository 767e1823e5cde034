"""What the nozzle must deliver against program time: knots of every hopper's flow.

Along beads the flow follows the mixture, linear from vertex to vertex; in mode "lead" as nearly as
hoppers can. From bead to bead it changes while the beam is off: along a ramp that the feeders can
follow (mode "lead"), or at once as soon as the beam is off, as machines without compensation do
("dwell", "none").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.job.schema import LineKind
from lmctl.plan.moves import Moves
from lmctl.plan.ramps import Limits, followed, ramp
from lmctl.plan.recipe import Recipe

FloatArray = NDArray[np.float64]

#: A set-point step, as knots of a piecewise-linear flow need one [s].
_STEP_S = 1e-3


@dataclass(frozen=True)
class Flow:
    """times_s : (k,) rising; g_s : (k, m) [g/s], linear in between."""

    times_s: FloatArray
    g_s: FloatArray


def limits_of(recipe: Recipe) -> Limits:
    return Limits(recipe.lag_s, recipe.max_flow_g_s,
                  recipe.catch_efficiency / recipe.density_g_mm3)


def layer_flow(
    moves: Moves, start_s: float, end_s: FloatArray, paces: list[float], recipe: Recipe, mode: str,
    before_g_s: FloatArray,
) -> Flow:
    """Flow wanted at the nozzle during one layer.

    end_s : (n,) program time at each line's end; paces : of each path (beads.py)
    before_g_s : (m,) flow at the end of the layer before
    """
    limits = limits_of(recipe)
    times: list[FloatArray] = []
    flows: list[FloatArray] = []
    now_s, now = start_s, before_g_s
    for path, pace in enumerate(paces):
        bead = np.flatnonzero((moves.kind == LineKind.BEAD) & (moves.path == path))
        knots_s = np.concatenate([[end_s[bead[0] - 1]], end_s[bead]])
        before_bead = moves.fractions[bead[0] - 1] if moves.path[bead[0] - 1] == path \
            else moves.fractions[bead[0]]
        wanted = recipe.flow_g_s(np.vstack([before_bead, moves.fractions[bead]]), pace)
        gap_s = float(knots_s[0] - now_s)
        if mode == "lead":
            course_s, share = ramp(now, wanted[0], gap_s, limits)
        else:
            course_s, share = np.array([0.0, min(_STEP_S, gap_s / 2)]), np.array([0.0, 1.0])
        change = wanted[0] - now
        inside = course_s < gap_s - 1e-9
        times += [np.array([now_s]), now_s + course_s[inside]]
        flows += [now[None], now + share[inside, None] * change]
        if mode == "lead":
            arrived = now + np.interp(gap_s, course_s, share) * change
            knots_s, wanted = followed(knots_s, wanted, arrived, limits)
        times.append(knots_s)
        flows.append(wanted)
        now_s, now = float(knots_s[-1]), wanted[-1]
    times.append(np.array([now_s, float(end_s[-1])]))
    flows.append(np.vstack([now, now]))
    return _thinned(np.concatenate(times), np.vstack(flows))


def _thinned(times_s: FloatArray, flow: FloatArray) -> Flow:
    """Strictly rising times, without knots in the middle of constant stretches."""
    end_s = times_s[-1]
    keep = np.concatenate([[True], np.diff(times_s) > 1e-9])
    times_s, flow = times_s[keep], flow[keep]
    times_s[-1] = end_s
    same = np.asarray((np.abs(np.diff(flow, axis=0)) <= 1e-12).all(axis=1))
    inner = np.zeros(len(times_s), dtype=np.bool_)
    inner[1:-1] = same[1:] & same[:-1]
    return Flow(times_s[~inner], np.maximum(flow[~inner], 0.0))
