"""The bodies a part is made of; each computes how deep a place lies inside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.part.bodies.allowance import AllowanceBody as AllowanceBody
    from lmctl.part.bodies.analytic import AnalyticBody as AnalyticBody
    from lmctl.part.bodies.body import Body as Body
    from lmctl.part.bodies.body import empty_section as empty_section
    from lmctl.part.bodies.body import plane_points as plane_points
    from lmctl.part.bodies.corners import restore_corners as restore_corners
    from lmctl.part.bodies.depth import maximum_in_box as maximum_in_box
    from lmctl.part.bodies.formulas import Box as Box
    from lmctl.part.bodies.formulas import Cone as Cone
    from lmctl.part.bodies.formulas import Cylinder as Cylinder
    from lmctl.part.bodies.formulas import Sphere as Sphere
    from lmctl.part.bodies.formulas import Torus as Torus
    from lmctl.part.bodies.half_space import HalfSpace as HalfSpace
    from lmctl.part.bodies.measured import Bounds as Bounds
    from lmctl.part.bodies.measured import is_closed as is_closed
    from lmctl.part.bodies.measured import remove_specks as remove_specks
    from lmctl.part.bodies.mesh_solid import MeshSolid as MeshSolid
    from lmctl.part.bodies.prism import Prism as Prism
    from lmctl.part.bodies.prism import close_polygon as close_polygon
    from lmctl.part.bodies.stored import FieldSolid as FieldSolid
    from lmctl.part.bodies.surfaces import OffsetSurface as OffsetSurface
    from lmctl.part.bodies.surfaces import Surface as Surface
    from lmctl.part.bodies.surfaces import SurfaceSet as SurfaceSet
    from lmctl.part.bodies.surfaces import Vector as Vector
    from lmctl.part.bodies.surfaces import places_by_number as places_by_number
    from lmctl.part.bodies.transformed import SimilarityTransform as SimilarityTransform
    from lmctl.part.bodies.transformed import TransformedBody as TransformedBody
    from lmctl.part.bodies.transformed import similarity_transform as similarity_transform

#: Public names, and the module that holds each; loaded on first use.
_HOMES = {
    "AllowanceBody": "lmctl.part.bodies.allowance",
    "AnalyticBody": "lmctl.part.bodies.analytic",
    "Body": "lmctl.part.bodies.body",
    "Bounds": "lmctl.part.bodies.measured",
    "Box": "lmctl.part.bodies.formulas",
    "Cone": "lmctl.part.bodies.formulas",
    "Cylinder": "lmctl.part.bodies.formulas",
    "FieldSolid": "lmctl.part.bodies.stored",
    "HalfSpace": "lmctl.part.bodies.half_space",
    "MeshSolid": "lmctl.part.bodies.mesh_solid",
    "OffsetSurface": "lmctl.part.bodies.surfaces",
    "Prism": "lmctl.part.bodies.prism",
    "SimilarityTransform": "lmctl.part.bodies.transformed",
    "Sphere": "lmctl.part.bodies.formulas",
    "Surface": "lmctl.part.bodies.surfaces",
    "SurfaceSet": "lmctl.part.bodies.surfaces",
    "Torus": "lmctl.part.bodies.formulas",
    "TransformedBody": "lmctl.part.bodies.transformed",
    "Vector": "lmctl.part.bodies.surfaces",
    "close_polygon": "lmctl.part.bodies.prism",
    "empty_section": "lmctl.part.bodies.body",
    "is_closed": "lmctl.part.bodies.measured",
    "maximum_in_box": "lmctl.part.bodies.depth",
    "places_by_number": "lmctl.part.bodies.surfaces",
    "plane_points": "lmctl.part.bodies.body",
    "remove_specks": "lmctl.part.bodies.measured",
    "restore_corners": "lmctl.part.bodies.corners",
    "similarity_transform": "lmctl.part.bodies.transformed",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
