"""Search a design by sequential quadratic programming, from several starts, with a kept state.

scipy's SLSQP takes gradients and constraints. What has been evaluated is written after every step,
so that an interrupted search goes on from its best design.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from lmctl.array_types import FloatArray
from lmctl.design.design_problem import DesignEvaluation, DesignProblem
from lmctl.errors import InputError

#: A constraint that is met to this share of its limit is met.
FEASIBLE = 1e-3

#: Relative change of the objective at which a search ends.
_TOLERANCE = 1e-9


@dataclass
class SearchState:
    """What is known of a search; kept in a file.

    digest : of the part file's text; start, step : where it is
    best_design, best_objective : of all starts, feasible; None before the first
    current : the design the present start has reached; history : (start, objective, worst limit)
    """

    digest: str
    start: int = 0
    step: int = 0
    best_design: list[float] | None = None
    best_objective: float | None = None
    best_violation: float = np.inf
    current: list[float] | None = None
    history: list[tuple[int, float, float]] = field(default_factory=list)

    def write(self, path: Path) -> None:
        """Write the state, whole or not at all."""
        partial = path.with_name(f".{path.name}.partial")
        partial.write_text(json.dumps(asdict(self)) + "\n", encoding="utf-8")
        partial.replace(path)


#: Called after every step with steps done, most steps there may be, and a note.
Progress = Callable[[int, int, str], None]


def read_state(path: Path, text: str) -> SearchState:
    """The state of an earlier search of the same part file, or a new one.

    Raises InputError where the file is no state.
    """
    digest = hashlib.sha256(text.encode()).hexdigest()
    try:
        data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        state = SearchState(**data)
        state.history = [(int(a), float(b), float(c)) for a, b, c in state.history]
    except FileNotFoundError:
        return SearchState(digest)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"{path} is no state of a search", where=str(error)[:120],
                         hint="remove it to begin anew") from None
    return state if state.digest == digest else SearchState(digest)


def search(
    problem: DesignProblem, state: SearchState, path: Path, progress: Progress
) -> FloatArray:
    """The best design found. Raises InputError where none meets the limits.

    state : of `read_state`, goes on from it; path : where it is kept
    """
    settings = problem.settings
    total = settings.starts * settings.iterations
    while state.start < settings.starts:
        first = (np.array(state.current) if state.current is not None
                 else _starting_design(problem, state.start))
        _run_start(problem, state, first, path, lambda note: progress(
            min(state.start * settings.iterations + state.step, total), total, note))
        state.start, state.step, state.current = state.start + 1, 0, None
        state.write(path)
    if state.best_design is None or state.best_violation > FEASIBLE:
        raise InputError(
            "no design meets all limits",
            where=_broken(problem, state), hint="they may contradict: relax one, widen the bounds "
            "of free numbers, or try more starts")
    return np.array(state.best_design)


def _run_start(
    problem: DesignProblem, state: SearchState, first: FloatArray, path: Path,
    progress: Callable[[str], None],
) -> None:
    begun = time.monotonic()
    scale = max(abs(problem.evaluate(first).objective), 1e-12)
    steps_before = state.step

    def keep(design: FloatArray) -> None:
        found = problem.evaluate(design)
        violation = float(max(found.constraints.max(initial=0.0), 0.0))
        state.step += 1
        state.current = [float(x) for x in found.design]
        state.history.append((state.start, found.objective, violation))
        if _is_better(found, violation, state):
            state.best_design, state.best_violation = state.current, violation
            state.best_objective = found.objective
        state.write(path)
        each_s = (time.monotonic() - begun) / max(state.step - steps_before, 1)
        left = problem.settings.iterations * (problem.settings.starts - state.start) - state.step
        progress(f"start {state.start + 1} of {problem.settings.starts}, step {state.step}: "
                 f"{found.objective:.5g}, at most {_duration(each_s * max(left, 0))} left")

    keep(first)
    limits: list[dict[str, Any]] = []
    if len(problem.names):
        limits = [{"type": "ineq", "fun": lambda x: -problem.evaluate(x).constraints,
                   "jac": lambda x: -problem.evaluate(x).slopes}]
    minimize(
        lambda x: problem.evaluate(x).objective / scale, first,
        jac=lambda x: problem.evaluate(x).gradient / scale, method="SLSQP",
        bounds=[(0.0, 1.0)] * len(first), constraints=limits, callback=keep,
        options={"maxiter": max(problem.settings.iterations - steps_before, 1),
                 "ftol": _TOLERANCE})


def _is_better(found: DesignEvaluation, violation: float, state: SearchState) -> bool:
    if state.best_objective is None:
        return True
    if violation <= FEASIBLE and state.best_violation <= FEASIBLE:
        return found.objective < state.best_objective
    return violation < state.best_violation


def _starting_design(problem: DesignProblem, number: int) -> FloatArray:
    """The part file's own design first, then random ones, the same at every call."""
    if number == 0:
        return problem.design.start
    found = np.random.default_rng(number).random(len(problem.design.numbers))
    if problem.settings.monotone is not None:
        found = np.sort(found)
        if problem.settings.monotone == "falling":
            found = found[::-1].copy()
    return found


def _broken(problem: DesignProblem, state: SearchState) -> list[str]:
    if state.best_design is None:
        return []
    values = problem.evaluate(np.array(state.best_design)).constraints
    worst = dict.fromkeys(problem.names, 0.0)
    for name, value in zip(problem.names, values, strict=True):
        worst[name] = max(worst[name], float(value))
    return [f"{name}: beyond by {value:.1%} of the limit"
            for name, value in worst.items() if value > FEASIBLE]


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"
