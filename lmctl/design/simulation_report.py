"""Extremes of a simulation with their places and errors, as plain data and as lines of text."""

from __future__ import annotations

from typing import Any

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.design.part_model import COARSE_CHANGE, coarse_share
from lmctl.design.performance_model import PerformanceModel, PerformanceSolution
from lmctl.design.recovery import RecoveredFields
from lmctl.design.stress_measures import STRESS_MEASURES, stress_measure

#: A mesh whose estimated error is above this share is called too coarse.
COARSE_ERROR = 0.05


def extremes(
    model: PerformanceModel, solution: PerformanceSolution, fields: RecoveredFields
) -> dict[str, Any]:
    """Plain data: the least and largest of every field, where, and how wrong they may be.

    Stresses in MPa with the estimated error of each; temperature in °C, displacement in mm.
    """
    space = model.space
    places = space.part_points(model.discretisation.nodes_mm)
    found: dict[str, Any] = {}
    for measure in STRESS_MEASURES:
        values = stress_measure(fields.stress_MPa, measure)
        found[measure] = {
            "unit": "MPa",
            **{end: _extreme(values, row, places, fields.stress_error_MPa)
               for end, row in (("least", values.argmin()), ("largest", values.argmax()))}}
    used = stress_measure(fields.stress_MPa, "von-mises") / fields.strength_MPa
    found["utilisation"] = {"unit": "1", "largest": _extreme(
        used, used.argmax(), places, fields.stress_error_MPa / fields.strength_MPa)}
    found["temperature"] = {"unit": "°C", **{
        end: _extreme(fields.temperature_C, row, places)
        for end, row in (("least", fields.temperature_C.argmin()),
                         ("largest", fields.temperature_C.argmax()))}}
    size = np.linalg.norm(fields.displacement_mm, axis=1)
    found["displacement"] = {"unit": "mm", "largest": _extreme(size, size.argmax(), places)}
    change, share = coarse_share(model, solution.fractions)
    d = model.discretisation
    return {
        "model": space.kind,
        "unknowns": int(d.n_nodes * (space.dim + model.conditions.has_heat_problem)),
        "elements": d.fitted.n_elements,
        "mesh_mm": d.fitted.size_mm,
        "volume_mm3": float(d.weights.sum()),
        "mass_g": float((d.weights * solution.properties.density_g_mm3).sum()),
        "relative_error": fields.relative_error,
        "largest_fraction_change_in_an_element": change,
        "volume_share_of_coarse_elements": share,
        "hoop_axis": "yy is the hoop direction" if space.kind == "axisymmetric" else None,
        "extremes": found,
        "materials": list(model.phases.sources),
    }


def coarseness_warnings(data: dict[str, Any]) -> list[str]:
    """What has to be said where the mesh is too coarse for the field or the gradient."""
    warnings = []
    if data["volume_share_of_coarse_elements"] > 0:
        warnings.append(
            f"the mesh is coarse for the gradient: a fraction changes by "
            f"{data['largest_fraction_change_in_an_element']:.2f} within one element, and by more "
            f"than {COARSE_CHANGE} in {data['volume_share_of_coarse_elements']:.1%} of the volume; "
            f"estimated error {data['relative_error']:.1%} in energy; lower mesh_mm")
    elif data["relative_error"] > COARSE_ERROR:
        warnings.append(f"the mesh is coarse: estimated error {data['relative_error']:.1%} in "
                        "energy; lower mesh_mm")
    return warnings


def summary_lines(data: dict[str, Any]) -> list[str]:
    """The extremes for people."""
    lines = [f"{data['model']}: {data['unknowns']:,} unknowns, {data['elements']:,} elements of "
             f"{data['mesh_mm']:.3g} mm, estimated error {data['relative_error']:.2%} in energy"]
    for name in ("von-mises", "tresca", "largest-principal", "utilisation", "temperature",
                 "displacement"):
        most = data["extremes"][name]["largest"]
        unit = data["extremes"][name]["unit"].replace("1", "").strip()
        place = ", ".join(f"{v:.2f}" for v in most["at_mm"])
        error = f" ± {most['error']:.2g}" if "error" in most else ""
        lines.append(f"  {name:18} {most['value']:.4g}{error} {unit}".rstrip()
                     + f" at ({place}) mm")
    return lines


def _extreme(
    values: FloatArray, row: np.intp, places: FloatArray, errors: FloatArray | None = None
) -> dict[str, Any]:
    found: dict[str, Any] = {"value": float(values[row]),
                             "at_mm": [float(v) for v in places[row]]}
    if errors is not None:
        found["error"] = float(errors[row])
    return found
