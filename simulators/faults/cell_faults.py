"""Implements the faults of the safety device and of the whole cell."""

from __future__ import annotations

from simulators.faults import feeder_faults, motion_faults
from simulators.faults.fault_context import FaultContext, Undo, both
from simulators.faults.kinds import Fault


def lower_shield_gas(scene: FaultContext, fault: Fault) -> Undo:
    safety = scene.safety()
    safety.set_shield_gas(fault.numeric_parameter("flow_L_min"))
    return lambda: safety.set_shield_gas(safety.config.shield_gas_L_min)


def fail_chiller(scene: FaultContext, fault: Fault) -> Undo:
    safety = scene.safety()
    safety.set_chiller(fault.numeric_parameter("temperature_C"),
                       fault.numeric_parameter("flow_L_min"))
    return lambda: safety.set_chiller(safety.config.chiller_C, safety.config.chiller_L_min)


def raise_oxygen(scene: FaultContext, fault: Fault) -> Undo:
    safety = scene.safety()
    safety.set_oxygen(fault.numeric_parameter("ppm"))
    return lambda: safety.set_oxygen(safety.config.oxygen_ppm)


def invalidate_analyser(scene: FaultContext, fault: Fault) -> Undo:
    safety = scene.safety()
    safety.set_analyser_invalid(True)
    return lambda: safety.set_analyser_invalid(False)


def lower_extraction(scene: FaultContext, fault: Fault) -> Undo:
    safety = scene.safety()
    safety.set_extraction(int(fault.numeric_parameter("pressure_Pa")))
    return lambda: safety.set_extraction(round(safety.config.extraction_Pa))


def freeze_safety_device(scene: FaultContext, fault: Fault) -> Undo:
    safety = scene.safety()
    safety.set_frozen(True)
    return lambda: safety.set_frozen(False)


def restart_safety_device(scene: FaultContext, fault: Fault) -> None:
    scene.safety().restart()


def stick_laser_enable(scene: FaultContext, fault: Fault) -> Undo:
    safety = scene.safety()
    if fault.values["contact"] == "closed":
        safety.weld_output()
    else:
        safety.set_output_stuck()
    return lambda: safety.set_output_stuck(False)


def drop_laser_enable(scene: FaultContext, fault: Fault) -> None:
    scene.safety().drop_output()


def press_estop(scene: FaultContext, fault: Fault) -> Undo:
    """Open every e-stop chain; if there is a safety device, its wiring passes this on."""
    if scene.bench.safety is not None:
        safety = scene.bench.safety
        safety.set_estop_open(True)
        return lambda: safety.set_estop_open(False)
    undo = [motion_faults.open_estop(scene, fault)]
    for feeder in scene.bench.feeders.values():
        undo.append(feeder_faults.open_estop_chain(feeder))
    return both(*undo)


def open_door(scene: FaultContext, fault: Fault) -> Undo:
    """Open the cell door; if there is a safety device, its wiring passes this on."""
    if scene.bench.safety is not None:
        safety = scene.bench.safety
        safety.set_door_open(True)
        return lambda: safety.set_door_open(False)
    return motion_faults.open_door(scene, fault)


def kill_host(scene: FaultContext, fault: Fault) -> None:
    if scene.on_host_killed is not None:
        scene.on_host_killed()
