"""Search for a device that does not answer: other device ids, other line settings.

A device that does not understand a request, or is not meant by it, stays silent, so that a wrong
id, a wrong baud rate and a dead cable look the same until something else is asked. One register is
read; nothing is written.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from pymodbus.pdu.register_message import ReadHoldingRegistersRequest

from lmctl.config.modbus_device import ModbusDevice
from lmctl.machine.modbus.endpoint import RtuEndpoint, TcpEndpoint, parse_modbus_endpoint
from lmctl.machine.modbus.wire import ModbusWire

#: Ids that devices commonly have, the factory's own first; 255 is a TCP device's own.
_IDS = (*range(1, 33), 247)
_TCP_IDS = (*range(1, 17), 255)
_BAUDS = (9_600, 19_200, 38_400, 57_600, 115_200)

#: Longest time a device takes to answer, without the time of its bytes on the wire [s].
_TURNAROUND_S = 0.05
_NETWORK_S = 0.2
_REQUEST_CHARACTERS = 8 + 7 + 7  # with its answer, and the silences around them


class ProbeFinding(NamedTuple):
    """What answered instead, and the key of the profile to correct."""

    sentence: str
    hint: str


async def probe_other_settings(device: ModbusDevice) -> ProbeFinding | None:
    """What answers at a device's endpoint, or at other settings of its line; None without answer.

    Takes five seconds at most. Raises ConfigError for a bad endpoint.
    """
    where = parse_modbus_endpoint(device.endpoint)
    ids = _IDS if isinstance(where, RtuEndpoint) else _TCP_IDS
    found = await _first_to_answer(where, [one for one in ids if one != device.device_id])
    if found is not None:
        return ProbeFinding(
            f"device id {found} answers there, and id {device.device_id} was asked",
            f"write device_id = {found} into the machine profile if that is the device",
        )
    for other in _other_lines(where):
        if await _first_to_answer(other, [device.device_id]) is not None:
            return ProbeFinding(
                f"it answers at {other.baud} baud, parity {other.parity}",
                f"write ?baud={other.baud}&parity={other.parity} behind its endpoint",
            )
    return None


def _other_lines(where: TcpEndpoint | RtuEndpoint) -> Iterator[RtuEndpoint]:
    if not isinstance(where, RtuEndpoint):
        return
    for parity in (where.parity, "N" if where.parity == "E" else "E"):  # a rate is wrong more often
        for baud in _BAUDS:
            if (baud, parity) != (where.baud, where.parity):
                yield replace(where, baud=baud, parity=parity)


async def _first_to_answer(where: TcpEndpoint | RtuEndpoint, ids: list[int]) -> int | None:
    """The first of these ids that answers at all, an exception included."""
    timeout_s = _NETWORK_S
    if isinstance(where, RtuEndpoint):
        timeout_s = _TURNAROUND_S + _REQUEST_CHARACTERS * where.character_s
    wire = ModbusWire(where, ids[0] if ids else 1, timeout_s, reopens=False)
    try:
        if not await wire.connect():
            return None
        for device_id in ids:
            try:
                await wire.send_request(ReadHoldingRegistersRequest(dev_id=device_id, address=0,
                                                                    count=1), 4)
            except OSError:  # TimeoutError is one
                continue
            return device_id
        return None
    except Exception:  # pyserial lets termios.error and others through
        return None
    finally:
        wire.close()
