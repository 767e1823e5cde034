"""What the nozzle must deliver against program time: knots of every hopper's flow.

Along beads the flow follows the mixture, linear from vertex to vertex. From bead to bead it
changes while the beam is off: along a ramp that the feeders can follow (mode "lead"), or at once
as soon as the beam is off, as machines without compensation do ("dwell", "none").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.job.schema import LineKind
from lmctl.plan.moves import Moves
from lmctl.plan.ramps import Limits, ramp
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
        rest = (now_s + course_s, (share - 1)[:, None] * change)
        inside = rest[0] < knots_s[0] - 1e-9
        times += [np.array([now_s]), rest[0][inside]]
        flows += [now[None], wanted[0] + rest[1][inside]]
        knots_s, wanted = _with_rest(knots_s, wanted, rest)
        times.append(knots_s)
        flows.append(wanted)
        now_s, now = float(knots_s[-1]), wanted[-1]
    times.append(np.array([now_s, float(end_s[-1])]))
    flows.append(np.vstack([now, now]))
    return _thinned(np.concatenate(times), np.vstack(flows))


def _with_rest(
    knots_s: FloatArray, wanted: FloatArray, rest: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """A bead's flow plus what a change of mixture has left over when the beam comes on."""
    course_s, missing = rest
    late = (course_s > knots_s[0]) & (course_s < knots_s[-1])
    if course_s[-1] <= knots_s[0] + 1e-9:
        return knots_s, wanted
    every_s = np.union1d(knots_s, course_s[late])
    both = np.empty((len(every_s), wanted.shape[1]))
    for hopper in range(wanted.shape[1]):
        both[:, hopper] = np.interp(every_s, knots_s, wanted[:, hopper]) + np.interp(
            every_s, course_s, missing[:, hopper])
    return every_s, np.maximum(both, 0.0)


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
