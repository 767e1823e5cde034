"""Where a part comes from: files of meshes and clouds, read and judged."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.part.sources.cloud_files import PointCloud as PointCloud
    from lmctl.part.sources.cloud_files import read_cloud as read_cloud
    from lmctl.part.sources.files import DataFile as DataFile
    from lmctl.part.sources.files import read_data_file as read_data_file
    from lmctl.part.sources.mesh_files import Mesh as Mesh
    from lmctl.part.sources.mesh_files import read_mesh as read_mesh
    from lmctl.part.sources.mesh_repair import repair_mesh as repair_mesh
    from lmctl.part.sources.mesh_topology import connected_components as connected_components
    from lmctl.part.sources.mesh_topology import edge_numbers as edge_numbers
    from lmctl.part.sources.mesh_topology import remove_slivers as remove_slivers
    from lmctl.part.sources.obj_files import read_obj as read_obj
    from lmctl.part.sources.obj_files import triangle_rows_of_group as triangle_rows_of_group
    from lmctl.part.sources.slicing import MeshSlicer as MeshSlicer

#: Public names, and the module that holds each; loaded on first use.
_HOMES = {
    "DataFile": "lmctl.part.sources.files",
    "Mesh": "lmctl.part.sources.mesh_files",
    "MeshSlicer": "lmctl.part.sources.slicing",
    "PointCloud": "lmctl.part.sources.cloud_files",
    "connected_components": "lmctl.part.sources.mesh_topology",
    "edge_numbers": "lmctl.part.sources.mesh_topology",
    "read_cloud": "lmctl.part.sources.cloud_files",
    "read_data_file": "lmctl.part.sources.files",
    "read_mesh": "lmctl.part.sources.mesh_files",
    "read_obj": "lmctl.part.sources.obj_files",
    "remove_slivers": "lmctl.part.sources.mesh_topology",
    "repair_mesh": "lmctl.part.sources.mesh_repair",
    "triangle_rows_of_group": "lmctl.part.sources.obj_files",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
