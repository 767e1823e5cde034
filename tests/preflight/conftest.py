"""A job's manifest and a part that fit the bench cell, to be spoilt one way at a time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import lmctl.examples
from lmctl.config.machine import load_profile
from lmctl.config.part_file import ProcessSettings
from lmctl.job.schema import JobHopper, JobManifest
from lmctl.part.materials.powders import MaterialSpec


@pytest.fixture
def profile():
    return load_profile(Path(lmctl.examples.__file__).parent / "cell.toml")


@pytest.fixture
def manifest(profile):
    return JobManifest(
        part_name="disc", part_sha256="", sources={}, machine=profile.name,
        profile_digest=profile.planning_digest(), software="lmctl", powder_mode="lead",
        s_max=1000, max_power_W=3000.0, send_horizon_s=1.0, materials=("316L", "WC-12Co"),
        hoppers=(JobHopper("A", "316L", 3.0, 1.0, 60.0), JobHopper("B", "WC-12Co", 2.6, 0.8, 60.0)),
        bounds_mm=((10.0, 10.0, 0.8), (200.0, 190.0, 20.0)),
        totals={"longest_line_s": 0.24, "peak_flow_g_min": {"A": 8.0, "B": 13.0},
                "peak_power_W": 1800.0},
        verdict=(),
    )


PROCESS = ProcessSettings()


@dataclass(frozen=True)
class FakePart:
    low_mm: tuple = (-20.0, -20.0, -3.0)
    high_mm: tuple = (20.0, 20.0, 7.0)
    name: str = "disc"
    materials: tuple = (MaterialSpec("316L", 0.008, None, 0.7, 1500.0, 10.0, ()),)
    process: ProcessSettings = PROCESS
    placement_mm: tuple | None = None
    substrate_surface: None = None
    layer_stack: None = None
    copies: tuple = ()
    alloy_rules: None = None

    @property
    def bounds_mm(self):
        return np.array(self.low_mm), np.array(self.high_mm)


@pytest.fixture
def part():
    return FakePart()
