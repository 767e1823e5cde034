"""The report of an optimisation: numbers and extremes before and after, limits, pictures."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
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

_STYLE = ("body{font:15px sans-serif;margin:2em;max-width:70em}td,th{padding:.2em .8em;"
          "text-align:left;border-bottom:1px solid #ccc}table{margin:1em 0;border-collapse:"
          "collapse}img{max-width:100%}")


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
    """Write report.html with before.png, after.png and search.png; returns what it says, as data.

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
    (folder / "report.html").write_text(_page(problem, data, best, check), encoding="utf-8")
    return data


def _page(
    problem: DesignProblem, data: dict[str, Any], best: FloatArray, check: LayingCheck | None
) -> str:
    starts, name = problem.design.values(problem.design.start), problem.measured.part.name
    parts = [
        f"<h1>{escape(name)}: materials chosen by simulation</h1>",
        f"<p>Least {data['minimised']}, {data['steps']} steps, {data['after']['unknowns']:,} "
        f"unknowns, estimated error {data['after']['relative_error']:.2%} in energy. All values "
        "are predicted by the simulation; nothing of them is measured.</p>",
        _table(("number", "before", "after", "bounds"),
               [(n.name, f"{starts[n.name]:.5g}", f"{data['numbers'][n.name]:.5g}",
                 f"{n.low:g} … {n.high:g}") for n in problem.design.numbers]),
        _table(("largest", "before", "after", "estimated error", "at (x, y, z) mm"),
               [*(_extreme_row(data, key) for key in _EXTREMES),
                ("mass [g]", f"{data['before']['mass_g']:.5g}", f"{data['after']['mass_g']:.5g}",
                 "", "")])]
    worst: dict[str, float] = {}
    for limit, value in zip(problem.names, problem.evaluate(best).constraints, strict=True):
        worst[limit] = max(worst.get(limit, -np.inf), float(value))
    if worst:
        parts.append(_table(("limit", "room left, as a share of it"),
                            [(limit, f"{-value:.2%}") for limit, value in worst.items()]))
    if check is not None:
        parts.append(
            f"<p>Of {check.places} places asked, {check.over_gradient} have a gradient that the "
            f"cell cannot lay; the largest is {check.largest_along:.2f} of the limit along tracks "
            f"and {check.largest_across:.2f} across. {check.under_flow_share:.1%} of the part is "
            f"of mixtures below a hopper's least flow, {check.forbidden_share:.1%} of forbidden "
            "ones.</p>")
    parts += [f'<h2>{picture}</h2><img src="{picture}.png" alt="{picture}">'
              for picture in ("before", "after", "search")]
    return (f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(name)}'
            f"</title><style>{_STYLE}</style></head><body>{''.join(parts)}</body></html>\n")


def _extreme_row(data: dict[str, Any], key: str) -> tuple[str, ...]:
    old, new = (data[when]["extremes"][key] for when in ("before", "after"))
    most = new["largest"]
    return (f"{key} [{new['unit']}]", f"{old['largest']['value']:.5g}", f"{most['value']:.5g}",
            f"{most['error']:.2g}" if "error" in most else "",
            ", ".join(f"{v:.2f}" for v in most["at_mm"]))


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    cells = "".join(
        f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><tr>{''.join(f'<th>{escape(cell)}</th>' for cell in head)}</tr>{cells}</table>"


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
