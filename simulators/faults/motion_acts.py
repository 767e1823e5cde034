"""What the faults of the motion controller do."""

from __future__ import annotations

import random
from collections.abc import Callable

from firmware_protocol.realtime import Realtime
from simulators.faults.edge import nothing_passes
from simulators.faults.filters import FrozenReports
from simulators.faults.kinds import Fault
from simulators.faults.link_acts import TO_DEVICE, TO_HOST
from simulators.faults.report_filters import (
    GARBLINGS,
    SlowReports,
    SomeReports,
    lost,
    with_unknown_fields,
)
from simulators.faults.scene import Scene, Undo, both


def reboot(scene: Scene, fault: Fault) -> None:
    motion, edge = scene.bench.motion, scene.edge("motion")
    banner = motion.lose_power()
    booting = scene.befall("motion", (TO_DEVICE, nothing_passes), (TO_HOST, nothing_passes))

    def ready() -> None:
        booting()
        edge.say(banner)

    scene.later(fault.number("boot_s"), ready)


def fall_silent(scene: Scene, fault: Fault) -> Undo:
    if fault.values["hears"]:
        return scene.befall("motion", (TO_HOST, nothing_passes))
    return scene.befall("motion", (TO_DEVICE, nothing_passes), (TO_HOST, nothing_passes))


def stall(scene: Scene, fault: Fault) -> Undo:
    edge = scene.edge("motion")
    edge.read(False)
    return lambda: edge.read(True)


def lie(scene: Scene, fault: Fault) -> Undo:
    return scene.befall("motion", (TO_HOST, FrozenReports(str(fault.values["state"]))))


def garble_reports(scene: Scene, fault: Fault) -> Undo:
    return _some_reports(scene, fault, GARBLINGS[str(fault.values["how"])])


def lose_reports(scene: Scene, fault: Fault) -> Undo:
    return _some_reports(scene, fault, lost)


def _some_reports(
    scene: Scene, fault: Fault, changed: Callable[[bytes, random.Random], bytes]
) -> Undo:
    edge = scene.edge("motion")
    one = SomeReports(
        changed, fault.number("probability"), int(fault.number("count")),
        int(fault.number("seed")), lambda: edge.take(TO_HOST, one),
    )
    return scene.befall("motion", (TO_HOST, one))


def extend_reports(scene: Scene, fault: Fault) -> Undo:
    return scene.befall(
        "motion", (TO_HOST, SomeReports(with_unknown_fields, 1.0, 0, 0, lambda: None))
    )


def slow_reports(scene: Scene, fault: Fault) -> Undo:
    slow = SlowReports(fault.number("look_s"))
    undo = scene.befall("motion", (TO_HOST, slow.to_host), (TO_DEVICE, slow.to_device))
    return both(undo, slow.flush)


def meet_limit_switch(scene: Scene, fault: Fault) -> None:
    scene.bench.motion.meet_limit_switch()


def leave_travel(scene: Scene, fault: Fault) -> None:
    scene.bench.motion.leave_travel()


def open_door(scene: Scene, fault: Fault) -> Undo:
    motion = scene.bench.motion
    motion.set_door(True)
    return lambda: motion.set_door(False)


def open_estop(scene: Scene, fault: Fault) -> Undo:
    motion = scene.bench.motion
    motion.set_estop(True)
    return lambda: motion.set_estop(False)


def press_hold(scene: Scene, fault: Fault) -> None:
    scene.bench.motion.press(Realtime.HOLD)


def press_start(scene: Scene, fault: Fault) -> None:
    scene.bench.motion.press(Realtime.START)


def turn_overrides(scene: Scene, fault: Fault) -> None:
    feed, rapid, beam = (int(fault.number(name)) for name in ("feed", "rapid", "beam"))
    scene.bench.motion.set_overrides(feed, rapid, beam)
