"""Implements the faults of a feeder and its hoppers."""

from __future__ import annotations

from firmware_protocol.pmx import FeederStatusBits, HopperStatusBits, hopper_register_name
from firmware_protocol.pmx_alarms import (
    DRIFT,
    LEVEL_LOW,
    OLD_CALIBRATION,
    UNSTEADY,
    hopper_alarm_code,
)
from firmware_protocol.registers import RegisterValue
from simulators.faults.fault_context import FaultContext, Undo, both
from simulators.faults.kinds import Fault
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.injected_defects import Change, InjectedDefects
from simulators.feeder.readings import register_values

_STALLED, _DEVIATES, _CARRIER, _LID = 2, 3, 4, 6
_SUPPLY_LOW, _OVER_PRESSURE = 102, 103

_WARNS_OF = {"drift": DRIFT, "unsteady flow": UNSTEADY, "old calibration": OLD_CALIBRATION}

#: Time a device needs to detect a fault (docs/explanation/powder-delivery.md, Feeders: a deviation
#: counts after 2 s).
_NOTICES_S = {_STALLED: 0.5, _DEVIATES: 2.0, _CARRIER: 1.0, _LID: 0.0, _SUPPLY_LOW: 0.5,
              _OVER_PRESSURE: 1.0}


def restart_feeder(scene: FaultContext, fault: Fault) -> None:
    scene.feeder(fault).restart()


def switch_to_local_mode(scene: FaultContext, fault: Fault) -> Undo:
    feeder = scene.feeder(fault)
    feeder.set_local_mode(True)
    return lambda: feeder.set_local_mode(False)


def open_estop(scene: FaultContext, fault: Fault) -> Undo:
    return open_estop_chain(scene.feeder(fault))


def open_estop_chain(feeder: PmxFeederDevice) -> Undo:
    """Open the feeder's emergency-stop chain."""
    feeder.set_estop_open(True)
    return lambda: feeder.set_estop_open(False)


def trip_watchdog(scene: FaultContext, fault: Fault) -> None:
    scene.feeder(fault).trip_watchdog()


def freeze_registers(scene: FaultContext, fault: Fault) -> Undo:
    """Every register keeps reporting its present value."""
    feeder = scene.feeder(fault)
    time_s, defects = feeder.advance_to_now(), _defects(feeder)
    return both(*(
        defects.override_register(channel, name, _always(value))
        for channel in (0, *feeder.hoppers)
        for name, value in register_values(feeder, channel, time_s).items()
    ))


def report_false_flow(scene: FaultContext, fault: Fault) -> Undo:
    """Stop the discs; report speed and estimated flow as if they turned. Scales stay true."""
    feeder = scene.feeder(fault)
    defects = _defects(feeder)
    undo = [defects.override_register(
        0, "STATUS",
        _with(FeederStatusBits.FEEDING | FeederStatusBits.AT_SETPOINT | FeederStatusBits.STABLE)
    )]
    for channel in feeder.hoppers:
        undo += [
            _disturb(feeder, channel, speed=0.0),
            defects.override_register(channel, "DISC_ACT", _commanded_value(feeder, channel, 1.0)),
            defects.override_register(channel, "FLOW_EST", _commanded_value(
                feeder, channel, feeder.holding[hopper_register_name(channel, "FEED_FACTOR")]
            )),
            defects.override_register(channel, "STATUS", _with(
                HopperStatusBits.RUNNING | HopperStatusBits.AT_SETPOINT | HopperStatusBits.STABLE
            )),
        ]
    return both(*undo)


def ignore_recipes(scene: FaultContext, fault: Fault) -> Undo:
    defects = _defects(scene.feeder(fault))
    defects.ignores_recipes = True

    def undo() -> None:
        defects.ignores_recipes = False

    return undo


def lower_supply(scene: FaultContext, fault: Fault) -> Undo:
    feeder, bar = scene.feeder(fault), fault.numeric_parameter("bar")
    return both(
        _defects(feeder).override_register(0, "SUPPLY_PRESSURE", lambda _: bar),
        _noticed(scene, fault, feeder, _SUPPLY_LOW, _SUPPLY_LOW),
    )


