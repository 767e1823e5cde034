"""The job file, the interface between planning, which writes it, and running, which reads it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.job.manifest_json import part_digest as part_digest
    from lmctl.job.packed_layer import PackedLayer as PackedLayer
    from lmctl.job.packed_layer import pack_layer_arrays as pack_layer_arrays
    from lmctl.job.reader import JobReader as JobReader
    from lmctl.job.schema import JobHopper as JobHopper
    from lmctl.job.schema import JobLayer as JobLayer
    from lmctl.job.schema import JobManifest as JobManifest
    from lmctl.job.schema import LayerHeat as LayerHeat
    from lmctl.job.schema import LayerMixture as LayerMixture
    from lmctl.job.schema import LineKind as LineKind
    from lmctl.job.schema import line_dtype as line_dtype
    from lmctl.job.writer import JobWriter as JobWriter

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "JobHopper": "lmctl.job.schema",
    "JobLayer": "lmctl.job.schema",
    "JobManifest": "lmctl.job.schema",
    "JobReader": "lmctl.job.reader",
    "JobWriter": "lmctl.job.writer",
    "LayerHeat": "lmctl.job.schema",
    "LayerMixture": "lmctl.job.schema",
    "LineKind": "lmctl.job.schema",
    "PackedLayer": "lmctl.job.packed_layer",
    "line_dtype": "lmctl.job.schema",
    "pack_layer_arrays": "lmctl.job.packed_layer",
    "part_digest": "lmctl.job.manifest_json",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
