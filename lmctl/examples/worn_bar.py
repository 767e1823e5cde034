"""The data of the example `repair`: a bar with a crowned face as a mesh, and a scan of it worn."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lmctl.array_types import FloatArray

#: The bar: half its length and width, height at its ends, and how much higher its middle is.
HALF_LENGTH_MM, HALF_WIDTH_MM, HEIGHT_MM, CROWN_MM = 30.0, 15.0, 10.0, 3.0
#: The worn place: half its length and width, and its depth.
WORN_X_MM, WORN_Y_MM, WEAR_MM = 18.0, 9.0, 2.0
POINTS, NOISE_MM = 12_000, 0.02
_STRIPS = 48


def nominal_height_mm(x_mm: FloatArray) -> FloatArray:
    """Height of the nominal face along the bar, an arc: (n,) -> (n,)."""
    radius = (HALF_LENGTH_MM**2 + CROWN_MM**2) / (2 * CROWN_MM)
    return np.asarray(HEIGHT_MM + CROWN_MM - radius + np.sqrt(radius**2 - np.square(x_mm)))


def wear_mm(places_mm: FloatArray) -> FloatArray:
    """How deep the face is worn at places (n, 2) -> (n,): a trough with a flat floor."""
    edge = np.hypot(places_mm[:, 0] / WORN_X_MM, places_mm[:, 1] / WORN_Y_MM)
    return np.asarray(WEAR_MM * np.clip(2.5 * (1 - edge), 0.0, 1.0))


def write_nominal_bar(path: Path) -> None:
    """Write the bar's mesh as a binary STL file."""
    x = np.linspace(HALF_LENGTH_MM, -HALF_LENGTH_MM, _STRIPS + 1)
    section = np.vstack([
        [[-HALF_LENGTH_MM, 0.0], [HALF_LENGTH_MM, 0.0]],
        np.column_stack([x, nominal_height_mm(x)])])
    following = np.roll(section, -1, axis=0)
    front, back = (
        np.column_stack([section[:, 0], np.full(len(section), y), section[:, 1]])
        for y in (-HALF_WIDTH_MM, HALF_WIDTH_MM))
    to_front, to_back = (
        np.column_stack([following[:, 0], np.full(len(section), y), following[:, 1]])
        for y in (-HALF_WIDTH_MM, HALF_WIDTH_MM))
    fan = range(1, len(section) - 1)
    triangles = np.concatenate([
        np.stack([front, back, to_back], axis=1), np.stack([front, to_back, to_front], axis=1),
        np.array([[front[0], front[k], front[k + 1]] for k in fan]),
        np.array([[back[0], back[k + 1], back[k]] for k in fan])])
    facets = np.zeros(len(triangles), np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)),
                                                ("attribute", "<u2")]))
    facets["corners"] = triangles
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    facets["normal"] = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]
    path.write_bytes(b"crowned bar".ljust(80) + np.uint32(len(facets)).tobytes()
                     + facets.tobytes())


def write_worn_bar(path: Path) -> None:
    """Write the scan of the worn face as a CSV file: points in no order, with noise."""
    random = np.random.default_rng(3)
    places = random.uniform([-HALF_LENGTH_MM, -HALF_WIDTH_MM], [HALF_LENGTH_MM, HALF_WIDTH_MM],
                            (POINTS, 2))
    height = nominal_height_mm(places[:, 0]) - wear_mm(places)
    height += random.normal(scale=NOISE_MM, size=POINTS)
    lines = ["x,y,z"]
    lines += [f"{x:.3f},{y:.3f},{z:.3f}" for (x, y), z in zip(
        places.tolist(), height.tolist(), strict=True)]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
