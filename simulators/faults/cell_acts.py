"""What the faults of the safety device, and of the cell as a whole, do."""

from __future__ import annotations

from simulators.faults import feeder_acts, motion_acts
from simulators.faults.kinds import Fault
from simulators.faults.scene import Scene, Undo, both


def lower_shield_gas(scene: Scene, fault: Fault) -> Undo:
    safety = scene.safety()
    safety.set_shield_gas(fault.number("flow_L_min"))
    return lambda: safety.set_shield_gas(safety.config.shield_gas_L_min)


def fail_chiller(scene: Scene, fault: Fault) -> Undo:
    safety = scene.safety()
    safety.set_chiller(fault.number("temperature_C"), fault.number("flow_L_min"))
    return lambda: safety.set_chiller(safety.config.chiller_C, safety.config.chiller_L_min)


def raise_oxygen(scene: Scene, fault: Fault) -> Undo:
    safety = scene.safety()
    safety.set_oxygen(fault.number("ppm"))
    return lambda: safety.set_oxygen(safety.config.oxygen_ppm)


def invalidate_analyser(scene: Scene, fault: Fault) -> Undo:
    safety = scene.safety()
    safety.invalidate_analyser(True)
    return lambda: safety.invalidate_analyser(False)


def lower_extraction(scene: Scene, fault: Fault) -> Undo:
    safety = scene.safety()
    safety.set_extraction(int(fault.number("pressure_Pa")))
    return lambda: safety.set_extraction(round(safety.config.extraction_Pa))


def freeze_safety(scene: Scene, fault: Fault) -> Undo:
    safety = scene.safety()
    safety.freeze(True)
    return lambda: safety.freeze(False)


def restart_safety(scene: Scene, fault: Fault) -> None:
    scene.safety().restart()


def stick_laser_enable(scene: Scene, fault: Fault) -> Undo:
    safety = scene.safety()
    if fault.values["contact"] == "closed":
        safety.weld_output()
    else:
        safety.stick_output()
    return lambda: safety.stick_output(False)


def drop_laser_enable(scene: Scene, fault: Fault) -> None:
    scene.safety().drop_output()


def press_estop(scene: Scene, fault: Fault) -> Undo:
    """The chain opens for everyone; where there is a safety device, its wires carry that on."""
    if scene.bench.safety is not None:
        safety = scene.bench.safety
        safety.open_estop_chain(True)
        return lambda: safety.open_estop_chain(False)
    undo = [motion_acts.open_estop(scene, fault)]
    for feeder in scene.bench.feeders.values():
        undo.append(feeder_acts.open_chain(feeder))
    return both(*undo)


def open_door(scene: Scene, fault: Fault) -> Undo:
    """The door of the cell; where there is a safety device, its wires carry that on."""
    if scene.bench.safety is not None:
        safety = scene.bench.safety
        safety.open_door(True)
        return lambda: safety.open_door(False)
    return motion_acts.open_door(scene, fault)


def kill_host(scene: Scene, fault: Fault) -> None:
    if scene.on_host_killed is not None:
        scene.on_host_killed()
