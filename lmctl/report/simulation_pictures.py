"""Pictures of a simulation: its fields in planes through the part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from lmctl.array_types import FloatArray, IntArray
from lmctl.design.field_files import point_interpolation
from lmctl.design.performance_model import PerformanceModel
from lmctl.design.recovery import RecoveredFields
from lmctl.design.stress_measures import stress_measure

#: Points along the longer side of a section through a solid.
_SECTION_POINTS = 220
_PANEL_IN = 3.6


@dataclass(frozen=True, eq=False)
class SimulatedField:
    """One field at the nodes. values : (n_nodes,)"""

    title: str
    values: FloatArray
    colours: str


def pictured_fields(
    fields: RecoveredFields, materials: Sequence[str]
) -> list[SimulatedField]:
    """Von Mises and largest principal stress, use of strength, and temperature where it varies."""
    equivalent = stress_measure(fields.stress_MPa, "von-mises")
    found = [
        SimulatedField("von Mises stress [MPa]", equivalent, "viridis"),
        SimulatedField("largest principal stress [MPa]",
                       stress_measure(fields.stress_MPa, "largest-principal"), "coolwarm"),
        SimulatedField("von Mises stress over strength", equivalent / fields.strength_MPa,
                       "magma"),
    ]
    if np.ptp(fields.temperature_C) > 1e-6:
        found.append(SimulatedField("temperature [°C]", fields.temperature_C, "inferno"))
    if fields.fractions.shape[1] == 2:
        found.append(SimulatedField(f"volume fraction of {materials[1]}",
                                    fields.fractions[:, 1], "cividis"))
    return found


def draw_simulation(
    model: PerformanceModel, fields: RecoveredFields, target: Path, title: str
) -> None:
    """Draw the fields and save them; the ending of `target` chooses the format. Raises OSError."""
    simulation_figure(model, fields, title).savefig(target, bbox_inches="tight")


def simulation_figure(model: PerformanceModel, fields: RecoveredFields, title: str) -> Figure:
    """One column a field; one row for a plane model, three planes for a solid."""
    shown = pictured_fields(fields, model.phases.names)
    rows = 1 if model.space.dim == 2 else 3
    figure = Figure(figsize=(_PANEL_IN * len(shown), _PANEL_IN * rows), dpi=110,
                    layout="constrained")
    axes = np.asarray(figure.subplots(rows, len(shown), squeeze=False))
    if rows == 1:
        _draw_plane(model, shown, axes[0])
    else:
        for across in range(3):
            _draw_section(model, shown, axes[across], across)
    for field, axis in zip(shown, axes[0], strict=True):
        axis.set_title(field.title, fontsize=9)
    figure.suptitle(title, fontsize=11)
    return figure


def _draw_plane(
    model: PerformanceModel, shown: Sequence[SimulatedField], axes: Sequence[Axes]
) -> None:
    d = model.discretisation
    nodes: IntArray = d.element_nodes
    parts = np.concatenate([nodes[:, [0, 3, 5]], nodes[:, [3, 1, 4]], nodes[:, [5, 4, 2]],
                            nodes[:, [3, 4, 5]]])
    triangles = Triangulation(d.nodes_mm[:, 0], d.nodes_mm[:, 1], parts)
    for field, axis in zip(shown, axes, strict=True):
        painted = axis.tripcolor(triangles, field.values, shading="gouraud", cmap=field.colours)
        axis.figure.colorbar(painted, ax=axis, shrink=0.8)
        axis.set_aspect("equal")
        axis.set_xlabel(f"{model.space.axis_names[0]} [mm]")
        axis.set_ylabel(f"{model.space.axis_names[1]} [mm]")


def _draw_section(
    model: PerformanceModel, shown: Sequence[SimulatedField], axes: Sequence[Axes], across: int
) -> None:
    nodes = model.discretisation.nodes_mm
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    u, v = [axis for axis in range(3) if axis != across]
    step = max(high[u] - low[u], high[v] - low[v]) / _SECTION_POINTS
    us = np.arange(low[u] + step / 2, high[u], step)
    vs = np.arange(low[v] + step / 2, high[v], step)
    points = np.empty((len(vs), len(us), 3))
    points[..., u], points[..., v] = us, vs[:, None]
    points[..., across] = 0.5 * (low[across] + high[across])
    weights, corners, inside = point_interpolation(model, points.reshape(-1, 3))
    extent = (float(low[u]), float(high[u]), float(low[v]), float(high[v]))
    for field, axis in zip(shown, axes, strict=True):
        values = (weights * field.values[corners]).sum(axis=1)
        values[~inside] = np.nan
        painted = axis.imshow(values.reshape(len(vs), len(us)), origin="lower", extent=extent,
                              cmap=field.colours)
        axis.figure.colorbar(painted, ax=axis, shrink=0.8)
        axis.set_xlabel(f"{'xyz'[u]} [mm]  ({'xyz'[across]} = {points[0, 0, across]:.3g} mm)")
        axis.set_ylabel(f"{'xyz'[v]} [mm]")
