"""The safety-input device and its laser-enable output."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.machine.safety.driver import SafetyDriver as SafetyDriver
    from lmctl.machine.safety.identity import check_serial_line as check_serial_line
    from lmctl.machine.safety.identity import describe_device as describe_device
    from lmctl.machine.safety.identity import identify_safety_device as identify_safety_device
    from lmctl.machine.safety.status import SafetyCallbacks as SafetyCallbacks
    from lmctl.machine.safety.status import SafetyStatus as SafetyStatus
    from lmctl.machine.safety.status import read_safety_status as read_safety_status

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "SafetyCallbacks": "lmctl.machine.safety.status",
    "SafetyDriver": "lmctl.machine.safety.driver",
    "SafetyStatus": "lmctl.machine.safety.status",
    "check_serial_line": "lmctl.machine.safety.identity",
    "describe_device": "lmctl.machine.safety.identity",
    "identify_safety_device": "lmctl.machine.safety.identity",
    "read_safety_status": "lmctl.machine.safety.status",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
