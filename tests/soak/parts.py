"""The kinds of random part, by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.soak.road import Outcome, down_the_road
from tests.soak.scans import random_cloud_part, random_mesh_part
from tests.soak.solids import random_part

PARTS = ("solids", "meshes", "clouds")


def random_part_down_the_road(kind: str, seed: int, folder: Path) -> Outcome:
    """One part of a kind; the same one for the same seed."""
    rng = np.random.default_rng([seed, PARTS.index(kind)])
    if kind == "solids":
        text, bound = random_part(rng)
        return down_the_road(text, bound, folder, rng)
    make = random_mesh_part if kind == "meshes" else random_cloud_part
    text, bound, unsure_mm = make(rng, folder)
    return down_the_road(text, bound, folder, rng, unsure_mm)
