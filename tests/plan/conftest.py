"""Slices whose truth is known, cut by hand; and small parts made of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import lmctl.examples
from lmctl.config.machine import load_profile
from lmctl.config.part_file import ProcessSettings
from lmctl.config.substrate import SubstrateSettings
from lmctl.field.outline_distance import plane_distance
from lmctl.field.plane import PlaneGrid
from lmctl.part.load import load_part
from lmctl.part.materials.powders import MaterialSpec
from lmctl.part.named_bodies import NO_NAMED_BODIES, NamedBodies
from lmctl.plan.planner import PlanOptions, plan_job
from lmctl.plan.recipe import make_recipe
from tests.plan.planned_jobs import layers_of

TURN = 2 * np.pi

MATERIALS = (
    MaterialSpec("316L", 0.00785, None, 0.75, 1500.0, 10.0, ()),
    MaterialSpec("WC-12Co", 0.0143, None, 0.55, 1800.0, 10.0, ()),
)
PROCESS = ProcessSettings()
UNKNOWN_PLATE = SubstrateSettings()


@dataclass(frozen=True)
class FakeSection:
    z_mm: float
    grid: PlaneGrid
    loops: list
    distance: np.ndarray
    spatial_distance: np.ndarray


def cut(loops, pitch_mm=0.25, z_mm=0.0):
    points = np.vstack(loops)
    low = np.floor(points.min(axis=0) / pitch_mm) - 3
    high = np.ceil(points.max(axis=0) / pitch_mm) + 3
    nx, ny = (high - low + 1).astype(int)
    grid = PlaneGrid((low[0] * pitch_mm, low[1] * pitch_mm), pitch_mm, (int(ny), int(nx)))
    distance = plane_distance(loops, grid)
    return FakeSection(z_mm, grid, loops, distance, distance)


def circle(radius, centre=(0.0, 0.0), n=720, clockwise=False):
    turn = np.linspace(0, TURN, n + 1)
    turn = turn[::-1] if clockwise else turn
    loop = np.stack([centre[0] + radius * np.cos(turn), centre[1] + radius * np.sin(turn)], axis=1)
    loop[-1] = loop[0]
    return loop


def rectangle(width, height, centre=(0.0, 0.0)):
    x, y = width / 2, height / 2
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y], [-x, -y]]) + centre


def gear(teeth=20, outer=30.0, root=24.5, bore=8.0):
    """A gear's outline: trapezoidal teeth, half as wide at the tip as the gap between them."""
    corners = []
    for tooth in range(teeth):
        at = TURN * tooth / teeth
        for radius, share in ((root, -0.34), (outer, -0.15), (outer, 0.15), (root, 0.34)):
            turn = at + share * TURN / teeth
            corners.append((radius * np.cos(turn), radius * np.sin(turn)))
    corners.append(corners[0])
    return [np.array(corners), circle(bore, clockwise=True)]


@pytest.fixture
def shapes():
    return {
        "disc": [circle(10.0)],
        "small disc": [circle(2.3)],
        "annulus": [circle(15.0), circle(9.0, clockwise=True)],
        "rectangle": [rectangle(30.0, 17.0)],
        "square": [rectangle(20.0, 20.0)],
        "wall 1.0": [rectangle(40.0, 2.0)],
        "wall 1.05": [rectangle(40.0, 2.1)],
        "wall 1.3": [rectangle(40.0, 2.6)],
        "wall 1.7": [rectangle(40.0, 3.4)],
        "wall 2.2": [rectangle(40.0, 4.4)],
        "gear": gear(),
        "islands": [circle(4.0), rectangle(7, 9, (12.0, 0.0)), circle(6.0, (0.0, 14.0))],
        "wedge": [np.array([[0, 0], [40, -5], [40, 5], [0, 0.0]])],
    }


@pytest.fixture
def section():
    return cut


@dataclass(frozen=True)
class FakePart:
    """A prism of one outline, or of an outline by height; what `plan_job` asks of a part."""

    outline: object
    mixture: object
    height_mm: float = 1.6
    process: ProcessSettings = PROCESS
    materials: tuple = MATERIALS
    placement_mm: tuple | None = None
    substrate_surface: None = None
    layer_stack: None = None
    copies: tuple = ()
    name: str = "prism"
    text: str = 'name = "prism"\n'
    sources: tuple = ()
    warnings: tuple = ()
    pitch_mm: float = 0.25
    turning_mm: tuple = ()
    surface_error_mm: float | None = None
    named_bodies: NamedBodies = NO_NAMED_BODIES
    substrate: SubstrateSettings = UNKNOWN_PLATE
    alloy_rules: None = None
    build_heat: object = None

    @property
    def turning_heights_mm(self):
        return np.array(self.turning_mm)

    def loops_at(self, z_mm):
        return self.outline(z_mm) if callable(self.outline) else self.outline

    @property
    def bounds_mm(self):
        every = np.vstack([loop for z in np.linspace(0, self.height_mm * 0.999, 9)
                           for loop in self.loops_at(z)])
        return (np.array([*every.min(axis=0), 0.0]), np.array([*every.max(axis=0), self.height_mm]))

    def section(self, z_mm):
        return cut(self.loops_at(z_mm), self.pitch_mm, z_mm)

    def uniform_mixture(self):
        return None

    def composition(self, points_mm):
        second = np.clip(np.asarray(self.mixture(points_mm), dtype=float), 0, 1)
        second = np.broadcast_to(second, len(points_mm))
        return np.stack([1 - second, second], axis=1)


@pytest.fixture
def make_part():
    return FakePart


@pytest.fixture
def profile():
    return load_profile(Path(lmctl.examples.__file__).parent / "cell.toml")


@pytest.fixture
def recipe(profile):
    return make_recipe(MATERIALS, PROCESS, profile)


@pytest.fixture
def materials():
    return MATERIALS


@pytest.fixture
def plan(tmp_path, profile):
    """Plans the text of a part file, with options of `PlanOptions`; returns (manifest, layers)."""

    def planned(text, **options):
        file = tmp_path / "part.toml"
        file.write_text(text, encoding="utf-8")
        plan_job(load_part(file), profile, tmp_path / "part.lmj", options=PlanOptions(**options))
        return layers_of(tmp_path / "part.lmj")

    return planned
