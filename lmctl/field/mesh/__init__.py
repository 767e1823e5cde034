"""From triangles to a field."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.field.mesh.triangle_tree import TriangleTree as TriangleTree

#: Public names, and the module that holds each; loaded on first use.
_HOMES = {
    "TriangleTree": "lmctl.field.mesh.triangle_tree",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
