"""The input registers of a PMX device, computed when they are read."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress
from typing import NamedTuple

from firmware_protocol.pmx import (
    DEVICE_ID,
    FIRST_CONFIGURATION_REGISTER,
    FIRST_MINOR_VERSION_WITH_MIRROR,
    HOPPER_WORDS,
    MAP_MAJOR_VERSION,
    MIRROR_ADDRESS,
    PMX_MAP,
    SYSTEM_BLOCK,
    FeederCommandBits,
    FeederMode,
    FeederStateCode,
    hopper_input_names,
    hopper_register_name,
)
from firmware_protocol.pmx_alarms import CLIPPED, EMPTY, LEVEL_LOW, hopper_alarm_code
from firmware_protocol.registers import RegisterValue, WordOrder
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.hopper import SimulatedHopper
from simulators.modbus_errors import ILLEGAL_ADDRESS, ExceptionReplyError

_FIRMWARE = 0x0100
_SERIAL = 1
#: The device's own cycle, after which TOGGLE flips.
_CYCLE_S = 0.1
_SUPPLY_BAR = 6.0
_HOPPER_MBAR = 200
_MIXER_MBAR_PER_L_MIN = 10
_MAX_AGE_MS = 0xFFFF
#: Largest value of a flow register in 0.01 g/min or L/min; larger flows are clipped to it.
_MOST = 655.34
_FIRST_WARNING = LEVEL_LOW

#: Of the bits of a word, the lowest first.
_WEIGHTS = tuple(1 << bit for bit in range(16))

_SYSTEM_BLOCKS = {order: SYSTEM_BLOCK.with_word_order(order) for order in WordOrder}
_HOPPER_BLOCKS = {
    (order, channel): PMX_MAP.contiguous_block(hopper_input_names(channel)).with_word_order(order)
    for order in WordOrder for channel in range(1, 5)
}


def read_input(device: PmxFeederDevice, address: int, count: int) -> list[int]:
    """Return input registers. Raises ExceptionReplyError(ILLEGAL_ADDRESS) if one is missing."""
    time_s = device.advance_to_now()
    channel, first = divmod(address, 100)
    if channel and channel not in device.hoppers:
        raise ExceptionReplyError(ILLEGAL_ADDRESS)
    return _part(_words(device, channel, time_s), first, count)


def _mirrored(device: PmxFeederDevice, first: int, count: int) -> list[int]:
    """Words of the mirror; first : counted from its start."""
    time_s = device.advance_to_now()
    words = _words(device, 0, time_s)
    for channel in range(1, max(device.hoppers) + 1):
        if first + count > len(words):
            there = channel in device.hoppers
            words += _words(device, channel, time_s) if there else [0] * HOPPER_WORDS
    return _part(words, first, count)


def _words(device: PmxFeederDevice, channel: int, time_s: float) -> list[int]:
    """Every input register of a hopper, or of the device (0), after `advance_to_now`."""
    values, order = register_values(device, channel, time_s), device.config.word_order
    if channel == 0:
        return _SYSTEM_BLOCKS[order].encode(values)
    named = {hopper_register_name(channel, name): value for name, value in values.items()}
    return _HOPPER_BLOCKS[order, channel].encode(named)


def _part(words: list[int], first: int, count: int) -> list[int]:
    if first + count > len(words):
        raise ExceptionReplyError(ILLEGAL_ADDRESS)
    return words[first : first + count]


def register_values(device: PmxFeederDevice, channel: int, time_s: float) -> dict[str,
                                                                                  RegisterValue]:
    """Return the values the device reports after `advance_to_now`, by channel (0: the device)."""
    values = _hopper(device, channel, time_s) if channel else _system(device, time_s)
    return values if device.defects is None else device.defects.apply_overrides(channel, values)


def read_holding(device: PmxFeederDevice, address: int, count: int) -> list[int]:
    """Words of holding registers, or of the input registers' mirror if the map has it."""
    has_mirror = device.config.map_minor >= FIRST_MINOR_VERSION_WITH_MIRROR
    if has_mirror and MIRROR_ADDRESS <= address < FIRST_CONFIGURATION_REGISTER:
        return _mirrored(device, address - MIRROR_ADDRESS, count)
    device.advance_to_now()
    return device.holding.read(address, count)


class _Seen(NamedTuple):
    """One hopper at one instant, as its device sees it. flow_est : its factor times disc speed."""

    rpm: float
    flow_est_g_min: float
    left_g: float
    at_setpoint: bool
    low: bool

    @classmethod
    def now(cls, hopper: SimulatedHopper, device: PmxFeederDevice, time_s: float) -> _Seen:
        channel, holding = hopper.config.channel, device.holding
        rpm = hopper.process.disc_rpm(time_s)
        left_g = hopper.process.remaining_g(time_s)
        tolerance_rpm = holding["AT_SPEED_TOL"] / 100.0 * hopper.rpm + 1e-9
        warn_g = holding[hopper_register_name(channel, "LEVEL_WARN")] / 100.0 * hopper.config.fill_g
        return cls(
            rpm, min(_MOST, rpm * holding[hopper_register_name(channel, "FEED_FACTOR")]), left_g,
            device.discs_on and abs(rpm - hopper.rpm) <= tolerance_rpm, left_g <= warn_g,
        )


