"""Modbus TCP and RTU, over pymodbus."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.machine.modbus.client import ModbusExceptionError as ModbusExceptionError
    from lmctl.machine.modbus.client import ModbusLink as ModbusLink
    from lmctl.machine.modbus.client import NoReplyError as NoReplyError
    from lmctl.machine.modbus.endpoint import RtuEndpoint as RtuEndpoint
    from lmctl.machine.modbus.endpoint import parse_modbus_endpoint as parse_modbus_endpoint
    from lmctl.machine.modbus.framing import RtuFraming as RtuFraming
    from lmctl.machine.modbus.framing import SentRequest as SentRequest
    from lmctl.machine.modbus.observation import WireObservation as WireObservation
    from lmctl.machine.modbus.patience import Patience as Patience
    from lmctl.machine.modbus.patience import repeated as repeated
    from lmctl.machine.modbus.word_order import counted_order as counted_order
    from lmctl.machine.modbus.word_order import wrong_base_hint as wrong_base_hint

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "ModbusExceptionError": "lmctl.machine.modbus.client",
    "ModbusLink": "lmctl.machine.modbus.client",
    "NoReplyError": "lmctl.machine.modbus.client",
    "Patience": "lmctl.machine.modbus.patience",
    "RtuEndpoint": "lmctl.machine.modbus.endpoint",
    "RtuFraming": "lmctl.machine.modbus.framing",
    "SentRequest": "lmctl.machine.modbus.framing",
    "WireObservation": "lmctl.machine.modbus.observation",
    "counted_order": "lmctl.machine.modbus.word_order",
    "parse_modbus_endpoint": "lmctl.machine.modbus.endpoint",
    "repeated": "lmctl.machine.modbus.patience",
    "wrong_base_hint": "lmctl.machine.modbus.word_order",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
