"""The input registers of a PMX device, computed when they are read."""

from __future__ import annotations

from firmware_protocol.pmx import (
    DEVICE_ID,
    MAP_MAJOR,
    MAP_MINOR_MIRROR,
    MIRROR,
    PMX,
    SYSTEM_BLOCK,
    Command,
    HopperFlags,
    Mode,
    Status,
    hopper_names,
    hopper_row,
)
from firmware_protocol.pmx_alarms import CLIPPED, EMPTY, LEVEL_LOW, hopper_code
from firmware_protocol.registers import Value
from simulators.feeder.device import Hopper, PmxDevice
from simulators.feeder.holding import ILLEGAL_ADDRESS, RefusedError

_FIRMWARE = 0x0100
_SERIAL = 1
#: The device's own cycle, after which TOGGLE flips.
_CYCLE_S = 0.1
_SUPPLY_BAR = 6.0
_HOPPER_MBAR = 200
_MIXER_MBAR_PER_L_MIN = 10
_OLDEST_MS = 0xFFFF
#: Most that a flow register in 0.01 g/min or L/min can say; it stays there beyond.
_MOST = 655.34
_FIRST_WARNING = LEVEL_LOW

_HOPPER_BLOCKS = {channel: PMX.block(hopper_names(channel)) for channel in range(1, 5)}


def read_input(device: PmxDevice, address: int, count: int) -> list[int]:
    """Words of input registers. Raises RefusedError(ILLEGAL_ADDRESS) where one is not there."""
    time_s = device.settle()
    if address < SYSTEM_BLOCK.count:
        words, start = SYSTEM_BLOCK.encode(_system(device, time_s)), 0
    else:
        channel = address // 100
        if channel not in device.hoppers:
            raise RefusedError(ILLEGAL_ADDRESS)
        values = _hopper(device, channel, time_s)
        block = _HOPPER_BLOCKS[channel]
        words = block.encode({hopper_row(channel, name): v for name, v in values.items()})
        start = block.address
    first = address - start
    if first + count > len(words):
        raise RefusedError(ILLEGAL_ADDRESS)
    return words[first : first + count]


def read_holding(device: PmxDevice, address: int, count: int) -> list[int]:
    """Words of holding registers, or of the input registers' mirror where the map has it."""
    mirrored = address - MIRROR
    if device.config.map_minor >= MAP_MINOR_MIRROR and 0 <= mirrored < MIRROR:
        return read_input(device, mirrored, count)
    device.settle()
    return device.holding.read(address, count)


def _system(device: PmxDevice, time_s: float) -> dict[str, Value]:
    gas_L_min = _gas_L_min(device, time_s)
    warnings = _warnings(device, time_s)
    return {
        "DEVICE_ID": DEVICE_ID,
        "MAP_VERSION": MAP_MAJOR << 8 | device.config.map_minor,
        "FW_VERSION": _FIRMWARE,
        "N_HOPPERS": max(device.hoppers),
        "SERIAL": _SERIAL,
        "STATUS": _status(device, time_s, bool(warnings)),
        "ALARM": device.alarms.system_bits(),
        "WARNING": warnings,
        "FIRST_ALARM_CODE": device.alarms.first,
        "ALARM_COUNT": device.alarms.count & 0xFFFF,
        "HEARTBEAT_ECHO": device.holding.raw("HEARTBEAT"),
        "HEARTBEAT_AGE": min(_OLDEST_MS, int((time_s - device.heartbeat_s) * 1000)),
        "UPTIME": int(time_s - device.powered_s),
        "MODE": Mode.LOCAL if device.local else Mode.REMOTE,
        "STATE": device.state(time_s),
        "TOTAL_FLOW": min(_MOST, sum(_flow_est(h, device, time_s) for h in _all(device))),
        "MIXER_PRESSURE": round(_MIXER_MBAR_PER_L_MIN * gas_L_min),
        "TOTAL_GAS": min(_MOST, gas_L_min),
        "SUPPLY_PRESSURE": _SUPPLY_BAR,
        "SEQ_APPLIED": device.seq_applied,
        "LAST_REFUSAL": device.refusal,
        "TICK": int(time_s * 1000) & 0xFFFF,
    }


def _status(device: PmxDevice, time_s: float, warning: bool) -> int:
    command = device.command
    gas = device.gas_flows(time_s)
    return _bits(
        (Status.READY, not device.alarms and not device.booting(time_s)),
        (Status.REMOTE, not device.local and Command.ENABLE_REMOTE in command),
        (Status.GAS_OK, device.gas_ok(time_s)),
        (Status.FEEDING, device.discs_on),
        (Status.AT_SETPOINT, all(_at_setpoint(h, device, time_s) for h in _all(device))),
        (Status.STABLE, device.stable(time_s)),
        (Status.WARNING, warning),
        (Status.ALARM, bool(device.alarms)),
        (Status.WATCHDOG_TRIPPED, device.watchdog_tripped),
        (Status.ESTOP_CHAIN_OK, not device.estop_open),
        (Status.LID_CLOSED, True),
        (Status.PURGING, gas and not device.discs_on and Command.PURGE in command),
        (Status.RAMPING, any(h.process.ramping(time_s) for h in _all(device))),
        (Status.REFILLING, Command.REFILL_HOLD in command),
        (Status.CONFIG_VALID, True),
        (Status.TOGGLE, bool(int(time_s / _CYCLE_S) & 1)),
    )


