"""From a PLY file with normals to a part: what they decide, and that what is done is said."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.field.plane import loop_area_mm2
from lmctl.part.load import load_part

Folder = Callable[..., Path]

COUNT = 2500
LONG, WIDE = 20.0, 16.0
MM_PER_INCH = 25.4
PART = """
name = "plate"
pitch_mm = 0.25
[[material]]
name = "316L"
[[body]]
kind = "cloud"
file = "plate.ply"
units = "{units}"
"""


def plate(thick: float) -> tuple[FloatArray, FloatArray]:
    """Points some 0.53 mm apart all over a plate on edge, and its outward normals."""
    rng = np.random.default_rng(7)
    size = np.array([LONG, thick, WIDE])
    points = rng.uniform(0, 1, (COUNT, 3)) * size
    faces = np.prod(size) / size
    axis, up = rng.choice(3, COUNT, p=faces / faces.sum()), rng.integers(0, 2, COUNT)
    points[np.arange(COUNT), axis] = up * size[axis]
    normals = np.zeros_like(points)
    normals[np.arange(COUNT), axis] = 2.0 * up - 1.0
    return points, normals


def ply(points: FloatArray, normals: FloatArray | None) -> bytes:
    names = ("x", "y", "z") if normals is None else ("x", "y", "z", "nx", "ny", "nz")
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    head += [f"property double {name}" for name in names] + ["end_header\n"]
    rows = points if normals is None else np.hstack([points, normals])
    return "\n".join(head).encode() + rows.astype("<f8").tobytes()


def written(
    folder: Folder, points: FloatArray, normals: FloatArray | None, units: str = "mm"
) -> Path:
    text = PART.format(units=units)
    return folder(part__toml=text, plate__ply=ply(points, normals)) / "part.toml"


@pytest.mark.parametrize("units", ["mm", "inch"])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_plate_of_1_mm_is_decided_by_its_normals(folder: Folder, units: str, way: float) -> None:
    points, normals = plate(1.0)
    part = load_part(
        written(folder, points / (1.0 if units == "mm" else MM_PER_INCH), way * normals, units)
    )
    heights = (3.0, 5.0, 8.0, 11.0, 13.0)
    areas = [sum(loop_area_mm2(loop) for loop in part.section(z).loops) for z in heights]
    assert areas == pytest.approx([LONG * 1.0] * 5, rel=0.02)
    turned = "the normals of the cloud point inwards: they were turned round"
    assert (turned in part.warnings) == (way < 0.0)
    assert any("than the samples are apart" in said for said in part.warnings)


def test_without_its_normals_it_is_refused(folder: Folder) -> None:
    with pytest.raises(InputError, match="cannot be distinguished"):
        load_part(written(folder, plate(1.0)[0], None))


def test_a_plate_thinner_than_its_samples_are_apart_is_refused(folder: Folder) -> None:
    with pytest.raises(InputError, match=r"walls 0\.3 mm thick are thinner than the samples") as no:
        load_part(written(folder, *plate(0.3)))
    assert "or give a mesh" in no.value.hint


def test_normals_that_make_no_sense_are_said(folder: Folder) -> None:
    points, normals = plate(6.0)
    nonsense = np.random.default_rng(8).normal(size=normals.shape)
    part = load_part(written(folder, points, nonsense))
    assert any("normals of the cloud" in said and "not used" in said for said in part.warnings)
