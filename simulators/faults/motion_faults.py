"""Implements the faults of the motion controller."""

from __future__ import annotations

import random
from collections.abc import Callable

from firmware_protocol.realtime import RealtimeCommand
from simulators.faults.fault_context import FaultContext, Undo, both
from simulators.faults.filters import FreezeStatusReports
from simulators.faults.kinds import Fault
from simulators.faults.link_faults import TO_DEVICE, TO_HOST
from simulators.faults.link_tap import drop_chunk
from simulators.faults.report_filters import (
    GARBLINGS,
    AlterStatusReports,
    DelayStatusReports,
    dropped_report,
    report_with_unknown_fields,
)


def reboot_controller(scene: FaultContext, fault: Fault) -> None:
    motion, edge = scene.bench.motion, scene.link_tap("motion")
    banner = motion.lose_power()
    booting = scene.apply_filters("motion", (TO_DEVICE, drop_chunk), (TO_HOST, drop_chunk))

    def ready() -> None:
        booting()
        edge.send_to_host(banner)

    scene.call_later(fault.numeric_parameter("boot_s"), ready)


def silence_controller(scene: FaultContext, fault: Fault) -> Undo:
    if fault.values["receives"]:
        return scene.apply_filters("motion", (TO_HOST, drop_chunk))
    return scene.apply_filters("motion", (TO_DEVICE, drop_chunk), (TO_HOST, drop_chunk))


def stall_axes(scene: FaultContext, fault: Fault) -> Undo:
    edge = scene.link_tap("motion")
    edge.set_reading_enabled(False)
    return lambda: edge.set_reading_enabled(True)


def freeze_status_reports(scene: FaultContext, fault: Fault) -> Undo:
    return scene.apply_filters("motion", (TO_HOST, FreezeStatusReports(str(fault.values["state"]))))


def garble_status_reports(scene: FaultContext, fault: Fault) -> Undo:
    return _some_reports(scene, fault, GARBLINGS[str(fault.values["how"])])


def drop_status_reports(scene: FaultContext, fault: Fault) -> Undo:
    return _some_reports(scene, fault, dropped_report)


def _some_reports(
    scene: FaultContext, fault: Fault, changed: Callable[[bytes, random.Random], bytes]
) -> Undo:
    edge = scene.link_tap("motion")
    one = AlterStatusReports(
        changed, fault.numeric_parameter("probability"), int(fault.numeric_parameter("count")),
        int(fault.numeric_parameter("seed")), lambda: edge.remove_filter(TO_HOST, one),
    )
    return scene.apply_filters("motion", (TO_HOST, one))


def add_unknown_report_fields(scene: FaultContext, fault: Fault) -> Undo:
    return scene.apply_filters(
        "motion", (TO_HOST, AlterStatusReports(report_with_unknown_fields, 1.0, 0, 0, lambda: None))
    )


def delay_status_reports(scene: FaultContext, fault: Fault) -> Undo:
    slow = DelayStatusReports(fault.numeric_parameter("look_s"))
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


def press_hold_at_panel(scene: FaultContext, fault: Fault) -> None:
    scene.bench.motion.press_button(RealtimeCommand.HOLD)


def press_start_at_panel(scene: FaultContext, fault: Fault) -> None:
    scene.bench.motion.press_button(RealtimeCommand.START)


def change_overrides_at_panel(scene: FaultContext, fault: Fault) -> None:
    feed, rapid, beam = (int(fault.numeric_parameter(name)) for name in ("feed", "rapid", "beam"))
    scene.bench.motion.set_overrides(feed, rapid, beam)
