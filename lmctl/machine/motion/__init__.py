"""The motion controller, over a byte link."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.machine.motion.callbacks import ConnectionCallbacks as ConnectionCallbacks
    from lmctl.machine.motion.connection import GrblConnection as GrblConnection
    from lmctl.machine.motion.driver import MotionDriver as MotionDriver
    from lmctl.machine.motion.endpoint import MotionEndpoint as MotionEndpoint
    from lmctl.machine.motion.endpoint import parse_motion_endpoint as parse_motion_endpoint
    from lmctl.machine.motion.handshake import first_report as first_report
    from lmctl.machine.motion.handshake import query_homed as query_homed
    from lmctl.machine.motion.handshake import query_identity as query_identity
    from lmctl.machine.motion.identity import ControllerIdentity as ControllerIdentity
    from lmctl.machine.motion.identity import is_homing_enabled as is_homing_enabled
    from lmctl.machine.motion.identity import parse_settings as parse_settings
    from lmctl.machine.motion.identity import parse_work_offset as parse_work_offset
    from lmctl.machine.motion.identity import unsuitable_settings as unsuitable_settings

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "ConnectionCallbacks": "lmctl.machine.motion.callbacks",
    "ControllerIdentity": "lmctl.machine.motion.identity",
    "GrblConnection": "lmctl.machine.motion.connection",
    "MotionDriver": "lmctl.machine.motion.driver",
    "MotionEndpoint": "lmctl.machine.motion.endpoint",
    "first_report": "lmctl.machine.motion.handshake",
    "is_homing_enabled": "lmctl.machine.motion.identity",
    "parse_motion_endpoint": "lmctl.machine.motion.endpoint",
    "parse_settings": "lmctl.machine.motion.identity",
    "parse_work_offset": "lmctl.machine.motion.identity",
    "query_homed": "lmctl.machine.motion.handshake",
    "query_identity": "lmctl.machine.motion.handshake",
    "unsuitable_settings": "lmctl.machine.motion.identity",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
