"""Whether the scan of a worn part lies on the part's nominal shape, measured.

Where the part is not worn the scan must lie on the nominal surface, and nowhere above it. What a
rigid motion would bring onto the nominal surface is an error of registration, not wear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.part.bodies.body import Body
from lmctl.part.substrate.surface_heights import GridHeights

#: At least this share of the scan over the part lies on its nominal surface, and at most this
#: share above it.
LEAST_UNWORN, MOST_ABOVE = 0.1, 0.02
#: Steps of the search down to the nominal surface, of its motion, and how near is on it [mm].
_STEPS, _ROUNDS, _ON_IT_MM = 60, 15, 1e-3
#: Samples considered, at most.
_MOST_SAMPLES = 40_000
_HINT = "register the scan to the nominal part again, and check its units"


@dataclass(frozen=True)
class Registration:
    """How a scan lies on the nominal part.

    unworn_fraction : of the scan over the part, within the limit of the nominal surface
    off_mm : root mean square of that part; wear_mm : deepest below the nominal surface
    shift_mm : (3,) by which the unworn part of the scan is off
    """

    unworn_fraction: float
    off_mm: float
    wear_mm: float
    shift_mm: FloatArray


def check_registration(
    heights: GridHeights, nominal: Body, names: tuple[str, str], limit_mm: float
) -> Registration:
    """Measure how a scan lies on the nominal body.

    names : of the scan and of the body, for messages; limit_mm : how far it may be off
    Raises InputError, with the distance, where it does not lie on it.
    """
    scan, body = names
    samples = heights.nodes_mm()[heights.covered.ravel()]
    samples = samples[:: max(1, len(samples) // _MOST_SAMPLES)]
    low, high = nominal.tight_bounds_mm
    over = ((samples[:, :2] >= low[:2]) & (samples[:, :2] <= high[:2])).all(axis=1)
    top = _nominal_top(nominal, samples[over]) if over.any() else np.empty(0)
    on_part = samples[over][np.isfinite(top)] if over.any() else np.empty((0, 3))
    top = top[np.isfinite(top)]
    if len(on_part) == 0:
        away = -float(nominal.distance_at(samples).max()) if len(samples) else float("inf")
        raise InputError(f"{scan} does not lie over {body!r}: it is {away:.1f} mm beside it at the "
                         "nearest", where="substrate.of", hint=_HINT)
    wear = top - on_part[:, 2]
    above = wear < -limit_mm
    if above.mean() > MOST_ABOVE:
        raise InputError(
            f"{scan} lies above {body!r} over {above.mean():.0%} of it, by up to "
            f"{-wear.min():.2f} mm (median there {np.median(-wear[above]):.2f} mm)",
            where=f"substrate.registration_mm = {limit_mm:g}", hint=_HINT)
    unworn = np.abs(wear) <= limit_mm
    if unworn.mean() < LEAST_UNWORN:
        raise InputError(
            f"{scan} lies on {body!r} over {unworn.mean():.0%} of it only: half of it is more than "
            f"{np.median(np.abs(wear)):.2f} mm off",
            where=f"substrate.registration_mm = {limit_mm:g}",
            hint=f"{_HINT}; where all of the face is worn, leave `of` out of [substrate]")
    shift = _shift_mm(nominal, on_part, limit_mm)
    if np.linalg.norm(shift) > limit_mm:
        raise InputError(
            "{} is shifted against {!r} by {:.2f} mm: x {:.2f}, y {:.2f}, z {:.2f}".format(
                scan, body, float(np.linalg.norm(shift)), *shift),
            where=f"substrate.registration_mm = {limit_mm:g}", hint=_HINT)
    return Registration(float(unworn.mean()), float(np.sqrt((wear[unworn] ** 2).mean())),
                        float(wear.max()), shift)


def _nominal_top(nominal: Body, samples: FloatArray) -> FloatArray:
    """Height of the nominal surface at samples (n, 3), from above; NaN where there is none."""
    low, high = nominal.tight_bounds_mm
    at = samples.copy()
    at[:, 2] = max(float(high[2]), float(samples[:, 2].max())) + 1.0
    going = np.arange(len(at))
    for _ in range(_STEPS):
        outside = -nominal.distance_at(at[going])
        at[going, 2] -= np.maximum(outside, 0.0)
        going = going[(outside > _ON_IT_MM) & (at[going, 2] > low[2])]
        if len(going) == 0:
            break
    depth = nominal.distance_at(at)
    return np.where((at[:, 2] > low[2]) & (depth > -0.05), at[:, 2], np.nan)


def _shift_mm(nominal: Body, samples: FloatArray, limit_mm: float) -> FloatArray:
    """By how much samples (n, 3) are off the nominal surface as a whole, (3,).

    Least squares along the surface's normals with turn and shift, worn places counting little
    (weights of Cauchy). A direction that the surface does not fix, as along a flat face, is 0.
    """
    near = samples[np.abs(nominal.distance_at(samples)) < 5 * limit_mm]
    if len(near) < 6:
        return np.zeros(3)
    middle = near.mean(axis=0)
    moved, turn, shift = near.copy(), np.eye(3), np.zeros(3)
    size = float(np.linalg.norm(near - middle, axis=1).max())
    for _ in range(_ROUNDS):
        depth, normal = nominal.distance_at(moved), nominal.inward_directions(moved)
        weight = 1.0 / (1.0 + (depth / (0.25 * limit_mm)) ** 2)
        rows = np.hstack([normal, np.cross((moved - middle) / size, normal)])
        square = (rows * weight[:, None]).T @ rows
        square += 0.01 * np.trace(square) / 6 * np.eye(6)
        step = np.linalg.solve(square, -(rows * weight[:, None]).T @ depth)
        turning = _rotation(step[3:] / size)
        moved = (moved - middle) @ turning.T + middle + step[:3]
        turn, shift = turning @ turn, turning @ shift + step[:3]
        if np.linalg.norm(step) < 1e-4:
            break
    return np.asarray(-shift)


def _rotation(vector: FloatArray) -> FloatArray:
    """The rotation about a vector (3,) by its length [rad]."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)
