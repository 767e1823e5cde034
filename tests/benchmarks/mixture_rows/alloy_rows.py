"""Rows about alloy rules: forbidden mixtures laid, and the length of ways round.

`forbidden_points`: 20 parts under random rules are planned. Their jobs run against the bench and
are judged by the simulators' own record. `forbidden_predicted`: for the same jobs the nozzle's
mixture is computed here from the job's wanted flow with each hopper's lag and limits, in steps of
4 ms, without the planner's model of hoses. Every point with the beam on counts, beginnings of
beads included.

`detour`: the longest of some ways over the known shortest: tangents to a disc on both sides of its
middle, a polygon by a visibility graph, and an edge between two intervals of four powders.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from lmctl.cli.bench import replace_endpoints
from lmctl.config.alloy_rules import AlloyRuleSettings
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind
from lmctl.part.load import load_part
from lmctl.part.materials.allowed_mixtures import AllowedMixtures
from lmctl.part.materials.alloy_rules import alloy_rules_of
from lmctl.part.materials.ways_round import shortest_way, way_length
from lmctl.plan.planner import plan_job
from lmctl.run.executor import run_job
from simulators import virtual_time
from simulators.bench import Bench
from tests.benchmarks.mixture_rows.alloy_cell import POWDERS, alloy_bench, alloy_profile
from tests.benchmarks.mixture_rows.alloy_maps import part_text, random_map

MAPS = 20
_WAYS = ("auto", "jump")
_STRATEGIES = ("offset", "iso-composition")
#: Between judged points: with these steps 20 maps have more than a million of them.
_STEP_S, _STEP_MM = 0.004, 0.035
#: Of a disc as a polygon.
_CORNERS = 256


def forbidden_points(maps: range = range(MAPS)) -> dict[str, Any]:
    """Points laid inside forbidden regions, of how many; how many maps led around and jumped."""
    inside = points = predicted = predicted_of = 0
    ways = {"around": 0, "jump": 0}
    for number in maps:
        with tempfile.TemporaryDirectory() as folder:
            found = random_map(number, Path(folder))
            file = Path(folder) / "part.toml"
            file.write_text(part_text(found, _WAYS[number // 4 % 2], _STRATEGIES[number // 2 % 2]))
            job = file.with_suffix(".lmj")
            manifest = plan_job(load_part(file), alloy_profile(), job)
            for rule in manifest.totals["alloy_rules"]:
                for blend in rule["blends"]:
                    ways[blend["way"]] += 1
            laid = _laid_on_bench(job, found.powders)
            inside, points = inside + int(found.is_forbidden(laid).sum()), points + len(laid)
            laid = laid_by_job(job)
            predicted += int(found.is_forbidden(laid).sum())
            predicted_of += len(laid)
    return {"forbidden_points": inside, "forbidden_of": points,
            "forbidden_predicted": predicted, "forbidden_predicted_of": predicted_of,
            "forbidden_around": ways["around"], "forbidden_jumps": ways["jump"]}


def _laid_on_bench(job: Path, powders: tuple[str, ...]) -> np.ndarray:
    """Mixtures at the nozzle along the path with the beam on, (n, m), by the bench's record."""
    async def whole() -> Bench:
        with tempfile.TemporaryDirectory() as runs:
            async with Bench(alloy_bench(), ephemeral_ports=True) as bench:
                await run_job(job, replace_endpoints(alloy_profile(), bench.endpoints), Path(runs))
            return bench

    path = virtual_time.run_in_virtual_time(whole()).record.beam_on_path(_STEP_MM)
    columns = [path.materials.index(name) for name in powders]
    laid = path.fractions[:, columns]
    assert np.isfinite(laid).all()
    return laid


def laid_by_job(job: Path) -> np.ndarray:
    """The same computed from the job's wanted flow, without the planner's model of hoses."""
    with JobReader(job) as reader:
        manifest, layers = reader.manifest, list(reader.iterate_layers())
    by_name = {name: (density / 1000, catch) for name, density, catch, *_ in POWDERS}
    volume = np.array([by_name[h.material][1] / by_name[h.material][0] for h in manifest.hoppers])
    lag = np.array([h.lag_s for h in manifest.hoppers])
    most = np.array([h.max_flow_g_min for h in manifest.hoppers]) / 60
    knots_s = np.concatenate([layer.flow_s for layer in layers])
    knots = np.concatenate([layer.flow_g_s for layer in layers])
    knots_s, first = np.unique(knots_s, return_index=True)
    knots = knots[first]
    time_s = np.arange(knots_s[0], knots_s[-1], _STEP_S)
    middle_s = time_s + _STEP_S / 2
    wanted = np.column_stack([np.interp(middle_s, knots_s, column) for column in knots.T])
    piece = np.clip(np.searchsorted(knots_s, middle_s, side="right") - 1, 0, len(knots_s) - 2)
    slope = np.diff(knots, axis=0) / np.diff(knots_s)[:, None]
    setpoint = np.clip(wanted + lag * slope[piece], 0, most)
    keep = np.exp(-_STEP_S / lag)
    flow, now = np.empty_like(setpoint), knots[0].copy()
    for k in range(len(setpoint)):
        now = setpoint[k] + (now - setpoint[k]) * keep
        flow[k] = now
    lines = np.concatenate([layer.lines for layer in layers])
    line = np.searchsorted(lines["end_s"], time_s + _STEP_S, side="left")
    beads = lines["kind"][np.minimum(line, len(lines) - 1)] == LineKind.BEAD
    deposit = flow[beads] * volume
    return deposit / deposit.sum(axis=1, keepdims=True)


