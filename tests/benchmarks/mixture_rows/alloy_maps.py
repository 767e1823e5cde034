"""Random maps of forbidden mixtures, as part files state them and as an independent judge.

The judge knows nothing of lmctl: intervals are compared, polygons are crossed by rays, cells are
looked up by the nearest mixture of the map.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.benchmarks.mixture_rows.alloy_cell import materials_text

#: A mixture that a part names lies at least so far from what is forbidden.
_APART = 0.06
#: Steps of a map file from one pure powder to another.
_MAP_STEPS = 20


@dataclass(frozen=True)
class RandomMap:
    """powders : of the part; rule : its TOML without name, way and reason
    is_forbidden : (n, m) mixtures -> (n,) bool
    ends : two allowed mixtures whose blend crosses the region
    """

    powders: tuple[str, ...]
    rule: str
    is_forbidden: Callable[[np.ndarray], np.ndarray]
    ends: tuple[np.ndarray, np.ndarray]


def random_map(number: int, folder: Path) -> RandomMap:
    """One of many maps, always the same: intervals, polygons and map files in turn."""
    rng = np.random.default_rng(1000 + number)
    while True:
        kind = ("intervals", "polygon", "cells", "intervals of four")[number % 4]
        powders = ("Fe", "V", "Ti", "Ni") if kind == "intervals of four" else ("Fe", "V", "Ti")
        rule, judge = {"polygon": _polygon, "cells": _cells}.get(kind, _intervals)(
            rng, powders, folder)
        ends = _ends(rng, judge, len(powders))
        if ends is not None:
            return RandomMap(powders, rule, judge, ends)


def part_text(found: RandomMap, way: str, strategy: str) -> str:
    """A part that blends between the two ends under the rule."""
    near, far = (", ".join(f'"{name}" = {share:.4f}' for name, share in zip(
        found.powders, end, strict=True)) for end in found.ends)
    return f"""
name = "blend under a rule"
{materials_text(found.powders)}
[[body]]
kind = "box"
low_mm = [0, 0, 0]
high_mm = [48, 14, 3.2]
[composition]
feature = {{ kind = "coordinate", along = "x" }}
profile = {{ kind = "linear", near = {{ {near} }}, far = {{ {far} }}, over_mm = [4, 44] }}
[process]
strategy = "{strategy}"
bead_width_mm = 2.0
layer_height_mm = 0.8
speed_mm_s = 10
[[alloy_rule]]
name = "random"
way = "{way}"
reason = "a random map says so"
{found.rule}
"""


def _ends(rng, judge, m):
    """Two mixtures in steps of 0.02, well apart from the region, whose blend crosses it."""
    for _ in range(400):
        ends = np.round(rng.dirichlet(np.full(m, 0.6), size=2) * 50) / 50
        ends[:, 0] += 1 - ends.sum(axis=1)
        if (ends < 0).any() or np.linalg.norm(ends[0] - ends[1]) < 0.5:
            continue
        share = np.linspace(0, 1, 201)[:, None]
        inside = judge(ends[0] + share * (ends[1] - ends[0]))
        if inside.mean() > 0.1 and not _near(judge, ends).any():
            return ends[0], ends[1]
    return None


def _near(judge, mixtures):
    found = judge(mixtures)
    for step in itertools.product((-1, 0, 1), repeat=mixtures.shape[1]):
        if sum(step) == 0:
            found |= judge(mixtures + _APART * np.array(step))
    return found


def _intervals(rng, powders, folder):
    a, b = rng.choice(len(powders), 2, replace=False)
    low = rng.uniform(0.12, 0.3, 2)
    high = low + rng.uniform(0.15, 0.5, 2)
    rule = (f'powders = ["{powders[a]}", "{powders[b]}"]\nforbidden = [{{ "{powders[a]}" = '
            f'[{low[0]:.3f}, {high[0]:.3f}], "{powders[b]}" = [{low[1]:.3f}, {high[1]:.3f}] }}]\n')
    low, high = low.round(3), high.round(3)

    def judge(x):
        x = np.atleast_2d(x)
        return ((x[:, a] >= low[0]) & (x[:, a] <= high[0])
                & (x[:, b] >= low[1]) & (x[:, b] <= high[1]))
    return rule, judge


def _polygon(rng, powders, folder):
    middle = rng.dirichlet(np.full(3, 6.0))
    turn = np.sort(rng.uniform(0, 2 * np.pi, 7))
    radius = rng.uniform(0.06, 0.22, 7)
    across = np.array([[1, -1, 0], [1, 1, -2]]) / np.sqrt([[2], [6]])
    corners = np.column_stack([radius * np.cos(turn), radius * np.sin(turn)]) @ across + middle
    corners = np.clip(corners, 0.0, None)
    corners = (corners / corners.sum(axis=1, keepdims=True)).round(4)
    corners[:, 2] = 1 - corners[:, 0] - corners[:, 1]
    listed = ", ".join("{ " + ", ".join(
        f'"{name}" = {max(share, 0):.4f}' for name, share in zip(powders, corner, strict=True))
        + " }" for corner in corners)
    rule = f"powders = {list(powders)!r}\npolygon = [{listed}]\n".replace("'", '"')

    def judge(x):
        """Even-odd rays in the plane of the first two fractions."""
        x = np.atleast_2d(x)
        inside = np.zeros(len(x), bool)
        for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            spans = (p[1] > x[:, 1]) != (q[1] > x[:, 1])
            with np.errstate(divide="ignore", invalid="ignore"):
                at = p[0] + (x[:, 1] - p[1]) / (q[1] - p[1]) * (q[0] - p[0])
            inside ^= spans & (x[:, 0] < at)
        return inside
    return rule, judge


def _cells(rng, powders, folder):
    steps = _MAP_STEPS
    grid = np.array([c for c in itertools.product(range(steps + 1), repeat=3) if sum(c) == steps])
    middles = rng.dirichlet(np.full(3, 3.0), size=2)
    radius = rng.uniform(0.08, 0.18, 2)
    flags = (np.linalg.norm(grid[:, None] / steps - middles[None], axis=2) < radius).any(axis=1)
    lines = [",".join((*powders, "forbidden"))]
    lines += [",".join([*(f"{value / steps:.3f}" for value in cell), str(int(flag))])
              for cell, flag in zip(grid, flags, strict=True)]
    (folder / "map.csv").write_text("\n".join(lines) + "\n")
    table = {tuple(cell): flag for cell, flag in zip(grid.tolist(), flags.tolist(), strict=True)}

    def judge(x):
        """The cell of the nearest mixture of the map: its nearest, in steps, by trying all near."""
        scaled = np.clip(np.atleast_2d(x), 0, 1) * steps
        floor = np.floor(scaled).astype(int)
        best = np.full(len(scaled), np.inf)
        found = np.zeros(len(scaled), bool)
        for step in itertools.product((0, 1), repeat=3):
            cell = floor + np.array(step)
            off = ((cell - scaled) ** 2).sum(axis=1)
            whole = cell.sum(axis=1) == steps
            hit = np.array([table.get(tuple(c), False) for c in cell.tolist()])
            better = whole & (off < best)
            best, found = np.where(better, off, best), np.where(better, hit, found)
        return found
    return f"powders = {list(powders)!r}\nmap_file = 'map.csv'\n".replace("'", '"'), judge
