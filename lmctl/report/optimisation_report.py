"""The report of an optimisation: numbers and extremes before and after, limits, pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from lmctl.array_types import FloatArray
from lmctl.design.deposition_limits import CHECK_PLACES, LayingCheck, LayingConstraints
from lmctl.design.design_problem import DesignProblem
from lmctl.design.optimiser import SearchState
from lmctl.design.recovery import recover_fields
from lmctl.design.simulation_report import extremes
from lmctl.report.simulation_pictures import draw_simulation

_EXTREMES = ("von-mises", "tresca", "largest-principal", "utilisation", "temperature",
             "displacement")


def simulated_design(
    problem: DesignProblem, design: FloatArray, title: str, picture: Path | None
) -> dict[str, Any]:
    """Extremes of one design as plain data, and its picture. Raises OSError."""
    solution = problem.solve(design)
    fields = recover_fields(problem.model, solution,
                            lambda points: problem.design.fractions(design, points))
    if picture is not None:
        draw_simulation(problem.model, fields, picture, title)
    return extremes(problem.model, solution, fields)


def laying_check(problem: DesignProblem, design: FloatArray) -> LayingCheck | None:
    """What the cell cannot deposit of a design, asked at many places."""
    if problem.laying is None:
        return None
    return LayingConstraints(problem.measured.part, problem.design, problem.limits,
                             problem.settings.forbidden, CHECK_PLACES).check(design)


def write_report(
    problem: DesignProblem, state: SearchState, best: FloatArray, folder: Path
) -> dict[str, Any]:
    """Write report.md with before.png, after.png and search.png; returns what it says, as data.

    Raises OSError where the folder cannot be written to.
    """
    name = problem.measured.part.name
    before = simulated_design(problem, problem.design.start, f"{name}, before",
                              folder / "before.png")
    after = simulated_design(problem, best, f"{name}, after", folder / "after.png")
    _draw_search(state, problem.settings.minimise, folder / "search.png")
    values = problem.design.values(best)
    check = laying_check(problem, best)
    data = {
        "minimised": problem.settings.minimise, "steps": len(state.history),
        "objective_before": state.history[0][1], "objective_after": state.best_objective,
        "numbers": values, "before": before, "after": after,
        "laying": None if check is None else check.__dict__,
    }
    (folder / "report.md").write_text(
        "\n".join(_lines(problem, data, best, check)) + "\n", encoding="utf-8")
    return data


def _lines(
    problem: DesignProblem, data: dict[str, Any], best: FloatArray, check: LayingCheck | None
) -> list[str]:
    starts = problem.design.values(problem.design.start)
    found = problem.evaluate(best)
    lines = [
        f"# {problem.measured.part.name}: materials chosen by simulation", "",
        f"Least {data['minimised']}, {data['steps']} steps, {data['after']['unknowns']:,} "
        f"unknowns, estimated error {data['after']['relative_error']:.2%} in energy.", "",
        "All values are predicted by the simulation; nothing of them is measured.", "",
        "| number | before | after | bounds |", "| --- | --- | --- | --- |",
        *(f"| {n.name} | {starts[n.name]:.5g} | {data['numbers'][n.name]:.5g} | "
          f"{n.low:g} … {n.high:g} |" for n in problem.design.numbers), "",
        "| largest | before | after | estimated error | at (x, y, z) mm |",
        "| --- | --- | --- | --- | --- |"]
    for key in _EXTREMES:
        old, new = (data[when]["extremes"][key] for when in ("before", "after"))
        place = ", ".join(f"{v:.2f}" for v in new["largest"]["at_mm"])
        error = f"{new['largest']['error']:.2g}" if "error" in new["largest"] else ""
        lines.append(f"| {key} [{new['unit']}] | {old['largest']['value']:.5g} | "
                     f"{new['largest']['value']:.5g} | {error} | {place} |")
    lines.append(f"| mass [g] | {data['before']['mass_g']:.5g} | {data['after']['mass_g']:.5g} "
                 "| | |")
    if problem.names:
        worst: dict[str, float] = {}
        for name, value in zip(problem.names, found.constraints, strict=True):
            worst[name] = max(worst.get(name, -np.inf), float(value))
        lines += ["", "| limit | room left, as a share of it |", "| --- | --- |",
                  *(f"| {name} | {-value:.2%} |" for name, value in worst.items())]
    if check is not None:
        lines += ["", f"Of {check.places} places asked, {check.over_gradient} have a gradient that "
                  f"the cell cannot lay; the largest is {check.largest_along:.2f} of the limit "
                  f"along tracks and {check.largest_across:.2f} across. "
                  f"{check.under_flow_share:.1%} of the part is of mixtures below a hopper's least "
                  f"flow, {check.forbidden_share:.1%} of forbidden ones."]
    return [*lines, "", "![before](before.png)", "", "![after](after.png)", "",
            "![search](search.png)"]


def _draw_search(state: SearchState, name: str, target: Path) -> None:
    figure = Figure(figsize=(6, 3.2), dpi=110, layout="constrained")
    axes = figure.subplots()
    for start in sorted({row[0] for row in state.history}):
        values = [row[1] for row in state.history if row[0] == start]
        axes.plot(values, marker=".", label=f"start {start + 1}")
    axes.set_xlabel("step")
    axes.set_ylabel(f"objective: {name}")
    axes.legend(fontsize=8)
    figure.savefig(target)
