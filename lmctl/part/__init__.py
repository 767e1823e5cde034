"""A part gives the depth inside the solid and the material at every place."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.part.bodies.mesh_solid import MeshSolid as MeshSolid
    from lmctl.part.load import load_part as load_part
    from lmctl.part.load import part_from_model as part_from_model
    from lmctl.part.materials.powders import MaterialSpec as MaterialSpec
    from lmctl.part.part import Part as Part
    from lmctl.part.part import PartSection as PartSection
    from lmctl.part.resolution import finest_pitch_for_nodes as finest_pitch_for_nodes

#: Public names, and the module that holds each; loaded on first use.
_HOMES = {
    "MaterialSpec": "lmctl.part.materials.powders",
    "MeshSolid": "lmctl.part.bodies.mesh_solid",
    "Part": "lmctl.part.part",
    "PartSection": "lmctl.part.part",
    "finest_pitch_for_nodes": "lmctl.part.resolution",
    "load_part": "lmctl.part.load",
    "part_from_model": "lmctl.part.load",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
