"""Adjoint gradients against central differences, of every quantity in every kind of model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lmctl.design.adjoint import fraction_gradient
from lmctl.design.free_design import FreeDesign
from lmctl.design.functionals import Quantity, evaluate
from lmctl.design.part_model import build_model
from lmctl.part.load import load_measured_part

PART = """name = "block"
[[material]]
name = "Al"
price_per_kg = 5
[[material]]
name = "ZrO2"
price_per_kg = 50
[[body]]
name = "block"
kind = "box"
low_mm = [1, -3, 0]
high_mm = [9, 3, 6]
[composition]
feature = {{ kind = "coordinate", along = "x" }}
[composition.profile]
kind = "power"
near = {{ "Al" = 1 }}
far = {{ "ZrO2" = 1 }}
over_mm = [-1, 11]
a = {{ free = [0.7, 0.99], start = 0.9 }}
k = {{ free = [0.5, 3], start = 1.2 }}
[[face]]
name = "low"
feature = {{ kind = "plane", point_mm = [0, 0, 0], normal = [0, 0, 1] }}
[[face]]
name = "side"
feature = {{ kind = "plane", point_mm = [1, 0, 0], normal = [1, 0, 0] }}
[[face]]
name = "end"
feature = {{ kind = "plane", point_mm = [9, 0, 0], normal = [1, 0, 0] }}
[[support]]
on = "side"
fix = {fix}
[[load]]
on = "end"
traction_MPa = {pull}
[[heat]]
on = "side"
temperature_C = 20
[[heat]]
on = "end"
film_W_mm2_K = 0.01
ambient_C = 400
[simulation]
model = "{model}"
mesh_mm = 3
"""
KINDS = {"solid": ('["x", "y", "z"]', "[5, 3, 2]"), "plane-stress": ('["x", "y"]', "[5, 3, 0]"),
         "plane-strain": ('["x", "y"]', "[5, 3, 0]"), "axisymmetric": ('["r", "z"]', "[5, 0, 2]")}
QUANTITIES = [
    *(Quantity(name, 8.0) for name in ("von-mises", "largest-principal", "tresca", "xx",
                                       "utilisation", "temperature")),
    Quantity("mass"), Quantity("cost"), Quantity("von-mises", None, 50.0),
    Quantity("von-mises", 8.0, material=1), Quantity("fraction", None, material=1),
    Quantity("fraction", None, sign=-1.0, material=1),
]


@pytest.mark.parametrize("kind", list(KINDS))
def test_adjoint_gradients_are_those_of_central_differences(kind: str, tmp_path: Path) -> None:
    fix, pull = KINDS[kind]
    text = PART.format(model=kind, fix=fix, pull=pull)
    (tmp_path / "p.toml").write_text(text)
    model = build_model(load_measured_part(tmp_path / "p.toml"))
    design = FreeDesign(text, "p.toml", tmp_path)
    points, shape = model.discretisation.part_places_mm, model.discretisation.weights.shape

    def solve(x: np.ndarray) -> object:
        return model.solve(design.fractions(x, points).reshape(*shape, -1))

    x, step = design.start, 1e-4
    ends = [[evaluate(model, solve(x + s * step * way), q).value for q in QUANTITIES]
            for way in np.eye(len(x)) for s in (2, 1, -1, -2)]
    by_number = np.array(ends).reshape(len(x), 4, -1)
    expected = (8 * (by_number[:, 1] - by_number[:, 2])
                - (by_number[:, 0] - by_number[:, 3])) / (12 * step)
    solution = solve(x)
    slopes = [design.slope(x, points, n).reshape(*shape, -1) for n in range(len(x))]
    for number, quantity in enumerate(QUANTITIES):
        gradient = fraction_gradient(model, solution, evaluate(model, solution, quantity))
        found = np.array([(gradient * slope).sum() for slope in slopes])
        scale = max(np.abs(expected[:, number]).max(), 1e-12)
        assert np.abs(found - expected[:, number]).max() / scale < 1e-5, quantity
