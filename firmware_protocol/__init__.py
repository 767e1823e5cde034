"""Both ends of the motion protocol and the register maps; standard library only."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from firmware_protocol.catch_scale import ScaleStatusBits as ScaleStatusBits
    from firmware_protocol.device import GrblDevice as GrblDevice
    from firmware_protocol.dialect import Dialect as Dialect
    from firmware_protocol.dialect import ErrorPolicy as ErrorPolicy
    from firmware_protocol.gcode import GcodeError as GcodeError
    from firmware_protocol.host import ControllerRestarted as ControllerRestarted
    from firmware_protocol.host import GrblHost as GrblHost
    from firmware_protocol.host import HostEvent as HostEvent
    from firmware_protocol.host import LineRejected as LineRejected
    from firmware_protocol.host import LocalProtocolError as LocalProtocolError
    from firmware_protocol.host import RemoteProtocolError as RemoteProtocolError
    from firmware_protocol.messages import AlarmMessage as AlarmMessage
    from firmware_protocol.messages import ErrorReply as ErrorReply
    from firmware_protocol.messages import FeedbackMessage as FeedbackMessage
    from firmware_protocol.messages import Message as Message
    from firmware_protocol.messages import SettingMessage as SettingMessage
    from firmware_protocol.messages import StartupBlockSetting as StartupBlockSetting
    from firmware_protocol.messages import StatusMessage as StatusMessage
    from firmware_protocol.messages import UnknownMessage as UnknownMessage
    from firmware_protocol.messages import WelcomeBanner as WelcomeBanner
    from firmware_protocol.pmx import FeederCommandBits as FeederCommandBits
    from firmware_protocol.pmx import FeederMode as FeederMode
    from firmware_protocol.pmx import FeederStateCode as FeederStateCode
    from firmware_protocol.pmx import FeederStatusBits as FeederStatusBits
    from firmware_protocol.pmx import HopperStatusBits as HopperStatusBits
    from firmware_protocol.pmx import SetpointMode as SetpointMode
    from firmware_protocol.pmx import WatchdogAction as WatchdogAction
    from firmware_protocol.pmx import WriteRefusalCode as WriteRefusalCode
    from firmware_protocol.pmx_alarms import FeederAlarm as FeederAlarm
    from firmware_protocol.realtime import RealtimeCommand as RealtimeCommand
    from firmware_protocol.safety_io import FirstOutCause as FirstOutCause
    from firmware_protocol.safety_io import SafetyInputBits as SafetyInputBits
    from firmware_protocol.safety_io import SafetyStatusBits as SafetyStatusBits
    from firmware_protocol.status import StatusReport as StatusReport

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "AlarmMessage": "firmware_protocol.messages",
    "ControllerRestarted": "firmware_protocol.host",
    "Dialect": "firmware_protocol.dialect",
    "ErrorPolicy": "firmware_protocol.dialect",
    "ErrorReply": "firmware_protocol.messages",
    "FeedbackMessage": "firmware_protocol.messages",
    "FeederAlarm": "firmware_protocol.pmx_alarms",
    "FeederCommandBits": "firmware_protocol.pmx",
    "FeederMode": "firmware_protocol.pmx",
    "FeederStateCode": "firmware_protocol.pmx",
    "FeederStatusBits": "firmware_protocol.pmx",
    "FirstOutCause": "firmware_protocol.safety_io",
    "GcodeError": "firmware_protocol.gcode",
    "GrblDevice": "firmware_protocol.device",
    "GrblHost": "firmware_protocol.host",
    "HopperStatusBits": "firmware_protocol.pmx",
    "HostEvent": "firmware_protocol.host",
    "LineRejected": "firmware_protocol.host",
    "LocalProtocolError": "firmware_protocol.host",
    "Message": "firmware_protocol.messages",
    "RealtimeCommand": "firmware_protocol.realtime",
    "RemoteProtocolError": "firmware_protocol.host",
    "SafetyInputBits": "firmware_protocol.safety_io",
    "SafetyStatusBits": "firmware_protocol.safety_io",
    "ScaleStatusBits": "firmware_protocol.catch_scale",
    "SetpointMode": "firmware_protocol.pmx",
    "SettingMessage": "firmware_protocol.messages",
    "StartupBlockSetting": "firmware_protocol.messages",
    "StatusMessage": "firmware_protocol.messages",
    "StatusReport": "firmware_protocol.status",
    "UnknownMessage": "firmware_protocol.messages",
    "WatchdogAction": "firmware_protocol.pmx",
    "WelcomeBanner": "firmware_protocol.messages",
    "WriteRefusalCode": "firmware_protocol.pmx",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
