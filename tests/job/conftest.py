"""A small job of three layers, made without the planner."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lmctl.job.manifest_json import part_digest
from lmctl.job.schema import JobHopper, JobLayer, JobManifest, LineKind, line_dtype
from lmctl.job.writer import JobWriter

PART_TEXT = 'name = "disc"\n# größer\n'


def make_layer(index: int, n_lines: int = 6) -> JobLayer:
    lines = np.zeros(n_lines, line_dtype(2))
    first = index * n_lines
    lines["end_s"] = index * 10.0 + np.linspace(1, 10, n_lines)
    lines["x_mm"] = np.arange(n_lines)
    lines["z_mm"] = 0.5 * (index + 1)
    lines["speed_mm_s"] = 10
    lines["kind"] = LineKind.BEAD
    lines["kind"][0] = LineKind.TRAVEL
    lines["power_W"][1:] = 1500
    lines["path"] = index
    lines["path"][0] = -1
    lines["fractions"] = (0.5, 0.5)
    program = tuple(
        f"N{first + i} G1 X{i}.000 Y0.000 F600 S{0 if i == 0 else 500}" for i in range(n_lines)
    )
    return JobLayer(
        index=index, z_mm=0.5 * (index + 1), first_line=first, program=program, lines=lines,
        flow_s=np.array([index * 10.0, index * 10 + 4.0, index * 10 + 10.0]),
        flow_g_s=np.array([[0.1, 0.2], [0.2, 0.1], [0.1, 0.2]]),
    )


def make_manifest() -> JobManifest:
    hopper = JobHopper("A", "316L", 3.0, 1.0, 60.0)
    return JobManifest(
        part_name="disc", part_sha256=part_digest(PART_TEXT), sources={"disc.stl": "ab" * 32},
        machine="bench", profile_digest="cd" * 32, software="lmctl 0.1.0", powder_mode="lead",
        s_max=1000, max_power_W=3000.0, send_horizon_s=1.0, materials=("316L", "WC-12Co"),
        hoppers=(hopper, JobHopper("B", "WC-12Co", 2.6, 0.8, 60.0)),
        bounds_mm=((0.0, 0.0, 0.0), (6.0, 0.0, 1.5)), totals={"layers": 3, "warnings": []},
        verdict=({"level": "ok", "text": "coverage 99.8 %"},),
    )


def write_job(path: Path, n_layers: int = 3) -> JobManifest:
    with JobWriter(path) as job:
        for index in range(n_layers):
            job.add_layer(make_layer(index))
        return job.finish(make_manifest(), PART_TEXT)


@pytest.fixture
def layer():
    return make_layer


@pytest.fixture
def manifest():
    return make_manifest


@pytest.fixture
def part_text():
    return PART_TEXT


@pytest.fixture
def write():
    return write_job


@pytest.fixture
def job_path(tmp_path: Path) -> Path:
    path = tmp_path / "disc.lmj"
    write_job(path)
    return path
