"""Jobs and parts in the forms of other programs: G-code of other controllers, tables, 3MF."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.exchange.dialect import GcodeDialect as GcodeDialect
    from lmctl.exchange.dialect import load_dialect as load_dialect
    from lmctl.exchange.gcode import gcode_lines as gcode_lines
    from lmctl.exchange.layer_table import planned_layers_as_csv as planned_layers_as_csv

#: Public names and the module that holds each; a module is imported on first use.
_HOMES = {
    "GcodeDialect": "lmctl.exchange.dialect",
    "gcode_lines": "lmctl.exchange.gcode",
    "load_dialect": "lmctl.exchange.dialect",
    "planned_layers_as_csv": "lmctl.exchange.layer_table",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
