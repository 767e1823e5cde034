"""What the faults of a link do: filters on the edge of a device."""

from __future__ import annotations

import math
from collections.abc import Callable

from simulators.faults.edge import nothing_passes
from simulators.faults.filters import (
    Echo,
    ExactEcho,
    Exceptions,
    GarbledWord,
    Late,
    SomeAnswers,
    SomeBytes,
    SomeReplies,
    StrayBytes,
)
from simulators.faults.kinds import Fault
from simulators.faults.scene import Scene, Undo, both

TO_DEVICE, TO_HOST = "to_device", "to_host"


def close_link(scene: Scene, fault: Fault) -> Undo:
    edge = scene.edge(fault.device)
    edge.open(False)
    return lambda: edge.open(True)


def lose_bytes(scene: Scene, fault: Fault) -> None:
    _some_bytes(scene, fault, lambda byte: b"")


def double_bytes(scene: Scene, fault: Fault) -> None:
    _some_bytes(scene, fault, lambda byte: bytes((byte, byte)))


def flip_bytes(scene: Scene, fault: Fault) -> None:
    mask = 1 << int(fault.number("bit"))
    _some_bytes(scene, fault, lambda byte: bytes((byte ^ mask,)))


def _some_bytes(scene: Scene, fault: Fault, changed: Callable[[int], bytes]) -> None:
    edge, direction = scene.edge(fault.device), str(fault.values["direction"])
    one = SomeBytes(
        changed, int(fault.number("count")), int(fault.number("every")),
        lambda: edge.take(direction, one),
    )
    edge.put(direction, one)


def delay_bytes(scene: Scene, fault: Fault) -> Undo:
    return _late(scene, fault, str(fault.values["direction"]))


def delay_replies(scene: Scene, fault: Fault) -> Undo:
    return _late(scene, fault, TO_HOST)


def _late(scene: Scene, fault: Fault, direction: str) -> Undo:
    late = Late(fault.number("late_s"))
    return both(scene.befall(fault.device, (direction, late)), late.flush)


def echo_garbage(scene: Scene, fault: Fault) -> Undo:
    edge = scene.edge(fault.device)
    return scene.befall(fault.device, (TO_DEVICE, Echo(edge.say)))


def silence(scene: Scene, fault: Fault) -> Undo:
    """Neither heard nor answered."""
    return scene.befall(
        fault.device, (TO_DEVICE, nothing_passes), (TO_HOST, nothing_passes)
    )


def lose_answers(scene: Scene, fault: Fault) -> None:
    _some_answers(scene, fault, times=0)


def double_answers(scene: Scene, fault: Fault) -> None:
    _some_answers(scene, fault, times=2)


def _some_answers(scene: Scene, fault: Fault, times: int) -> None:
    edge = scene.edge("motion")
    one = SomeAnswers(times, int(fault.number("count")), lambda: edge.take(TO_HOST, one))
    edge.put(TO_HOST, one)


def garble_word(scene: Scene, fault: Fault) -> None:
    edge = scene.edge("motion")
    one = GarbledWord(str(fault.values["letter"]), fault.number("percent"),
                      lambda: edge.take(TO_DEVICE, one))
    edge.put(TO_DEVICE, one)


def drop_replies(scene: Scene, fault: Fault) -> None:
    _some_replies(scene, fault, times=0)


def double_replies(scene: Scene, fault: Fault) -> None:
    _some_replies(scene, fault, times=2)


def _some_replies(scene: Scene, fault: Fault, times: int) -> None:
    edge = scene.edge(fault.device)
    one = SomeReplies(times, int(fault.number("count")), lambda: edge.take(TO_HOST, one))
    edge.put(TO_HOST, one)


def refuse_requests(scene: Scene, fault: Fault) -> None:
    edge = scene.edge(fault.device)
    one = Exceptions(
        int(fault.number("code")), int(fault.number("count")), edge.is_rtu, edge.say,
        lambda: edge.take(TO_DEVICE, one),
    )
    edge.put(TO_DEVICE, one)


def pass_exceptions(scene: Scene, fault: Fault) -> Undo:
    edge = scene.edge(fault.device)
    one = Exceptions(int(str(fault.values["code"])), math.inf, edge.is_rtu, edge.say, _never)
    return scene.befall(fault.device, (TO_DEVICE, one))


def forget_connections(scene: Scene, fault: Fault) -> Undo:
    """Raises ValueError on a serial line, which has no connections."""
    edge = scene.edge(fault.device)
    if edge.is_rtu:
        raise ValueError(f"device {fault.device!r} is on a serial line: it has no connection")
    return edge.forget_links()


def add_stray_bytes(scene: Scene, fault: Fault) -> Undo:
    return scene.befall(fault.device, (TO_HOST, StrayBytes(int(fault.number("count")))))


def echo_requests(scene: Scene, fault: Fault) -> Undo:
    edge = scene.edge(fault.device)
    return scene.befall(fault.device, (TO_DEVICE, ExactEcho(edge.say)))


def _never() -> None:
    """What lasts is never spent."""