def _hopper(device: PmxDevice, channel: int, time_s: float) -> dict[str, Value]:
    hopper = device.hoppers[channel]
    process = hopper.process
    fed_g = process.fed_g(time_s)
    left_g = hopper.config.fill_g - fed_g
    refilling = Command.REFILL_HOLD in device.command
    gas = device.gas_flows(time_s)
    empty = time_s >= process.empty_s
    weighed = 0.0 if empty else process.disc_flow_g_s(time_s) * 60.0
    stirring = Command.STIR_ON in device.command
    flags = _bits(
        (HopperFlags.PRESENT, True),
        (HopperFlags.ENABLED, True),
        (HopperFlags.RUNNING, device.discs_on and process.disc_rpm(time_s) > 0),
        (HopperFlags.AT_SETPOINT, _at_setpoint(hopper, device, time_s)),
        (HopperFlags.STABLE, device.stable(time_s)),
        (HopperFlags.LEVEL_LOW, _level_low(hopper, device, time_s)),
        (HopperFlags.LEVEL_EMPTY, empty),
        (HopperFlags.REFILLING, refilling),
        (HopperFlags.LID_CLOSED, True),
        (HopperFlags.PRESSURISED, gas),
        (HopperFlags.HEATED_OK, True),
        (HopperFlags.LIW_VALID, not refilling),
        (HopperFlags.STIRRER_ON, stirring),
        (HopperFlags.LIMITED, hopper.limited),
        (HopperFlags.BELOW_N_MIN, 0 < hopper.rpm < device.holding[hopper_row(channel, "N_MIN")]),
        (HopperFlags.FAULT, hopper_code(channel, EMPTY) in device.alarms),
    )
    return {
        "STATUS": flags,
        "ALARM": device.alarms.hopper_bits(channel),
        "DISC_ACT": process.disc_rpm(time_s),
        "DISC_RAMPED": process.setpoint_rpm(time_s),
        "FLOW_EST": min(_MOST, _flow_est(hopper, device, time_s)),
        "FLOW_LIW": None if refilling else min(_MOST, weighed),
        "WEIGHT": left_g,
        "LEVEL": 100.0 * left_g / hopper.config.fill_g,
        "STIRRER_ACT": hopper.stirrer_rpm if stirring else 0.0,
        "CARRIER_ACT": hopper.carrier_L_min if gas else 0.0,
        "PRESSURE": _HOPPER_MBAR if gas else 0,
        "TOTALISER": fed_g,
        "FEED_FACTOR_ACT": device.holding[hopper_row(channel, "FEED_FACTOR")],
        # not simulated, and said so:
        "MOTOR_CURRENT": None, "TORQUE": None, "TEMP": None, "FLOW_RSD_60S": None,
        "RUN_HOURS": None,
    }


def _all(device: PmxDevice) -> list[Hopper]:
    return list(device.hoppers.values())


def _flow_est(hopper: Hopper, device: PmxDevice, time_s: float) -> float:
    """What the device believes it feeds: its own factor times the disc's speed [g/min]."""
    factor = device.holding[hopper_row(hopper.config.channel, "FEED_FACTOR")]
    return factor * hopper.process.disc_rpm(time_s)


def _gas_L_min(device: PmxDevice, time_s: float) -> float:
    return sum(h.carrier_L_min for h in _all(device)) if device.gas_flows(time_s) else 0.0


def _at_setpoint(hopper: Hopper, device: PmxDevice, time_s: float) -> bool:
    if not device.discs_on:
        return False
    tolerance = device.holding["AT_SPEED_TOL"] / 100.0 * hopper.rpm
    return abs(hopper.process.disc_rpm(time_s) - hopper.rpm) <= tolerance + 1e-9


def _level_low(hopper: Hopper, device: PmxDevice, time_s: float) -> bool:
    left_g = hopper.config.fill_g - hopper.process.fed_g(time_s)
    warn_percent = device.holding[hopper_row(hopper.config.channel, "LEVEL_WARN")]
    return 100.0 * left_g <= warn_percent * hopper.config.fill_g


def _warnings(device: PmxDevice, time_s: float) -> int:
    """WARNING: bits 0..4 are x51..x55 of any hopper."""
    low = any(_level_low(h, device, time_s) for h in _all(device))
    clipped = any(h.limited for h in _all(device))
    return low << LEVEL_LOW - _FIRST_WARNING | clipped << CLIPPED - _FIRST_WARNING


def _bits(*flags: tuple[Status | HopperFlags, bool]) -> int:
    return sum(int(flag) for flag, on in flags if on)
