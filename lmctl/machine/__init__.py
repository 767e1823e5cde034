"""Drivers: motion over a byte link, feeders over Modbus. They know no job and no geometry."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.machine.feeder.driver import FeederDriver as FeederDriver
    from lmctl.machine.feeder.identity import FeederIdentity as FeederIdentity
    from lmctl.machine.feeder.readings import HopperReading as HopperReading
    from lmctl.machine.feeder.recipe import post_flow_duration_s as post_flow_duration_s
    from lmctl.machine.feeder.recipe import settling_time_s as settling_time_s
    from lmctl.machine.feeder.status import FeederCallbacks as FeederCallbacks
    from lmctl.machine.feeder.status import FeederStatus as FeederStatus
    from lmctl.machine.feeder.warnings import FeederWarning as FeederWarning
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
    from lmctl.machine.modbus.endpoint import RtuEndpoint as RtuEndpoint
    from lmctl.machine.modbus.endpoint import parse_modbus_endpoint as parse_modbus_endpoint
    from lmctl.machine.motion.driver import MotionDriver as MotionDriver
    from lmctl.machine.motion.endpoint import MotionEndpoint as MotionEndpoint
    from lmctl.machine.motion.endpoint import parse_motion_endpoint as parse_motion_endpoint
    from lmctl.machine.motion.identity import ControllerIdentity as ControllerIdentity
    from lmctl.machine.motion.identity import is_homing_enabled as is_homing_enabled
    from lmctl.machine.motion.identity import parse_work_offset as parse_work_offset
    from lmctl.machine.motion.identity import unsuitable_settings as unsuitable_settings
    from lmctl.machine.safety.driver import SafetyDriver as SafetyDriver
    from lmctl.machine.safety.identity import check_serial_line as check_serial_line
    from lmctl.machine.safety.status import SafetyCallbacks as SafetyCallbacks
    from lmctl.machine.safety.status import SafetyStatus as SafetyStatus
    from lmctl.machine.timer_wheel import align_to_tick as align_to_tick

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "ControllerIdentity": "lmctl.machine.motion.identity",
    "FeederCallbacks": "lmctl.machine.feeder.status",
    "FeederDriver": "lmctl.machine.feeder.driver",
    "FeederIdentity": "lmctl.machine.feeder.identity",
    "FeederInspection": "lmctl.machine.manual.inspect_modbus",
    "FeederStatus": "lmctl.machine.feeder.status",
    "FeederWarning": "lmctl.machine.feeder.warnings",
    "HopperReading": "lmctl.machine.feeder.readings",
    "JogRequest": "lmctl.machine.manual.jog",
    "MotionDriver": "lmctl.machine.motion.driver",
    "MotionEndpoint": "lmctl.machine.motion.endpoint",
    "MotionReading": "lmctl.machine.manual.inspect_motion",
    "RtuEndpoint": "lmctl.machine.modbus.endpoint",
    "SafetyCallbacks": "lmctl.machine.safety.status",
    "SafetyDriver": "lmctl.machine.safety.driver",
    "SafetyStatus": "lmctl.machine.safety.status",
    "WrittenSettings": "lmctl.machine.manual.settings",
    "align_to_tick": "lmctl.machine.timer_wheel",
    "apply_settings": "lmctl.machine.manual.settings",
    "check_serial_line": "lmctl.machine.safety.identity",
    "clear_work_offsets": "lmctl.machine.manual.homing",
    "describe_homing": "lmctl.machine.manual.homing",
    "find_baud_rate": "lmctl.machine.manual.rate_search",
    "home_axes": "lmctl.machine.manual.homing",
    "inspect_controller": "lmctl.machine.manual.inspect_motion",
    "inspect_feeder": "lmctl.machine.manual.inspect_modbus",
    "inspect_safety": "lmctl.machine.manual.inspect_modbus",
    "is_homing_enabled": "lmctl.machine.motion.identity",
    "is_same_value": "lmctl.machine.manual.settings_file",
    "jog_axes": "lmctl.machine.manual.jog",
    "open_motion_controller": "lmctl.machine.manual.controller",
    "parse_modbus_endpoint": "lmctl.machine.modbus.endpoint",
    "parse_motion_endpoint": "lmctl.machine.motion.endpoint",
    "parse_setting": "lmctl.machine.manual.settings_file",
    "parse_work_offset": "lmctl.machine.motion.identity",
    "post_flow_duration_s": "lmctl.machine.feeder.recipe",
    "read_motion": "lmctl.machine.manual.inspect_motion",
    "read_settings_file": "lmctl.machine.manual.settings_file",
    "set_work_offset": "lmctl.machine.manual.homing",
    "settling_time_s": "lmctl.machine.feeder.recipe",
    "unlock_controller": "lmctl.machine.manual.homing",
    "unsuitable_settings": "lmctl.machine.motion.identity",
    "write_settings_file": "lmctl.machine.manual.settings_file",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
