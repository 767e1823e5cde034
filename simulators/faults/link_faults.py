"""Implements the faults of a link as filters on the link of a device."""

from __future__ import annotations

import math
from collections.abc import Callable

from simulators.faults.fault_context import FaultContext, Undo, both
from simulators.faults.filters import (
    AlterBytes,
    DelayBytes,
    ExactEcho,
    GarbledEcho,
    GarbleWord,
    ModbusExceptions,
    RepeatModbusReplies,
    RepeatOkReplies,
    StrayBytes,
)
from simulators.faults.kinds import Fault
from simulators.faults.link_tap import drop_chunk

TO_DEVICE, TO_HOST = "to_device", "to_host"


def close_link(scene: FaultContext, fault: Fault) -> Undo:
    edge = scene.link_tap(fault.device)
    edge.set_open(False)
    return lambda: edge.set_open(True)


def drop_bytes(scene: FaultContext, fault: Fault) -> None:
    _some_bytes(scene, fault, lambda byte: b"")


def duplicate_bytes(scene: FaultContext, fault: Fault) -> None:
    _some_bytes(scene, fault, lambda byte: bytes((byte, byte)))


def flip_bytes(scene: FaultContext, fault: Fault) -> None:
    mask = 1 << int(fault.numeric_parameter("bit"))
    _some_bytes(scene, fault, lambda byte: bytes((byte ^ mask,)))


def _some_bytes(scene: FaultContext, fault: Fault, changed: Callable[[int], bytes]) -> None:
    edge, direction = scene.link_tap(fault.device), str(fault.values["direction"])
    one = AlterBytes(
        changed, int(fault.numeric_parameter("count")), int(fault.numeric_parameter("every")),
        lambda: edge.remove_filter(direction, one),
    )
    edge.add_filter(direction, one)


def delay_bytes(scene: FaultContext, fault: Fault) -> Undo:
    return _late(scene, fault, str(fault.values["direction"]))


def delay_replies(scene: FaultContext, fault: Fault) -> Undo:
    return _late(scene, fault, TO_HOST)


def _late(scene: FaultContext, fault: Fault, direction: str) -> Undo:
    late = DelayBytes(fault.numeric_parameter("late_s"))
    return both(scene.apply_filters(fault.device, (direction, late)), late.release_waiting)


def echo_garbage(scene: FaultContext, fault: Fault) -> Undo:
    edge = scene.link_tap(fault.device)
    return scene.apply_filters(fault.device, (TO_DEVICE, GarbledEcho(edge.send_to_host)))


def silence_link(scene: FaultContext, fault: Fault) -> Undo:
    """The device neither receives nor answers."""
    return scene.apply_filters(
        fault.device, (TO_DEVICE, drop_chunk), (TO_HOST, drop_chunk)
    )


def drop_ok_replies(scene: FaultContext, fault: Fault) -> None:
    _some_answers(scene, fault, times=0)


def duplicate_ok_replies(scene: FaultContext, fault: Fault) -> None:
    _some_answers(scene, fault, times=2)


def _some_answers(scene: FaultContext, fault: Fault, times: int) -> None:
    edge = scene.link_tap("motion")
    one = RepeatOkReplies(times, int(fault.numeric_parameter("count")),
                          lambda: edge.remove_filter(TO_HOST, one))
    edge.add_filter(TO_HOST, one)


def garble_gcode_word(scene: FaultContext, fault: Fault) -> None:
    edge = scene.link_tap("motion")
    one = GarbleWord(str(fault.values["letter"]), fault.numeric_parameter("percent"),
                     lambda: edge.remove_filter(TO_DEVICE, one))
    edge.add_filter(TO_DEVICE, one)


def drop_modbus_replies(scene: FaultContext, fault: Fault) -> None:
    _some_replies(scene, fault, times=0)


def duplicate_modbus_replies(scene: FaultContext, fault: Fault) -> None:
    _some_replies(scene, fault, times=2)


def _some_replies(scene: FaultContext, fault: Fault, times: int) -> None:
    edge = scene.link_tap(fault.device)
    one = RepeatModbusReplies(times, int(fault.numeric_parameter("count")),
                              lambda: edge.remove_filter(TO_HOST, one))
    edge.add_filter(TO_HOST, one)


def refuse_requests(scene: FaultContext, fault: Fault) -> None:
    edge = scene.link_tap(fault.device)
    one = ModbusExceptions(
        int(fault.numeric_parameter("code")), int(fault.numeric_parameter("count")), edge.is_rtu,
        edge.send_to_host,
        lambda: edge.remove_filter(TO_DEVICE, one),
    )
    edge.add_filter(TO_DEVICE, one)


def pass_exceptions(scene: FaultContext, fault: Fault) -> Undo:
    edge = scene.link_tap(fault.device)
    one = ModbusExceptions(int(str(fault.values["code"])), math.inf, edge.is_rtu, edge.send_to_host,
                           _never)
    return scene.apply_filters(fault.device, (TO_DEVICE, one))


def make_connections_half_open(scene: FaultContext, fault: Fault) -> Undo:
    """Raises ValueError on a serial line, which has no connections."""
    edge = scene.link_tap(fault.device)
    if edge.is_rtu:
        raise ValueError(f"device {fault.device!r} is on a serial line: it has no connection")
    return edge.make_connections_half_open()


def add_stray_bytes(scene: FaultContext, fault: Fault) -> Undo:
    return scene.apply_filters(fault.device,
                               (TO_HOST, StrayBytes(int(fault.numeric_parameter("count")))))


def echo_requests(scene: FaultContext, fault: Fault) -> Undo:
    edge = scene.link_tap(fault.device)
    return scene.apply_filters(fault.device, (TO_DEVICE, ExactEcho(edge.send_to_host)))


def _never() -> None:
    """Ignore the end of a filter: a lasting fault is never spent."""
