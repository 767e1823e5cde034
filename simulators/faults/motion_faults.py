"""What the faults of the motion controller do."""

from __future__ import annotations

import random
from collections.abc import Callable

from firmware_protocol.realtime import RealtimeCommand
from simulators.faults.fault_context import FaultContext, Undo, both
from simulators.faults.filters import FreezeStatusReports
from simulators.faults.kinds import Fault
from simulators.faults.link_faults import TO_DEVICE, TO_HOST
from simulators.faults.link_tap import drop_all
from simulators.faults.report_filters import (
    GARBLINGS,
    SlowReports,
    SomeReports,
    lost,
    with_unknown_fields,
)


def reboot_controller(scene: FaultContext, fault: Fault) -> None:
    motion, edge = scene.bench.motion, scene.link_tap("motion")
    banner = motion.lose_power()
    booting = scene.apply_filters("motion", (TO_DEVICE, drop_all), (TO_HOST, drop_all))

    def ready() -> None:
        booting()
        edge.send_to_host(banner)

    scene.call_later(fault.numeric_parameter("boot_s"), ready)


def fall_silent(scene: FaultContext, fault: Fault) -> Undo:
    if fault.values["hears"]:
        return scene.apply_filters("motion", (TO_HOST, drop_all))
    return scene.apply_filters("motion", (TO_DEVICE, drop_all), (TO_HOST, drop_all))


def stall_axes(scene: FaultContext, fault: Fault) -> Undo:
    edge = scene.link_tap("motion")
    edge.set_reading(False)
    return lambda: edge.set_reading(True)


def freeze_status_reports(scene: FaultContext, fault: Fault) -> Undo:
    return scene.apply_filters("motion", (TO_HOST, FreezeStatusReports(str(fault.values["state"]))))


def garble_reports(scene: FaultContext, fault: Fault) -> Undo:
    return _some_reports(scene, fault, GARBLINGS[str(fault.values["how"])])


def lose_reports(scene: FaultContext, fault: Fault) -> Undo:
    return _some_reports(scene, fault, lost)


def _some_reports(
    scene: FaultContext, fault: Fault, changed: Callable[[bytes, random.Random], bytes]
) -> Undo:
    edge = scene.link_tap("motion")
    one = SomeReports(
        changed, fault.numeric_parameter("probability"), int(fault.numeric_parameter("count")),
        int(fault.numeric_parameter("seed")), lambda: edge.remove_filter(TO_HOST, one),
    )
    return scene.apply_filters("motion", (TO_HOST, one))


def extend_reports(scene: FaultContext, fault: Fault) -> Undo:
    return scene.apply_filters(
        "motion", (TO_HOST, SomeReports(with_unknown_fields, 1.0, 0, 0, lambda: None))
    )


def slow_reports(scene: FaultContext, fault: Fault) -> Undo:
    slow = SlowReports(fault.numeric_parameter("look_s"))
    undo = scene.apply_filters("motion", (TO_HOST, slow.to_host), (TO_DEVICE, slow.to_device))
    return both(undo, slow.flush)


def trip_limit_switch(scene: FaultContext, fault: Fault) -> None:
    scene.bench.motion.trip_limit_switch()


def exceed_soft_limit(scene: FaultContext, fault: Fault) -> None:
    scene.bench.motion.exceed_soft_limit()


def open_door(scene: FaultContext, fault: Fault) -> Undo:
    motion = scene.bench.motion
    motion.set_door(True)
    return lambda: motion.set_door(False)


def open_estop(scene: FaultContext, fault: Fault) -> Undo:
    motion = scene.bench.motion
    motion.set_estop(True)
    return lambda: motion.set_estop(False)


def press_hold(scene: FaultContext, fault: Fault) -> None:
    scene.bench.motion.press(RealtimeCommand.HOLD)


def press_start(scene: FaultContext, fault: Fault) -> None:
    scene.bench.motion.press(RealtimeCommand.START)


def turn_overrides(scene: FaultContext, fault: Fault) -> None:
    feed, rapid, beam = (int(fault.numeric_parameter(name)) for name in ("feed", "rapid", "beam"))
    scene.bench.motion.set_overrides(feed, rapid, beam)
