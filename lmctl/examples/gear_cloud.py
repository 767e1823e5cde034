"""The main example's gear: its analytic outline, and a noisy scan of it.

An involute spur gear (20 teeth, outer ⌀60, root ⌀49, bore ⌀16 mm, 9.6 mm thick) standing on z = 0
around the z axis. The scan is what a part comes from in real life: points in no order, without
normals, each off by the scanner's noise.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray

TEETH = 20
OUTER_RADIUS_MM = 30.0
ROOT_RADIUS_MM = 24.5
BORE_RADIUS_MM = 8.0
THICKNESS_MM = 9.6  # twelve layers of 0.8

#: Points and noise (standard deviation of each coordinate) of the scan.
SCAN_POINTS = 60_000
NOISE_MM = 0.02

_PRESSURE_ANGLE = np.deg2rad(20.0)
_PITCH_RADIUS_MM = OUTER_RADIUS_MM * TEETH / (TEETH + 2)  # addendum of one module
_BASE_RADIUS_MM = _PITCH_RADIUS_MM * np.cos(_PRESSURE_ANGLE)


def tooth_half_angle(radius_mm: FloatArray) -> FloatArray:
    """Half the angle a tooth spans at a radius, root to tip [rad].

    Involute flanks outside the base circle, radial ones inside it: π/2z + inv α₀ − inv α(r).
    """
    radius = np.maximum(np.asarray(radius_mm, dtype=np.float64), _BASE_RADIUS_MM)
    alpha = np.arccos(_BASE_RADIUS_MM / radius)
    involute = np.tan(_PRESSURE_ANGLE) - _PRESSURE_ANGLE
    half: FloatArray = np.pi / (2 * TEETH) + involute - (np.tan(alpha) - alpha)
    return half


def gear_outline(per_flank: int = 40) -> FloatArray:
    """The toothed outline, counter-clockwise, closed: (k, 2) float64 [mm], first point last.

    per_flank : points on each flank and each arc; 40 is within 2 µm of the true curves
    """
    radius = np.linspace(ROOT_RADIUS_MM, OUTER_RADIUS_MM, per_flank)
    flank = tooth_half_angle(radius)
    half_pitch = np.pi / TEETH
    root = np.linspace(-half_pitch, -flank[0], per_flank)
    tip = np.linspace(-flank[-1], flank[-1], per_flank)
    angle = np.concatenate([root[:-1], -flank[:-1], tip[:-1], flank[::-1][:-1], -root[::-1][:-1]])
    radii = np.concatenate([
        np.full(per_flank - 1, ROOT_RADIUS_MM), radius[:-1],
        np.full(per_flank - 1, OUTER_RADIUS_MM), radius[::-1][:-1],
        np.full(per_flank - 1, ROOT_RADIUS_MM),
    ])
    turns = 2 * half_pitch * np.arange(TEETH)
    angles = (turns[:, None] + angle[None, :]).ravel()
    loop = np.tile(radii, TEETH)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.vstack([loop, loop[:1]])


def bore_outline(points: int = 720) -> FloatArray:
    """The bore, clockwise, closed: (points + 1, 2) float64 [mm]."""
    angle = -2 * np.pi * np.arange(points) / points
    loop = BORE_RADIUS_MM * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.vstack([loop, loop[:1]])


def inside_gear(points: FloatArray) -> NDArray[np.bool_]:
    """Whether places (n, 2) [mm] of the plane lie in the gear's section."""
    radius = np.hypot(points[:, 0], points[:, 1])
    angle = np.arctan2(points[:, 1], points[:, 0])
    off_tooth = np.abs((angle + np.pi / TEETH) % (2 * np.pi / TEETH) - np.pi / TEETH)
    in_tooth = (radius <= OUTER_RADIUS_MM) & (off_tooth <= tooth_half_angle(radius))
    return (radius >= BORE_RADIUS_MM) & ((radius <= ROOT_RADIUS_MM) | in_tooth)


def gear_cloud(
    points: int = SCAN_POINTS, noise_mm: float = NOISE_MM, seed: int = 20
) -> FloatArray:
    """A scan: (points, 3) float64 [mm], even over the surface, in no order, without normals."""
    random = np.random.default_rng(seed)
    loops = [gear_outline(), bore_outline()]
    walls = [THICKNESS_MM * _length(loop) for loop in loops]
    face = _area(loops[0]) + _area(loops[1])
    surface = np.array([*walls, face, face])
    counts = random.multinomial(points, surface / surface.sum())
    pieces = [_on_wall(loop, n, random) for loop, n in zip(loops, counts, strict=False)]
    for z, n in zip((0.0, THICKNESS_MM), counts[2:], strict=True):
        pieces.append(np.column_stack([_on_face(int(n), random), np.full(n, z)]))
    cloud = random.permutation(np.vstack(pieces))
    return cloud + random.normal(scale=noise_mm, size=cloud.shape)


def write_gear_cloud(path: Path) -> None:
    """Write the scan as an XYZ file."""
    lines = ["# spur gear, points in no order, mm"]
    lines += [f"{x:.4f} {y:.4f} {z:.4f}" for x, y, z in gear_cloud().tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def _on_wall(loop: FloatArray, count: int, random: np.random.Generator) -> FloatArray:
    lengths = np.linalg.norm(np.diff(loop, axis=0), axis=1)
    edge = random.choice(len(lengths), size=count, p=lengths / lengths.sum())
    t = random.random((count, 1))
    flat = loop[edge] + t * (loop[edge + 1] - loop[edge])
    return np.column_stack([flat, THICKNESS_MM * random.random(count)])


def _on_face(count: int, random: np.random.Generator) -> FloatArray:
    found = np.empty((0, 2))
    while len(found) < count:
        tried = random.uniform(-OUTER_RADIUS_MM, OUTER_RADIUS_MM, size=(2 * count, 2))
        found = np.vstack([found, tried[inside_gear(tried)]])
    return found[:count]


def _length(loop: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(loop, axis=0), axis=1).sum())


def _area(loop: FloatArray) -> float:
    x, y = loop.T
    return float(0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))
