"""A box with a gradient along x, as much of a job as comparing asks for, and builds of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from lmctl.as_built.built_volume import BuiltPath, BuiltVolume, PowderUse
from lmctl.part.load import part_from_text

BOX = """
name = "bar"
[[material]]
name = "A"
density_g_cm3 = 8
catch_efficiency = 0.7
power_W = 1000
speed_mm_s = 10
[[material]]
name = "B"
density_g_cm3 = 8
catch_efficiency = 0.7
power_W = 1000
speed_mm_s = 10
[[body]]
kind = "box"
low_mm = [0, 0, 0]
high_mm = [20, 10, 8]
[composition]
feature = { kind = "plane", point_mm = [0, 0, 0], normal = [1, 0, 0] }
profile = { kind = "linear", near = { "A" = 1.0 }, far = { "B" = 1.0 }, over_mm = [0, 20] }
[process]
bead_width_mm = 2.0
layer_height_mm = 0.8
"""
#: Where the part's origin lies on the machine.
AT_MM = np.array([50.0, 60.0, 0.0])
VOXEL = 0.5


class BoxJob:
    """Ten layers of three straight beads along x."""

    def __init__(self) -> None:
        layers = tuple(
            SimpleNamespace(z_mm=0.8 * (k + 1), first_line=10 * k) for k in range(10))
        self.manifest = SimpleNamespace(part_offset_mm=tuple(AT_MM), layers=layers, totals={})

    def iterate_layers(self) -> Iterator[SimpleNamespace]:
        for entry in self.manifest.layers:
            ends = np.array([(x, y, entry.z_mm) for y in (2.0, 5.0, 8.0) for x in (0.0, 20.0)])
            ends = ends[[0, 1, 2, 3, 4, 5]] + [*AT_MM[:2], 0.0]
            lines = np.zeros(6, dtype=[("x_mm", "f8"), ("y_mm", "f8"), ("z_mm", "f8")])
            for column, axis in enumerate(("x_mm", "y_mm", "z_mm")):
                lines[axis] = ends[:, column]
            yield SimpleNamespace(first_line=entry.first_line, lines=lines)

    def beads(self) -> tuple[np.ndarray, np.ndarray]:
        """Places of pieces of a millimetre, (n, 3) in program coordinates, and their lines."""
        place, line = [], []
        for layer in self.iterate_layers():
            for row in (1, 3, 5):
                x = np.arange(0.5, 20) + AT_MM[0]
                y, z = layer.lines["y_mm"][row], layer.lines["z_mm"][row]
                place.append(np.stack([x, np.full(20, y), np.full(20, z)], axis=1))
                line.append(np.full(20, layer.first_line + row))
        return np.concatenate(place), np.concatenate(line)


@pytest.fixture(scope="session")
def bar():
    return part_from_text(BOX, Path(), "bar")


@pytest.fixture
def job() -> BoxJob:
    return BoxJob()


@pytest.fixture
def perfect(job) -> BuiltVolume:
    """The box exactly as designed, with two planes of plate below."""
    shape = (48, 28, 22)
    origin = AT_MM - [1.0, 1.0, 1.0]
    x, y, z = np.meshgrid(*(origin[a] + VOXEL * (np.arange(shape[a]) + 0.5) - AT_MM[a]
                            for a in range(3)), indexing="ij")
    inside = (x > 0) & (x < 20) & (y > 0) & (y < 10) & (z > 0) & (z < 8)
    deposited = np.zeros((3, *shape), dtype=np.float32)
    share_b = np.clip(x / 20, 0, 1)
    deposited[0] = VOXEL**3 * inside * (1 - share_b)
    deposited[1] = VOXEL**3 * inside * share_b
    deposited[2, :, :, :2] = VOXEL**3
    place, line = job.beads()
    at_b = (place[:, 0] - AT_MM[0]) / 20
    layer = line // 10
    return BuiltVolume(
        "simulated", origin, np.full(3, VOXEL), ("A", "B", "S355"), "", deposited,
        np.where(inside.any(axis=2), 8.0, 0.0), 0.0,
        BuiltPath(place, np.ones(len(line)),
                  np.stack([1 - at_b, at_b, np.zeros(len(line))], axis=1), 0.8 * layer, line),
        PowderUse(np.array([0.008, 0.008, np.nan]), np.array([12.0, 12.0, 0]),
                  np.array([10.0, 10.0, 0]), np.array([2.0, 2.0, 0])), ())


@pytest.fixture
def changed(perfect):
    """A perfect build, changed by a function of its volumes."""
    def change(act) -> BuiltVolume:
        volumes = perfect.deposited_mm3.copy()
        act(volumes)
        return replace(perfect, deposited_mm3=volumes)

    return change
