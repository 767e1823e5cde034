"""Modbus TCP and RTU, over pymodbus."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.machine.modbus.client import ModbusExceptionError as ModbusExceptionError
    from lmctl.machine.modbus.client import ModbusLink as ModbusLink
    from lmctl.machine.modbus.client import NoReplyError as NoReplyError
    from lmctl.machine.modbus.client import PassingExceptionError as PassingExceptionError
    from lmctl.machine.modbus.endpoint import RtuEndpoint as RtuEndpoint
    from lmctl.machine.modbus.endpoint import parse_modbus_endpoint as parse_modbus_endpoint
    from lmctl.machine.modbus.observation import WireObservation as WireObservation
    from lmctl.machine.modbus.opening_retries import OpeningRetries as OpeningRetries
    from lmctl.machine.modbus.opening_retries import answer_with_retries as answer_with_retries
    from lmctl.machine.modbus.probe import probe_other_settings as probe_other_settings
    from lmctl.machine.modbus.word_order import address_base_hint as address_base_hint
    from lmctl.machine.modbus.word_order import detect_word_order as detect_word_order

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "ModbusExceptionError": "lmctl.machine.modbus.client",
    "ModbusLink": "lmctl.machine.modbus.client",
    "NoReplyError": "lmctl.machine.modbus.client",
    "OpeningRetries": "lmctl.machine.modbus.opening_retries",
    "PassingExceptionError": "lmctl.machine.modbus.client",
    "RtuEndpoint": "lmctl.machine.modbus.endpoint",
    "WireObservation": "lmctl.machine.modbus.observation",
    "address_base_hint": "lmctl.machine.modbus.word_order",
    "answer_with_retries": "lmctl.machine.modbus.opening_retries",
    "detect_word_order": "lmctl.machine.modbus.word_order",
    "parse_modbus_endpoint": "lmctl.machine.modbus.endpoint",
    "probe_other_settings": "lmctl.machine.modbus.probe",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