def detour() -> dict[str, Any]:
    """The longest way round over the known shortest, and which."""
    found = {**_discs(), "polygon": _polygon(), "four powders": _edge_of_intervals()}
    return {"detour": round(max(found.values()), 5),
            "detour_of": {name: round(ratio, 5) for name, ratio in found.items()}}


_PLANE = np.array([[1, -1, 0], [1, 1, -2]]) / np.sqrt([[2.0], [6.0]])
_MIDDLE = np.full(3, 1 / 3)


def _way(rule: dict[str, Any], start: np.ndarray, end: np.ndarray) -> float:
    names = tuple("ABCD"[: len(start)])
    settings = AlloyRuleSettings.model_validate(
        {"name": "synthetic", "reason": "a test", "margin": 0.0, **rule})
    rules = alloy_rules_of([(settings, None)], names, np.eye(len(names)))
    assert rules is not None
    way = shortest_way(start, end, AllowedMixtures(rules, 0.0), np.ones(len(names), bool))
    assert way is not None
    return way_length(way)


def _polygon_rule(corners: np.ndarray) -> dict[str, Any]:
    return {"powders": tuple("ABC"), "polygon": tuple(
        dict(zip("ABC", map(float, _MIDDLE + corner @ _PLANE), strict=True))
        for corner in corners)}


def _discs() -> dict[str, float]:
    """A disc of radius r in the way, its middle beside the straight line by some of r: two
    tangents and the arc between them, on the shorter side."""
    turn = np.linspace(0, 2 * np.pi, _CORNERS, endpoint=False)
    found = {}
    for radius, beside in ((0.12, 0.0), (0.12, 0.4), (0.16, 0.2), (0.05, 0.7)):
        middle = np.array([0.0, -beside * radius])
        disc = middle + radius * np.column_stack([np.cos(turn), np.sin(turn)])
        ends = np.array([[-0.3, 0.0], [0.3, 0.0]])
        arms = ends - middle
        reach = np.linalg.norm(arms, axis=1)
        arc = 2 * np.arctan2(abs(arms[0, 0]), arms[0, 1]) - np.arccos(radius / reach).sum()
        known = np.sqrt(reach**2 - radius**2).sum() + radius * arc
        length = _way(_polygon_rule(disc), *(_MIDDLE + ends @ _PLANE))
        found[f"disc {radius:g} beside {beside:g}"] = length / known
    return found


def _polygon() -> float:
    """A star in the way: the shortest of the ways over corners that see each other."""
    from shapely import LineString, Polygon

    turn = np.linspace(0, 2 * np.pi, 10, endpoint=False) + 0.2
    radius = np.where(np.arange(10) % 2, 0.08, 0.2)
    star = np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])
    ends = np.array([[-0.3, 0.02], [0.3, -0.02]])
    places = np.concatenate([ends[:1], star, ends[1:]])
    shape = Polygon(star).buffer(-1e-9)
    n = len(places)
    best = np.full(n, np.inf)
    best[0] = 0.0
    clear = np.array([[not shape.intersects(LineString([p, q])) for q in places] for p in places])
    length = np.linalg.norm(places[:, None] - places[None], axis=2)
    for _ in range(n):
        best = np.minimum(best, np.where(clear, best[:, None] + length, np.inf).min(axis=0))
    return _way(_polygon_rule(star), *(_MIDDLE + ends @ _PLANE)) / float(best[-1])


def _edge_of_intervals() -> float:
    """A and B both from 0.2: the way touches A = B = 0.2 once, at the best share of C and D."""
    rule = {"powders": tuple("ABCD"), "forbidden": ({"A": (0.2, 1.0), "B": (0.2, 1.0)},)}
    start, end = np.array([0.75, 0.1, 0.15, 0.0]), np.array([0.1, 0.7, 0.0, 0.2])
    shares = np.linspace(0, 0.6, 60_001)
    edge = np.column_stack([np.full_like(shares, 0.2), np.full_like(shares, 0.2), shares,
                            0.6 - shares])
    known = (np.linalg.norm(edge - start, axis=1) + np.linalg.norm(edge - end, axis=1)).min()
    return _way(rule, start, end) / float(known)

