"""What the faults of a feeder and its hoppers do."""

from __future__ import annotations

from firmware_protocol.pmx import HopperFlags, Status, hopper_row
from firmware_protocol.pmx_alarms import DRIFT, LEVEL_LOW, OLD_CALIBRATION, UNSTEADY, hopper_code
from firmware_protocol.registers import Value
from simulators.faults.kinds import Fault
from simulators.faults.scene import Scene, Undo, both
from simulators.feeder.device import PmxDevice
from simulators.feeder.mishaps import Change, Mishaps
from simulators.feeder.readings import readings

_STALLED, _DEVIATES, _CARRIER, _LID = 2, 3, 4, 6
_SUPPLY_LOW, _OVER_PRESSURE = 102, 103

_WARNS_OF = {"drift": DRIFT, "unsteady flow": UNSTEADY, "old calibration": OLD_CALIBRATION}

#: How long a device needs to notice (process.md 1.4: a deviation counts after 2 s).
_NOTICES_S = {_STALLED: 0.5, _DEVIATES: 2.0, _CARRIER: 1.0, _LID: 0.0, _SUPPLY_LOW: 0.5,
              _OVER_PRESSURE: 1.0}


def restart(scene: Scene, fault: Fault) -> None:
    scene.feeder(fault).restart()


def turn_local(scene: Scene, fault: Fault) -> Undo:
    feeder = scene.feeder(fault)
    feeder.turn_local(True)
    return lambda: feeder.turn_local(False)


def open_estop(scene: Scene, fault: Fault) -> Undo:
    return open_chain(scene.feeder(fault))


def open_chain(feeder: PmxDevice) -> Undo:
    """Its emergency-stop chain."""
    feeder.open_estop_chain(True)
    return lambda: feeder.open_estop_chain(False)


def trip_watchdog(scene: Scene, fault: Fault) -> None:
    scene.feeder(fault).trip_watchdog()


def freeze(scene: Scene, fault: Fault) -> Undo:
    """Every register tells for ever what it told now."""
    feeder = scene.feeder(fault)
    time_s, mishaps = feeder.settle(), _mishaps(feeder)
    return both(*(
        mishaps.tell(channel, name, _always(value))
        for channel in (0, *feeder.hoppers)
        for name, value in readings(feeder, channel, time_s).items()
    ))


def lie(scene: Scene, fault: Fault) -> Undo:
    """Discs stand; speed and estimated flow are told as if they turned. Scales tell the truth."""
    feeder = scene.feeder(fault)
    mishaps = _mishaps(feeder)
    undo = [mishaps.tell(
        0, "STATUS", _with(Status.FEEDING | Status.AT_SETPOINT | Status.STABLE)
    )]
    for channel in feeder.hoppers:
        undo += [
            _disturb(feeder, channel, speed=0.0),
            mishaps.tell(channel, "DISC_ACT", _as_told(feeder, channel, 1.0)),
            mishaps.tell(channel, "FLOW_EST", _as_told(
                feeder, channel, feeder.holding[hopper_row(channel, "FEED_FACTOR")]
            )),
            mishaps.tell(channel, "STATUS", _with(
                HopperFlags.RUNNING | HopperFlags.AT_SETPOINT | HopperFlags.STABLE
            )),
        ]
    return both(*undo)


def ignore_recipes(scene: Scene, fault: Fault) -> Undo:
    mishaps = _mishaps(scene.feeder(fault))
    mishaps.ignores_recipes = True

    def undo() -> None:
        mishaps.ignores_recipes = False

    return undo


def lower_supply(scene: Scene, fault: Fault) -> Undo:
    feeder, bar = scene.feeder(fault), fault.number("bar")
    return both(
        _mishaps(feeder).tell(0, "SUPPLY_PRESSURE", lambda _: bar),
        _noticed(scene, fault, feeder, _SUPPLY_LOW, _SUPPLY_LOW),
    )


def warn(scene: Scene, fault: Fault) -> Undo:
    """Of whichever hopper: the map has no place to say which."""
    bit = 1 << _WARNS_OF[str(fault.values["of"])] - LEVEL_LOW
    mishaps = _mishaps(scene.feeder(fault))
    return both(
        mishaps.tell(0, "WARNING", _with(bit)), mishaps.tell(0, "STATUS", _with(Status.WARNING))
    )


def raise_pressure(scene: Scene, fault: Fault) -> Undo:
    feeder = scene.feeder(fault)
    return both(
        _pressure(feeder, fault),
        _noticed(scene, fault, feeder, _OVER_PRESSURE, _OVER_PRESSURE),
    )


def clog(scene: Scene, fault: Fault) -> Undo:
    scene.hopper(fault)
    feeder = scene.feeder(fault)
    process, rise_s = feeder.hoppers[fault.channel].process, fault.number("rise_s")

    def let_through(share: float) -> None:
        process.disturb(feeder.settle(), share=share)

    if rise_s == 0.0:
        let_through(fault.number("share"))
    return both(
        scene.later(rise_s, lambda: let_through(fault.number("share"))) if rise_s else both(),
        lambda: let_through(1.0),
        _pressure(feeder, fault),
        _noticed(scene, fault, feeder, _OVER_PRESSURE, _OVER_PRESSURE),
    )


def stall_disc(scene: Scene, fault: Fault) -> Undo:
    return _turn_otherwise(scene, fault, 0.0, _STALLED)


