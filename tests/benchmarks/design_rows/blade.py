"""The blade at 200,000 unknowns: one solution, a whole optimisation of six numbers, peak memory.

Run as a process of its own, so that the memory is that of the blade alone:

    python -m tests.benchmarks.design_rows.blade
"""

from __future__ import annotations

import json
import resource
import tempfile
import time
from importlib.resources import files
from pathlib import Path

from lmctl.config.machine import load_profile
from lmctl.design.design_problem import DesignProblem
from lmctl.design.optimiser import read_state, search
from lmctl.part.load import load_measured_part

#: Edge length at which temperature and displacement have about 200,000 unknowns together.
MESH_MM = 1.19


def main() -> None:
    examples = files("lmctl.examples")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        text = (examples / "blade-service.toml").read_text().replace(
            "mesh_mm = 2\n", f"mesh_mm = {MESH_MM}\n")
        (folder / "blade.toml").write_text(text)
        (folder / "cell.toml").write_text((examples / "cell.toml").read_text())
        measured = load_measured_part(folder / "blade.toml")
        begun = time.monotonic()
        problem = DesignProblem(measured, folder / "blade.toml",
                                load_profile(folder / "cell.toml"))
        built_s = time.monotonic() - begun
        model = problem.model
        model.forget_guesses()
        begun = time.monotonic()
        problem.solve(problem.design.start)
        solve_s = time.monotonic() - begun
        state = read_state(folder / "search.json", text)
        search(problem, state, folder / "search.json", lambda done, total, note: None)
        spent_s = time.monotonic() - begun - solve_s + built_s
        d = model.discretisation
        print(json.dumps({
            "blade_unknowns": 4 * d.n_nodes, "blade_free_numbers": len(problem.design.numbers),
            "blade_solve_s": round(solve_s, 2), "blade_optimise_s": round(spent_s, 1),
            "blade_steps": len(state.history),
            "blade_objective": [state.history[0][1], state.best_objective],
            "peak_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)}))


if __name__ == "__main__":
    main()
