"""Signed distance field of a triangle mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.field.field import DistanceField
from lmctl.field.grid import Grid
from lmctl.field.mesh.seeds import seed_triangles
from lmctl.field.mesh.sign import negate_outside
from lmctl.field.sweep import propagate_closest_points
from lmctl.field.triangles import refine_to_closest, unique_triangles


def mesh_field(
    vertices: FloatArray, triangles: NDArray[np.integer], grid: Grid
) -> DistanceField:
    """Signed distance to a mesh at the nodes of a grid that holds it (Zhou et al. 2009, Eq. (1)).

    Next to the surface triangles are rasterised into their neighbourhood; closest points are
    swept from there over the rest, and from its own every node walks over the mesh to the
    nearest point there is.
    Signs by the vote of rays along three axes (`sign`), so triangles may be wound either way, be
    there twice, overlap, and leave holes: a ray through a hole has no vote.

    vertices : (n, 3) float64 [mm]; triangles : (m, 3) int, rows of `vertices`
    returns : Field with sources; its remarks report what was wrong with the mesh
    raises : InputError for no triangles, indices out of range, coordinates that are not
        numbers, and a mesh outside the grid
    """
    corners, copies = unique_triangles(_corners(vertices, triangles, grid))
    sources, surface_mm, triangle = seed_triangles(corners, grid)
    if len(surface_mm) == 0:
        raise InputError("the mesh lies outside its grid", where=_place(len(triangles), grid),
                         hint="give a grid around the mesh")
    values = propagate_closest_points(sources, surface_mm, grid)
    refine_to_closest(sources, values, triangle, corners, grid)
    lost, disputed = negate_outside(values, corners, grid)
    if not (values > 0.0).any():
        raise InputError(
            "the mesh encloses nothing that the grid can see",
            where=_place(len(triangles), grid),
            hint="check that it is closed and in millimetres, or use a smaller pitch",
        )
    remarks = []
    if copies:
        remarks.append(f"{copies} triangles of the mesh are there more than once: each counts once")
    if lost:
        remarks.append(f"the mesh is open: {lost} rays that enter it do not come out")
    if disputed:
        share = 100.0 * disputed / grid.n_nodes
        remarks.append(
            f"inside and outside are disputed at {disputed} of {grid.n_nodes} nodes "
            f"({share:.2g} %): the mesh is open or cuts through itself",
        )
    return DistanceField(grid, values, sources, corners, tuple(remarks), exact=True)


def _corners(vertices: FloatArray, triangles: NDArray[np.integer], grid: Grid) -> FloatArray:
    vertices = np.asarray(vertices, dtype=np.float64)
    triangles = np.asarray(triangles)
    where = _place(len(triangles), grid)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or triangles.ndim != 2 or (
        triangles.shape[1] != 3
    ):
        raise InputError("the mesh is not a list of triangles", where=where,
                         hint="give corners as rows of x, y, z and triangles as rows of three "
                              "corners")
    if len(triangles) == 0:
        raise InputError("the mesh has no triangles", where=where,
                         hint="export it again, as a mesh")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise InputError(
            "a triangle of the mesh names a vertex that is not there", where=where,
            hint="the file is damaged: export it again",
        )
    corners: FloatArray = vertices[triangles]
    bad = np.flatnonzero(~np.isfinite(corners).all(axis=(1, 2)))
    if len(bad):
        raise InputError(
            "the mesh has coordinates that are not numbers",
            where=(where, f"{len(bad)} triangles, the first is number {bad[0]}"),
            hint="the file is damaged: export it again",
        )
    return corners


def _place(count: int, grid: Grid) -> str:
    nz, ny, nx = grid.shape
    return f"{count} triangles, grid of {nx} x {ny} x {nz} nodes, pitch {grid.pitch_mm:g} mm"

