"""The pressed cylinder: one material, the best power, free levels, and what a run built of them."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np

from lmctl.config.free_numbers_text import text_with_values
from lmctl.config.machine import load_profile
from lmctl.design.deposition_limits import CHECK_PLACES, LayingConstraints
from lmctl.design.design_problem import DesignProblem
from lmctl.design.effective_properties import MixingRules
from lmctl.design.optimiser import read_state, search
from lmctl.design.recovery import recover_fields
from lmctl.part.load import load_measured_part
from tests.design.closed_forms import (
    BETA,
    SOFT_AND_HARD,
    largest_hoop,
    power_composition,
    pressed_ring,
    pure,
    solved,
)

PRESSURE_MPA = 100.0


def known_cylinders(mesh_mm: float) -> dict[str, float]:
    """Largest hoop stress over the pressure of one material, and of E ∝ r^1.274."""
    found = {}
    for key, composition in (("cylinder_uniform_p", pure),
                             ("cylinder_power_p", power_composition(BETA))):
        of = solved(pressed_ring(mesh_mm), composition, SOFT_AND_HARD, MixingRules("voigt"))
        found[key] = largest_hoop(of.fields.stress_MPa, of.model.discretisation.nodes_mm)
    return found


@dataclass(frozen=True)
class Optimum:
    """values : by name; text : of the part file with them"""

    problem: DesignProblem
    design: np.ndarray
    text: str


def optimum(folder: Path, mesh_mm: float, *changes: tuple[str, str]) -> Optimum:
    """The pressed cylinder's best levels. changes : (old, new) in the example's text"""
    examples = files("lmctl.examples")
    text = (examples / "pressed-cylinder.toml").read_text().replace(
        "mesh_mm = 4", f"mesh_mm = {mesh_mm}")
    for old, new in (('minimise = "largest-principal"',
                      'minimise = "largest-principal"\nnorm = 60\nstarts = 1'), *changes):
        assert old in text, old
        text = text.replace(old, new)
    path = folder / "cylinder.toml"
    path.write_text(text)
    (folder / "cell.toml").write_text((examples / "cell.toml").read_text())
    problem = DesignProblem(load_measured_part(path), path, load_profile(folder / "cell.toml"))
    kept = folder / "search.json"
    kept.unlink(missing_ok=True)
    best = search(problem, read_state(kept, text), kept, lambda done, total, note: None)
    return Optimum(problem, best, text_with_values(text, "cylinder", problem.design.values(best)))


def hoop_over_pressure(of: Optimum) -> float:
    """The largest hoop stress at the nodes, over the pressure."""
    solution = of.problem.solve(of.design)
    fields = recover_fields(of.problem.model, solution,
                            lambda p: of.problem.design.fractions(of.design, p))
    nodes = of.problem.model.discretisation.nodes_mm
    return largest_hoop(fields.stress_MPa, nodes) / PRESSURE_MPA


def over_gradient(folder: Path) -> dict[str, float]:
    """Places beyond a gradient limit that binds: carbide may rise by 0.0165 a millimetre."""
    of = optimum(folder, 8.0, ("[optimise]\n", "[optimise]\nrate_per_s = 0.0968\n"))
    check = LayingConstraints(of.problem.measured.part, of.problem.design, of.problem.limits, (),
                              CHECK_PLACES).check(of.design)
    return {"over_gradient_limit": check.over_gradient, "over_gradient_places": check.places,
            "over_gradient_largest": max(check.largest_across, check.largest_along)}
