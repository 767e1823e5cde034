"""Operations on a machine outside a run: inspection, homing, jogging."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.machine.manual.controller import open_motion_controller as open_motion_controller
    from lmctl.machine.manual.homing import clear_work_offsets as clear_work_offsets
    from lmctl.machine.manual.homing import describe_homing as describe_homing
    from lmctl.machine.manual.homing import home_axes as home_axes
    from lmctl.machine.manual.homing import set_work_offset as set_work_offset
    from lmctl.machine.manual.homing import unlock_controller as unlock_controller
    from lmctl.machine.manual.inspect_modbus import FeederInspection as FeederInspection
    from lmctl.machine.manual.inspect_modbus import inspect_feeder as inspect_feeder
    from lmctl.machine.manual.inspect_modbus import inspect_safety as inspect_safety
    from lmctl.machine.manual.inspect_motion import MotionReading as MotionReading
    from lmctl.machine.manual.inspect_motion import inspect_controller as inspect_controller
    from lmctl.machine.manual.inspect_motion import read_motion as read_motion
    from lmctl.machine.manual.jog import JogRequest as JogRequest
    from lmctl.machine.manual.jog import jog_axes as jog_axes
    from lmctl.machine.manual.rate_search import find_baud_rate as find_baud_rate
    from lmctl.machine.manual.settings import WrittenSettings as WrittenSettings
    from lmctl.machine.manual.settings import apply_settings as apply_settings
    from lmctl.machine.manual.settings_file import is_same_value as is_same_value
    from lmctl.machine.manual.settings_file import parse_setting as parse_setting
    from lmctl.machine.manual.settings_file import read_settings_file as read_settings_file
    from lmctl.machine.manual.settings_file import write_settings_file as write_settings_file

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "FeederInspection": "lmctl.machine.manual.inspect_modbus",
    "JogRequest": "lmctl.machine.manual.jog",
    "MotionReading": "lmctl.machine.manual.inspect_motion",
    "WrittenSettings": "lmctl.machine.manual.settings",
    "apply_settings": "lmctl.machine.manual.settings",
    "clear_work_offsets": "lmctl.machine.manual.homing",
    "describe_homing": "lmctl.machine.manual.homing",
    "find_baud_rate": "lmctl.machine.manual.rate_search",
    "home_axes": "lmctl.machine.manual.homing",
    "inspect_controller": "lmctl.machine.manual.inspect_motion",
    "inspect_feeder": "lmctl.machine.manual.inspect_modbus",
    "inspect_safety": "lmctl.machine.manual.inspect_modbus",
    "is_same_value": "lmctl.machine.manual.settings_file",
    "jog_axes": "lmctl.machine.manual.jog",
    "open_motion_controller": "lmctl.machine.manual.controller",
    "parse_setting": "lmctl.machine.manual.settings_file",
    "read_motion": "lmctl.machine.manual.inspect_motion",
    "read_settings_file": "lmctl.machine.manual.settings_file",
    "set_work_offset": "lmctl.machine.manual.homing",
    "unlock_controller": "lmctl.machine.manual.homing",
    "write_settings_file": "lmctl.machine.manual.settings_file",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
