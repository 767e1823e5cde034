"""The substrate of a part as its file states it, with the height of its surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.substrate import SubstrateSettings
from lmctl.errors import InputError
from lmctl.part.substrate.surface_heights import (
    BarHeights,
    GridHeights,
    PlaneHeights,
    SurfaceHeights,
)

if TYPE_CHECKING:
    from lmctl.part.bodies import Body
    from lmctl.part.part_data import PartData

#: Heights are stored on a grid of this share of the bead width.
_PITCH_BEADS = 0.25
#: So far around the part the surface is known, as the nozzle has to clear it there [mm].
_AROUND_MM = 30.0


@dataclass(frozen=True, eq=False)
class SubstrateSurface:
    """The surface of a substrate with a shape.

    settings : as the part file has them; heights : of its surface, in the part's coordinates
    """

    settings: SubstrateSettings
    heights: SurfaceHeights


def substrate_surface_of(
    settings: SubstrateSettings, body: Body, nominal: Body | None, data: PartData, bead_mm: float
) -> SubstrateSurface | None:
    """The substrate of a part; None for a level plate under its lowest point.

    body : the part; nominal : the body that a scan is the worn state of
    data : reads the file, and receives notes
    Raises InputError where a file cannot be used, or a scan does not lie on the nominal body.
    """
    if not settings.has_shape:
        return None
    if settings.kind in ("mesh", "scan"):
        return SubstrateSurface(settings, _measured(settings, body, nominal, data, bead_mm))
    point = np.array(settings.point_mm, dtype=np.float64)
    if settings.kind == "plane":
        normal = np.array(settings.normal, dtype=np.float64)
        return SubstrateSurface(settings, PlaneHeights(point, normal / np.linalg.norm(normal)))
    assert settings.radius_mm is not None, "the model asks for one"
    axis = np.array(settings.axis[:2], dtype=np.float64)
    bar = BarHeights(point, axis / np.linalg.norm(axis), settings.radius_mm)
    return SubstrateSurface(settings, bar)


def _measured(
    settings: SubstrateSettings, body: Body, nominal: Body | None, data: PartData, bead_mm: float
) -> GridHeights:
    from lmctl.part.substrate import measured_heights as measured  # late: few parts have one

    assert settings.file is not None, "the model asks for one"
    low, high = body.tight_bounds_mm
    grid = measured.grid_over(low[:2] - _AROUND_MM, high[:2] + _AROUND_MM, _PITCH_BEADS * bead_mm)
    points = data.substrate_points(settings)
    _refuse_beside(settings.file, points, low, high)
    if settings.kind == "mesh":
        heights = measured.heights_of_mesh(
            points, data.substrate_mesh(settings).triangles, grid)
    else:
        heights = measured.heights_of_points(points, grid, settings.file)
    if not heights.covered.any():
        raise InputError(f"{settings.file} has no surface over the part", where="substrate.file",
                         hint="check that it is in the part file's coordinates, and its units")
    if nominal is not None:
        from lmctl.part.substrate.registration import check_registration

        found = check_registration(
            heights, nominal, (settings.file, settings.of or ""), settings.registration_mm)
        data.notes.append(
            f"{settings.file} lies on {settings.of!r} over {found.unworn_fraction:.0%} of it, "
            f"{found.off_mm:.2g} mm off (root mean square); worn by up to {found.wear_mm:.2f} mm")
    return heights


def _refuse_beside(
    name: str, points_mm: FloatArray, low: FloatArray, high: FloatArray
) -> None:
    """Raise InputError where points (n, 3) and the part lie beside each other in the plane."""
    near, far = points_mm[:, :2].min(axis=0), points_mm[:, :2].max(axis=0)
    apart = float(np.linalg.norm(np.maximum(np.maximum(near - high[:2], low[:2] - far), 0.0)))
    if apart > 0:
        raise InputError(f"{name} and the part lie {apart:.1f} mm apart in the xy plane",
                         where="substrate.file",
                         hint="register it to the part file's coordinates, and check its units")