def raise_warning(scene: FaultContext, fault: Fault) -> Undo:
    """Raise a warning for the feeder: the register map has no field for the hopper."""
    bit = 1 << _WARNS_OF[str(fault.values["of"])] - LEVEL_LOW
    defects = _defects(scene.feeder(fault))
    return both(
        defects.override_register(0, "WARNING", _with(bit)),
        defects.override_register(0, "STATUS", _with(FeederStatusBits.WARNING))
    )


def raise_pressure(scene: FaultContext, fault: Fault) -> Undo:
    feeder = scene.feeder(fault)
    return both(
        _pressure(feeder, fault),
        _noticed(scene, fault, feeder, _OVER_PRESSURE, _OVER_PRESSURE),
    )


def clog_nozzle(scene: FaultContext, fault: Fault) -> Undo:
    scene.hopper(fault)
    feeder = scene.feeder(fault)
    process, rise_s = feeder.hoppers[fault.channel].process, fault.numeric_parameter("rise_s")

    def let_through(share: float) -> None:
        process.disturb(feeder.advance_to_now(), share=share)

    if rise_s == 0.0:
        let_through(fault.numeric_parameter("share"))
    return both(
        scene.call_later(rise_s, lambda: let_through(fault.numeric_parameter("share")))
        if rise_s else both(),
        lambda: let_through(1.0),
        _pressure(feeder, fault),
        _noticed(scene, fault, feeder, _OVER_PRESSURE, _OVER_PRESSURE),
    )


def stall_disc(scene: FaultContext, fault: Fault) -> Undo:
    return _turn_otherwise(scene, fault, 0.0, _STALLED)


def turn_disc_at_wrong_speed(scene: FaultContext, fault: Fault) -> Undo:
    return _turn_otherwise(scene, fault, 1.0 + fault.numeric_parameter("percent") / 100.0,
                           _DEVIATES)


def raise_min_disc_speed(scene: FaultContext, fault: Fault) -> Undo:
    """The disc needs a higher minimum speed, and the device reports it in N_MIN."""
    hopper, feeder = scene.hopper(fault), scene.feeder(fault)
    n_min = fault.numeric_parameter("n_min_rpm")
    row = hopper_register_name(fault.channel, "N_MIN")
    known = feeder.holding.raw_word(row)
    feeder.holding.set_raw_word(row, round(n_min * 100))

    def undo() -> None:
        feeder.holding.set_raw_word(row, known)
        hopper.process.disturb(feeder.advance_to_now(), n_min_rpm=hopper.config.n_min_rpm)

    hopper.process.disturb(feeder.advance_to_now(), n_min_rpm=n_min)
    return undo


def lower_max_disc_speed(scene: FaultContext, fault: Fault) -> Undo:
    """The operator lowers the limit at the panel during a run."""
    hopper, feeder = scene.hopper(fault), scene.feeder(fault)
    feeder.set_max_disc_rpm(fault.channel, fault.numeric_parameter("n_max_rpm"))
    return lambda: feeder.set_max_disc_rpm(fault.channel, hopper.config.n_max_rpm)


def read_flow_wrong(scene: FaultContext, fault: Fault) -> Undo:
    scene.hopper(fault)
    return _scaled_register(
        scene.feeder(fault), fault.channel, "FLOW_EST",
        1.0 + fault.numeric_parameter("percent") / 100.0
    )


def empty_hopper(scene: FaultContext, fault: Fault) -> None:
    _set_left(scene, fault, 0.0)


def set_hopper_level(scene: FaultContext, fault: Fault) -> None:
    _set_left(scene, fault, fault.numeric_parameter("grams"))


def lower_carrier_gas(scene: FaultContext, fault: Fault) -> Undo:
    scene.hopper(fault)
    feeder = scene.feeder(fault)
    return both(
        _scaled_register(feeder, fault.channel, "CARRIER_ACT", fault.numeric_parameter("share")),
        _noticed(scene, fault, feeder, _CARRIER, hopper_alarm_code(fault.channel, _CARRIER)),
    )