def _system(device: PmxFeederDevice, time_s: float) -> dict[str, RegisterValue]:
    hoppers = device.hoppers.values()
    seen = [_Seen.now(hopper, device, time_s) for hopper in hoppers]
    gas_L_min = sum(h.carrier_L_min for h in hoppers) if device.is_gas_flowing(time_s) else 0.0
    # WARNING: bits 0..4 are x51..x55 of any hopper
    warnings = any(one.low for one in seen) << LEVEL_LOW - _FIRST_WARNING
    warnings |= any(h.is_setpoint_clipped for h in hoppers) << CLIPPED - _FIRST_WARNING
    state = device.state(time_s)
    return {
        "DEVICE_ID": DEVICE_ID,
        "MAP_VERSION": MAP_MAJOR_VERSION << 8 | device.config.map_minor,
        "FW_VERSION": _FIRMWARE,
        "N_HOPPERS": max(device.hoppers),
        "SERIAL": _SERIAL,
        "STATUS": _status(device, time_s, state, seen, warnings),
        "ALARM": device.alarms.system_bits(),
        "WARNING": warnings,
        "FIRST_ALARM_CODE": device.alarms.first,
        "ALARM_COUNT": device.alarms.count & 0xFFFF,
        "HEARTBEAT_ECHO": device.holding.raw_word("HEARTBEAT"),
        "HEARTBEAT_AGE": min(_MAX_AGE_MS, int((time_s - device.heartbeat_s) * 1000)),
        "UPTIME": int(time_s - device.powered_s),
        "MODE": int(FeederMode.LOCAL if device.local else FeederMode.REMOTE),
        "STATE": int(state),
        "TOTAL_FLOW": min(_MOST, sum(one.flow_est_g_min for one in seen)),
        "MIXER_PRESSURE": round(_MIXER_MBAR_PER_L_MIN * gas_L_min),
        "TOTAL_GAS": min(_MOST, gas_L_min),
        "SUPPLY_PRESSURE": _SUPPLY_BAR,
        "SEQ_APPLIED": device.seq_applied,
        "LAST_REFUSAL": int(device.refusal),
        "TICK": int(time_s * 1000) & 0xFFFF,
    }


def _status(
    device: PmxFeederDevice, time_s: float, state: FeederStateCode, seen: Sequence[_Seen],
    warnings: int
) -> int:
    """STATUS; conditions in the order of the bits of `pmx.FeederStatusBits`."""
    command = device.command
    return _bits(
        not device.alarms and state is not FeederStateCode.BOOT,
        not device.local and FeederCommandBits.ENABLE_REMOTE in command,
        device.is_gas_ok(time_s),
        device.discs_on,
        all(one.at_setpoint for one in seen),
        device.is_stable(time_s),
        bool(warnings),
        bool(device.alarms),
        device.watchdog_tripped,
        not device.estop_open,
        True,  # lids closed
        (FeederCommandBits.PURGE in command and device.is_gas_flowing(time_s)
         and not device.discs_on),
        any(h.process.is_ramping(time_s) for h in device.hoppers.values()),
        FeederCommandBits.REFILL_HOLD in command,
        True,  # configuration valid
        bool(int(time_s / _CYCLE_S) & 1),
    )


def _hopper(device: PmxFeederDevice, channel: int, time_s: float) -> dict[str, RegisterValue]:
    hopper = device.hoppers[channel]
    process = hopper.process
    seen = _Seen.now(hopper, device, time_s)
    refilling = FeederCommandBits.REFILL_HOLD in device.command
    stirring = FeederCommandBits.STIR_ON in device.command
    gas = device.is_gas_flowing(time_s)
    empty = time_s >= process.empty_s
    weighed_g_min = 0.0 if empty else process.disc_flow_g_s(time_s) * 60.0
    # in the order of the bits of `pmx.HopperStatusBits`
    flags = _bits(
        True,  # present
        True,  # enabled
        device.discs_on and seen.rpm > 0,
        seen.at_setpoint,
        device.is_stable(time_s),
        seen.low,
        empty,
        refilling,
        True,  # lid closed
        gas,  # pressurised
        True,  # warm enough
        not refilling,  # weighed flow valid
        stirring,
        hopper.is_setpoint_clipped,
        0 < hopper.rpm < device.holding[hopper_register_name(channel, "N_MIN")],
        hopper_alarm_code(channel, EMPTY) in device.alarms,
    )
    return {
        "STATUS": flags,
        "ALARM": device.alarms.hopper_bits(channel),
        "DISC_ACT": seen.rpm,
        "DISC_RAMPED": process.setpoint_rpm(time_s),
        "FLOW_EST": seen.flow_est_g_min,
        "FLOW_LIW": None if refilling else min(_MOST, weighed_g_min),
        "WEIGHT": seen.left_g,
        "LEVEL": min(100.0, 100.0 * seen.left_g / hopper.config.fill_g),
        "STIRRER_ACT": hopper.stirrer_rpm if stirring else 0.0,
        "CARRIER_ACT": hopper.carrier_L_min if gas else 0.0,
        "PRESSURE": _HOPPER_MBAR if gas else 0,
        "TOTALISER": process.fed_g(time_s),
        "FEED_FACTOR_ACT": device.holding[hopper_register_name(channel, "FEED_FACTOR")],
        # not simulated, and reported so:
        "MOTOR_CURRENT": None, "TORQUE": None, "TEMP": None, "FLOW_RSD_60S": None,
        "RUN_HOURS": None,
    }


def _bits(*conditions: bool) -> int:
    """The first condition is bit 0."""
    return sum(compress(_WEIGHTS, conditions))
