"""Gradients against central differences, and the cutter's exponent against a scan."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import numpy as np

from lmctl.config.machine import load_profile
from lmctl.design.design_problem import DesignProblem
from lmctl.design.optimiser import read_state, search
from lmctl.part.load import load_measured_part

#: Fourth-order central differences, as a share of a number's range.
STEP = 2e-3

SCANNED = 200


def problem_of(folder: Path, example: str, *changes: tuple[str, str]) -> DesignProblem:
    """The problem that an example states. changes : (old, new) in its text"""
    examples = files("lmctl.examples")
    text = (examples / example).read_text()
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    path = folder / example
    path.write_text(text)
    (folder / "cell.toml").write_text((examples / "cell.toml").read_text())
    return DesignProblem(load_measured_part(path), path, load_profile(folder / "cell.toml"))


def gradient_error(folder: Path, designs: int = 20) -> float:
    """Largest difference over the gradient's size, of random designs of gear and cylinder."""
    rng, worst = np.random.default_rng(7), 0.0
    problems = [
        problem_of(folder, "gear-service.toml", ("mesh_mm = 1.5", "mesh_mm = 4"),
                   ("norm = 16", "norm = 8")),
        problem_of(folder, "pressed-cylinder.toml", ("mesh_mm = 4", "mesh_mm = 16"),
                   ("free_levels = 13", "free_levels = 6"))]
    for number in range(designs):
        problem = problems[number % 2]
        n = len(problem.design.numbers)
        x = 0.1 + 0.8 * rng.random(n)
        found = problem.evaluate(x).gradient
        expected = np.empty(n)
        for k in range(n):
            ends = [problem.evaluate(x + s * STEP * np.eye(n)[k]).objective
                    for s in (-2, -1, 1, 2)]
            expected[k] = (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * STEP)
        worst = max(worst, float(np.abs(found - expected).max() / np.abs(expected).max()))
    return worst


def cutter_k(folder: Path) -> dict[str, float]:
    """The best k, that of a parabola through the best three of a scan, and their difference."""
    problem = problem_of(folder, "cutter-service.toml")
    kept = folder / "search.json"
    text = problem.measured.part.text
    best = search(problem, read_state(kept, text), kept, lambda done, total, note: None)
    k = problem.design.values(best)["k"]
    scan = np.linspace(0.75 * k, 1.25 * k, SCANNED)
    values = np.array([problem.value(problem.design.design_of({"k": float(one)}))
                       for one in scan])
    middle = int(np.clip(values.argmin(), 1, SCANNED - 2))
    a, b, _ = np.polyfit(scan[middle - 1 : middle + 2] - k, values[middle - 1 : middle + 2], 2)
    scanned = k - b / (2 * a)
    return {"cutter_k": k, "cutter_k_scanned": scanned, "cutter_k_error": abs(k - scanned)}