def open_lid(scene: FaultContext, fault: Fault) -> Undo:
    scene.hopper(fault)
    feeder = scene.feeder(fault)
    defects = _defects(feeder)
    return both(
        defects.override_register(0, "STATUS", _without(FeederStatusBits.LID_CLOSED)),
        defects.override_register(fault.channel, "STATUS", _without(HopperStatusBits.LID_CLOSED)),
        _noticed(scene, fault, feeder, _LID, hopper_alarm_code(fault.channel, _LID)),
    )


def _defects(feeder: PmxFeederDevice) -> InjectedDefects:
    if feeder.defects is None:
        feeder.defects = InjectedDefects()
    return feeder.defects


def _noticed(scene: FaultContext, fault: Fault, feeder: PmxFeederDevice, number: int,
             code: int) -> Undo:
    """The device raises its alarm once it detects the fault; the cause stays until undone."""
    if not fault.values["noticed"]:
        return both()
    causes = _defects(feeder).causes
    causes.append(code)
    if _NOTICES_S[number] == 0.0:
        feeder.raise_alarm(code)
        return lambda: causes.remove(code)
    after_s = _NOTICES_S[number] + float(fault.values.get("rise_s", 0.0))
    return both(scene.call_later(after_s, lambda: feeder.raise_alarm(code)),
                lambda: causes.remove(code))


def _turn_otherwise(scene: FaultContext, fault: Fault, speed: float, number: int) -> Undo:
    scene.hopper(fault)
    feeder = scene.feeder(fault)
    return both(
        _disturb(feeder, fault.channel, speed=speed),
        _noticed(scene, fault, feeder, number, hopper_alarm_code(fault.channel, number)),
    )


def _disturb(
    feeder: PmxFeederDevice, channel: int, *, speed: float = 1.0, share: float = 1.0
) -> Undo:
    process = feeder.hoppers[channel].process
    process.disturb(feeder.advance_to_now(), speed=speed, share=share)
    return lambda: process.disturb(feeder.advance_to_now(), speed=1.0, share=1.0)


def _set_left(scene: FaultContext, fault: Fault, grams: float) -> None:
    hopper, feeder = scene.hopper(fault), scene.feeder(fault)
    hopper.process.set_remaining_g(feeder.advance_to_now(), grams)
    feeder.advance_to_now()


def _pressure(feeder: PmxFeederDevice, fault: Fault) -> Undo:
    mbar, rise_s, began_s = fault.numeric_parameter(
        "mbar"), fault.numeric_parameter("rise_s"), feeder.now()

    def risen(usual: RegisterValue) -> RegisterValue:
        assert isinstance(usual, int | float)
        share = min(1.0, (feeder.now() - began_s) / rise_s) if rise_s else 1.0
        return round(usual + share * (mbar - usual))

    return _defects(feeder).override_register(0, "MIXER_PRESSURE", risen)


def _scaled_register(feeder: PmxFeederDevice, channel: int, name: str, factor: float) -> Undo:
    def change(value: RegisterValue) -> RegisterValue:
        assert isinstance(value, int | float)
        return value * factor

    return _defects(feeder).override_register(channel, name, change)


def _always(value: RegisterValue) -> Change:
    return lambda _: value


def _commanded_value(feeder: PmxFeederDevice, channel: int, per_rpm: float) -> Change:
    """Report the speed of a disc that follows its commands, times per_rpm."""
    fault_free = feeder.hoppers[channel].fault_free_process
    return lambda _: fault_free.disc_rpm(feeder.now()) * per_rpm


def _with(flags: int) -> Change:
    return lambda value: _bits(value) | flags


def _without(flags: int) -> Change:
    return lambda value: _bits(value) & ~flags


def _bits(value: RegisterValue) -> int:
    assert isinstance(value, int)
    return value
