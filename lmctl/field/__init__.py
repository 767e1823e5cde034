"""Signed distance on grids: kernels are array functions without a tree or a material."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.field.array_storage import allocate_array as allocate_array
    from lmctl.field.array_storage import is_stored_on_disk as is_stored_on_disk
    from lmctl.field.array_storage import mapped_storage_space as mapped_storage_space
    from lmctl.field.array_storage import storage_full_message as storage_full_message
    from lmctl.field.cloud.cloud_field import cloud_field as cloud_field
    from lmctl.field.features import axis_distance as axis_distance
    from lmctl.field.features import plane_offset as plane_offset
    from lmctl.field.features import point_distance as point_distance
    from lmctl.field.features import segment_distance as segment_distance
    from lmctl.field.features import unit_vector as unit_vector
    from lmctl.field.field import DistanceField as DistanceField
    from lmctl.field.field import sample_distance as sample_distance
    from lmctl.field.field import sample_gradient as sample_gradient
    from lmctl.field.grid import Grid as Grid
    from lmctl.field.grid import Window as Window
    from lmctl.field.kernel import inner_kernel as inner_kernel
    from lmctl.field.maximum_depth import find_maximum_depth as find_maximum_depth
    from lmctl.field.mesh.triangle_tree import TriangleTree as TriangleTree
    from lmctl.field.outline_distance import nearest_segments as nearest_segments
    from lmctl.field.outline_distance import plane_distance as plane_distance
    from lmctl.field.outline_offset import offset_loops as offset_loops
    from lmctl.field.plane import PlaneGrid as PlaneGrid
    from lmctl.field.plane import iso_loops as iso_loops
    from lmctl.field.plane import loop_area_mm2 as loop_area_mm2
    from lmctl.field.plane import section_loops as section_loops
    from lmctl.field.primitives import box_distance as box_distance
    from lmctl.field.primitives import cone_distance as cone_distance
    from lmctl.field.primitives import cylinder_distance as cylinder_distance
    from lmctl.field.primitives import half_space_distance as half_space_distance
    from lmctl.field.primitives import sphere_distance as sphere_distance
    from lmctl.field.primitives import torus_distance as torus_distance
    from lmctl.field.surface import iso_surface as iso_surface
    from lmctl.field.surface import weld_points as weld_points
    from lmctl.field.surface_files import Kind as Kind
    from lmctl.field.surface_files import surface_bytes as surface_bytes
    from lmctl.field.sweep import propagate_closest_points as propagate_closest_points
    from lmctl.field.triangles import closest_points_on_rows as closest_points_on_rows

#: Public names, and the module that holds each; loaded on first use.
_HOMES = {
    "DistanceField": "lmctl.field.field",
    "Grid": "lmctl.field.grid",
    "Kind": "lmctl.field.surface_files",
    "PlaneGrid": "lmctl.field.plane",
    "TriangleTree": "lmctl.field.mesh.triangle_tree",
    "Window": "lmctl.field.grid",
    "allocate_array": "lmctl.field.array_storage",
    "axis_distance": "lmctl.field.features",
    "box_distance": "lmctl.field.primitives",
    "closest_points_on_rows": "lmctl.field.triangles",
    "cloud_field": "lmctl.field.cloud.cloud_field",
    "cone_distance": "lmctl.field.primitives",
    "cylinder_distance": "lmctl.field.primitives",
    "find_maximum_depth": "lmctl.field.maximum_depth",
    "half_space_distance": "lmctl.field.primitives",
    "inner_kernel": "lmctl.field.kernel",
    "is_stored_on_disk": "lmctl.field.array_storage",
    "iso_loops": "lmctl.field.plane",
    "iso_surface": "lmctl.field.surface",
    "loop_area_mm2": "lmctl.field.plane",
    "mapped_storage_space": "lmctl.field.array_storage",
    "nearest_segments": "lmctl.field.outline_distance",
    "offset_loops": "lmctl.field.outline_offset",
    "plane_distance": "lmctl.field.outline_distance",
    "plane_offset": "lmctl.field.features",
    "point_distance": "lmctl.field.features",
    "propagate_closest_points": "lmctl.field.sweep",
    "sample_distance": "lmctl.field.field",
    "sample_gradient": "lmctl.field.field",
    "section_loops": "lmctl.field.plane",
    "segment_distance": "lmctl.field.features",
    "sphere_distance": "lmctl.field.primitives",
    "storage_full_message": "lmctl.field.array_storage",
    "surface_bytes": "lmctl.field.surface_files",
    "torus_distance": "lmctl.field.primitives",
    "unit_vector": "lmctl.field.features",
    "weld_points": "lmctl.field.surface",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
