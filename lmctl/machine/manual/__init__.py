"""What is done to a machine outside a run: looked at, homed, jogged."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.machine.manual.controller import open_motion as open_motion
    from lmctl.machine.manual.homing import describe_homing as describe_homing
    from lmctl.machine.manual.homing import home_axes as home_axes
    from lmctl.machine.manual.homing import run_clear_offsets as run_clear_offsets
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
    from lmctl.machine.manual.rate_search import find_rate as find_rate
    from lmctl.machine.manual.settings import WrittenSettings as WrittenSettings
    from lmctl.machine.manual.settings import apply_settings as apply_settings
    from lmctl.machine.manual.settings_file import read_setting as read_setting
    from lmctl.machine.manual.settings_file import same_value as same_value
    from lmctl.machine.manual.settings_file import settings_in as settings_in
    from lmctl.machine.manual.settings_file import write_settings as write_settings

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "FeederInspection": "lmctl.machine.manual.inspect_modbus",
    "JogRequest": "lmctl.machine.manual.jog",
    "MotionReading": "lmctl.machine.manual.inspect_motion",
    "WrittenSettings": "lmctl.machine.manual.settings",
    "apply_settings": "lmctl.machine.manual.settings",
    "describe_homing": "lmctl.machine.manual.homing",
    "find_rate": "lmctl.machine.manual.rate_search",
    "home_axes": "lmctl.machine.manual.homing",
    "inspect_controller": "lmctl.machine.manual.inspect_motion",
    "inspect_feeder": "lmctl.machine.manual.inspect_modbus",
    "inspect_safety": "lmctl.machine.manual.inspect_modbus",
    "jog_axes": "lmctl.machine.manual.jog",
    "open_motion": "lmctl.machine.manual.controller",
    "read_motion": "lmctl.machine.manual.inspect_motion",
    "read_setting": "lmctl.machine.manual.settings_file",
    "run_clear_offsets": "lmctl.machine.manual.homing",
    "same_value": "lmctl.machine.manual.settings_file",
    "set_work_offset": "lmctl.machine.manual.homing",
    "settings_in": "lmctl.machine.manual.settings_file",
    "unlock_controller": "lmctl.machine.manual.homing",
    "write_settings": "lmctl.machine.manual.settings_file",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