def turn_disc_wrong(scene: Scene, fault: Fault) -> Undo:
    return _turn_otherwise(scene, fault, 1.0 + fault.number("percent") / 100.0, _DEVIATES)


def raise_n_min(scene: Scene, fault: Fault) -> Undo:
    """The disc needs more speed, and the device knows."""
    hopper, feeder = scene.hopper(fault), scene.feeder(fault)
    n_min = fault.number("n_min_rpm")
    row = hopper_row(fault.channel, "N_MIN")
    known = feeder.holding.raw(row)
    feeder.holding.put_raw(row, round(n_min * 100))

    def undo() -> None:
        feeder.holding.put_raw(row, known)
        hopper.process.disturb(feeder.settle(), n_min_rpm=hopper.config.n_min_rpm)

    hopper.process.disturb(feeder.settle(), n_min_rpm=n_min)
    return undo


def limit_disc(scene: Scene, fault: Fault) -> Undo:
    """Somebody does so at the panel, in the middle of a run."""
    hopper, feeder = scene.hopper(fault), scene.feeder(fault)
    feeder.limit_disc(fault.channel, fault.number("n_max_rpm"))
    return lambda: feeder.limit_disc(fault.channel, hopper.config.n_max_rpm)


def read_flow_wrong(scene: Scene, fault: Fault) -> Undo:
    scene.hopper(fault)
    return _told_times(
        scene.feeder(fault), fault.channel, "FLOW_EST", 1.0 + fault.number("percent") / 100.0
    )


def empty_hopper(scene: Scene, fault: Fault) -> None:
    _set_left(scene, fault, 0.0)


def set_level(scene: Scene, fault: Fault) -> None:
    _set_left(scene, fault, fault.number("grams"))


def lower_carrier(scene: Scene, fault: Fault) -> Undo:
    scene.hopper(fault)
    feeder = scene.feeder(fault)
    return both(
        _told_times(feeder, fault.channel, "CARRIER_ACT", fault.number("share")),
        _noticed(scene, fault, feeder, _CARRIER, hopper_code(fault.channel, _CARRIER)),
    )


def open_lid(scene: Scene, fault: Fault) -> Undo:
    scene.hopper(fault)
    feeder = scene.feeder(fault)
    mishaps = _mishaps(feeder)
    return both(
        mishaps.tell(0, "STATUS", _without(Status.LID_CLOSED)),
        mishaps.tell(fault.channel, "STATUS", _without(HopperFlags.LID_CLOSED)),
        _noticed(scene, fault, feeder, _LID, hopper_code(fault.channel, _LID)),
    )


def _mishaps(feeder: PmxDevice) -> Mishaps:
    if feeder.mishaps is None:
        feeder.mishaps = Mishaps()
    return feeder.mishaps


def _noticed(scene: Scene, fault: Fault, feeder: PmxDevice, number: int, code: int) -> Undo:
    """The device raises its alarm, once it has noticed; the cause stands until it is undone."""
    if not fault.values["noticed"]:
        return both()
    causes = _mishaps(feeder).causes
    causes.append(code)
    if _NOTICES_S[number] == 0.0:
        feeder.trip(code)
        return lambda: causes.remove(code)
    after_s = _NOTICES_S[number] + float(fault.values.get("rise_s", 0.0))
    return both(scene.later(after_s, lambda: feeder.trip(code)), lambda: causes.remove(code))


def _turn_otherwise(scene: Scene, fault: Fault, speed: float, number: int) -> Undo:
    scene.hopper(fault)
    feeder = scene.feeder(fault)
    return both(
        _disturb(feeder, fault.channel, speed=speed),
        _noticed(scene, fault, feeder, number, hopper_code(fault.channel, number)),
    )


def _disturb(
    feeder: PmxDevice, channel: int, *, speed: float = 1.0, share: float = 1.0
) -> Undo:
    process = feeder.hoppers[channel].process
    process.disturb(feeder.settle(), speed=speed, share=share)
    return lambda: process.disturb(feeder.settle(), speed=1.0, share=1.0)


def _set_left(scene: Scene, fault: Fault, grams: float) -> None:
    hopper, feeder = scene.hopper(fault), scene.feeder(fault)
    hopper.process.set_left_g(feeder.settle(), grams)
    feeder.settle()


def _pressure(feeder: PmxDevice, fault: Fault) -> Undo:
    mbar, rise_s, began_s = fault.number("mbar"), fault.number("rise_s"), feeder.now()

    def risen(usual: Value) -> Value:
        assert isinstance(usual, int | float)
        share = min(1.0, (feeder.now() - began_s) / rise_s) if rise_s else 1.0
        return round(usual + share * (mbar - usual))

    return _mishaps(feeder).tell(0, "MIXER_PRESSURE", risen)


def _told_times(feeder: PmxDevice, channel: int, name: str, factor: float) -> Undo:
    def change(value: Value) -> Value:
        assert isinstance(value, int | float)
        return value * factor

    return _mishaps(feeder).tell(channel, name, change)


def _always(value: Value) -> Change:
    return lambda _: value


def _as_told(feeder: PmxDevice, channel: int, per_rpm: float) -> Change:
    """What the disc would do, were it to do what it is told."""
    told = feeder.hoppers[channel].told
    return lambda _: told.disc_rpm(feeder.now()) * per_rpm


def _with(flags: int) -> Change:
    return lambda value: _bits(value) | flags


def _without(flags: int) -> Change:
    return lambda value: _bits(value) & ~flags


def _bits(value: Value) -> int:
    assert isinstance(value, int)
    return value
