"""Job logs: from journals and job files to tables people read."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.report.as_built_run import as_built_summary as as_built_summary
    from lmctl.report.job_log_csv import part_record_as_csv as part_record_as_csv
    from lmctl.report.job_log_text import part_record_as_text as part_record_as_text
    from lmctl.report.layer_picture import LayerView as LayerView
    from lmctl.report.layer_picture import draw_layer as draw_layer
    from lmctl.report.part_export import write_field as write_field
    from lmctl.report.part_export import write_surface as write_surface
    from lmctl.report.part_picture import draw_part as draw_part
    from lmctl.report.part_record import PartRecord as PartRecord
    from lmctl.report.part_record import part_record_of as part_record_of

#: Public names and the module that holds each; a module is imported on first use.
_HOMES = {
    "LayerView": "lmctl.report.layer_picture",
    "PartRecord": "lmctl.report.part_record",
    "as_built_summary": "lmctl.report.as_built_run",
    "draw_layer": "lmctl.report.layer_picture",
    "draw_part": "lmctl.report.part_picture",
    "part_record_as_csv": "lmctl.report.job_log_csv",
    "part_record_as_text": "lmctl.report.job_log_text",
    "part_record_of": "lmctl.report.part_record",
    "write_field": "lmctl.report.part_export",
    "write_surface": "lmctl.report.part_export",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
