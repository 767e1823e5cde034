"""The devices of a cell together: opened, checked, owned, beam off or on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.run.cell.beam_control import BeamControl as BeamControl
    from lmctl.run.cell.devices import Cell as Cell
    from lmctl.run.cell.doctor import CellInspection as CellInspection
    from lmctl.run.cell.doctor import check_inspection as check_inspection
    from lmctl.run.cell.doctor import hoppers_of_feeder as hoppers_of_feeder
    from lmctl.run.cell.doctor import inspect_cell as inspect_cell
    from lmctl.run.cell.ownership import lock_machine as lock_machine
    from lmctl.run.cell.work_offset import refuse_changed_offset as refuse_changed_offset
    from lmctl.run.cell.work_offset import work_offset_conditions as work_offset_conditions

#: Public names and the module that holds each; a module is imported on first use.
_HOMES = {
    "BeamControl": "lmctl.run.cell.beam_control",
    "Cell": "lmctl.run.cell.devices",
    "CellInspection": "lmctl.run.cell.doctor",
    "check_inspection": "lmctl.run.cell.doctor",
    "hoppers_of_feeder": "lmctl.run.cell.doctor",
    "inspect_cell": "lmctl.run.cell.doctor",
    "lock_machine": "lmctl.run.cell.ownership",
    "refuse_changed_offset": "lmctl.run.cell.work_offset",
    "work_offset_conditions": "lmctl.run.cell.work_offset",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
