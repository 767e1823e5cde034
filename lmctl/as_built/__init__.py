"""What was built against what was designed: by volume, along the path, in height and in powder."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.as_built.built_volume import BuiltVolume as BuiltVolume
    from lmctl.as_built.comparison import AsBuiltComparison as AsBuiltComparison
    from lmctl.as_built.comparison import compare_with_design as compare_with_design
    from lmctl.as_built.figures import AsBuiltSummary as AsBuiltSummary
    from lmctl.as_built.prediction import predicted_volume as predicted_volume
    from lmctl.as_built.voxel_map_file import read_voxel_map as read_voxel_map

#: Public names, and the module that holds each; loaded on first use.
_HOMES = {
    "AsBuiltComparison": "lmctl.as_built.comparison",
    "AsBuiltSummary": "lmctl.as_built.figures",
    "BuiltVolume": "lmctl.as_built.built_volume",
    "compare_with_design": "lmctl.as_built.comparison",
    "predicted_volume": "lmctl.as_built.prediction",
    "read_voxel_map": "lmctl.as_built.voxel_map_file",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
