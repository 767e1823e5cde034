"""An optimisation as functions of a design: objective, constraints, and their gradients."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.machine import MachineProfile
from lmctl.config.simulation import LimitSettings, OptimiseSettings
from lmctl.design.adjoint import fraction_gradient
from lmctl.design.deposition_limits import LayingConstraints, laying_limits
from lmctl.design.free_design import FreeDesign
from lmctl.design.functionals import PEAK_NORM, Quantity, evaluate
from lmctl.design.part_model import build_model
from lmctl.design.performance_model import PerformanceModel, PerformanceSolution
from lmctl.errors import ConfigError, Finding
from lmctl.part.load import MeasuredPart


@dataclass(frozen=True, eq=False)
class DesignEvaluation:
    """One design: value of the objective, and constraints that hold where they are at most 0.

    gradient : (n,); slopes : (constraints, n), by the design's entries
    """

    design: FloatArray
    objective: float
    gradient: FloatArray
    constraints: FloatArray
    slopes: FloatArray


class DesignProblem:
    """What `lmctl optimise` solves for one part file.

    names : of the constraints
    """

    def __init__(self, measured: MeasuredPart, path: Path, profile: MachineProfile) -> None:
        settings = measured.file.optimise
        if settings is None:
            raise ConfigError(f"{path} has no table [optimise]",
                              hint='say what is to be least: [optimise] minimise = "von-mises"')
        self.settings: OptimiseSettings = settings
        self.measured = measured
        self.design = FreeDesign(measured.part.text, str(path), path.parent)
        self.model: PerformanceModel = build_model(measured)
        self._refuse_missing_prices(settings)
        d = self.model.discretisation
        self.design.refuse_other_shapes(
            d.part_places_mm[:: max(len(d.part_places_mm) // 5000, 1)],
            self.model.space.part_points(
                self.model.conditions.facets.corners_mm.reshape(-1, self.model.space.dim)))
        first = self.solve(self.design.start)
        self.objective = self._objective(settings, first)
        self._limits = [one for limit in settings.limit for one in self._quantities(limit)]
        self.laying: LayingConstraints | None = None
        if settings.depositable:
            self.limits = laying_limits(measured.part, profile, settings.rate_per_s)
            self.laying = LayingConstraints(measured.part, self.design, self.limits,
                                            settings.forbidden)
        self._order = _level_order(self.design, settings)
        self.names = [_limit_name(limit) for limit, _, _ in self._limits]
        self.names += self.laying.names if self.laying else []
        self.names += ["monotone levels"] * len(self._order)
        self._last: DesignEvaluation | None = None

    def solve(self, design: FloatArray) -> PerformanceSolution:
        """The fields of a design."""
        shape = self.model.discretisation.weights.shape
        points = self.model.discretisation.part_places_mm
        return self.model.solve(self.design.fractions(design, points).reshape(*shape, -1))

    def value(self, design: FloatArray) -> float:
        """The objective alone."""
        return evaluate(self.model, self.solve(design), self.objective).value

    def evaluate(self, design: FloatArray) -> DesignEvaluation:
        """Objective and constraints of a design with their gradients; the last one is kept."""
        design = np.clip(np.asarray(design, dtype=np.float64), 0.0, 1.0)
        if self._last is not None and np.array_equal(self._last.design, design):
            return self._last
        solution = self.solve(design)
        partials = [evaluate(self.model, solution, self.objective)]
        partials += [evaluate(self.model, solution, quantity) for _, quantity, _ in self._limits]
        by_fraction = [fraction_gradient(self.model, solution, p) for p in partials]
        points = self.model.discretisation.part_places_mm
        slopes = np.empty((len(partials), len(design)))
        for number in range(len(design)):
            change = self.design.slope(design, points, number).reshape(by_fraction[0].shape)
            slopes[:, number] = [(gradient * change).sum() for gradient in by_fraction]
        values, rows = [], []
        for (limit, quantity, at), partial, slope in zip(
                self._limits, partials[1:], slopes[1:], strict=True):
            size = max(abs(at), 1e-9 * quantity.scale, 1e-12)
            values.append((partial.value - at) * limit_sign(limit, at) / size)
            rows.append(slope * limit_sign(limit, at) / size)
        if self.laying is not None:
            values += list(self.laying.values(design))
            rows += list(self.laying.gradients(design))
        for low, high, sign in self._order:
            row = np.zeros(len(design))
            row[low], row[high] = sign, -sign
            values.append(float(row @ design))
            rows.append(row)
        self._last = DesignEvaluation(
            design, partials[0].value, slopes[0], np.array(values),
            np.array(rows).reshape(len(rows), len(design)))
        return self._last

    def _refuse_missing_prices(self, settings: OptimiseSettings) -> None:
        asked = {settings.minimise, *(limit.quantity for limit in settings.limit)}
        missing = [Finding(f"material[{n}].price_per_kg", "is missing, and cost is asked for")
                   for n, material in enumerate(self.measured.file.material, start=1)
                   if material.price_per_kg is None]
        if "cost" in asked and missing:
            raise ConfigError("there is no cost without prices", findings=missing,
                              hint="add them to the [[material]] tables, in any one currency")

    def _objective(self, settings: OptimiseSettings, first: PerformanceSolution) -> Quantity:
        coldest = float(min(first.temperature_C.min(), self.model.conditions.stress_free_C))
        return Quantity(settings.minimise, settings.norm or PEAK_NORM, reference_C=coldest)

    def _quantities(self, limit: LimitSettings) -> list[tuple[LimitSettings, Quantity, float]]:
        names = self.model.phases.names
        number = None if limit.material is None else names.index(limit.material)
        found = []
        for at, sign in ((limit.at_most, 1.0), (limit.at_least, -1.0)):
            if at is not None:
                scale = 1.0 if limit.quantity == "fraction" else max(abs(at), 1e-9)
                found.append((limit, Quantity(limit.quantity, None, scale, sign, number), at))
        return found


def limit_sign(limit: LimitSettings, at: float) -> float:
    """+1 where a value must be at most `at`, −1 where at least."""
    return 1.0 if limit.at_most is not None and at == limit.at_most else -1.0


def _limit_name(limit: LimitSettings) -> str:
    ends = [f"at most {limit.at_most:g}" if limit.at_most is not None else "",
            f"at least {limit.at_least:g}" if limit.at_least is not None else ""]
    of = f" of {limit.material}" if limit.material else ""
    return f"{limit.quantity}{of} {' and '.join(filter(None, ends))}"


def _level_order(design: FreeDesign, settings: OptimiseSettings) -> list[tuple[int, int, float]]:
    """Pairs of neighbouring free levels, the first at most the second where they rise."""
    if settings.monotone is None:
        return []
    sign = 1.0 if settings.monotone == "rising" else -1.0
    pairs = []
    for n in range(1, len(design.numbers)):
        a, b = design.numbers[n - 1].name, design.numbers[n].name
        if " level " in a and a.rpartition(" level ")[0] == b.rpartition(" level ")[0]:
            pairs.append((n - 1, n, sign))
    return pairs
