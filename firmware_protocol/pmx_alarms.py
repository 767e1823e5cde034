"""Messages of PMX feeders in plain words: alarms, warnings and refused writes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from firmware_protocol.pmx import MAX_HOPPERS, WriteRefusalCode


@dataclass(frozen=True)
class FeederAlarm:
    """An alarm or warning in plain words. remedy : what to do about it."""

    code: int
    text: str
    remedy: str


_SYSTEM_ALARMS = {
    101: ("the emergency-stop chain is open", "release the emergency stop"),
    102: ("the gas supply pressure is low", "check gas bottle, valve and regulator"),
    103: ("the mixer pressure is too high", "look for a clogged nozzle or kinked hose"),
    104: ("the host's heartbeat stopped, and its watchdog tripped",
          "find out why the host went silent"),
    105: ("its configuration is invalid", "check the stored hopper settings"),
    106: ("it reports an internal fault", "switch it off and on; see its manual if that fails"),
}

_HOPPER_ALARMS = {
    1: ("drive fault", "check the disc drive"),
    2: ("the disc is stalled", "look for caked powder or a foreign body under the disc"),
    3: ("the disc does not hold its speed", "check the drive, and the set-point against its range"),
    4: ("too little carrier gas", "check the gas supply and the hose"),
    5: ("the hopper pressure is out of range", "check lid seal, hose and over-pressure valve"),
    6: ("the lid is open", "close the lid"),
    7: ("it is empty", "refill it"),
    8: ("stirrer fault", "check the stirrer drive"),
    9: ("load cell fault", "check the load cell and its cable"),
    10: ("it is too hot", "let it cool; check the heater"),
    51: ("the level is low", "fill it soon: powder stops when it is empty"),
    52: ("the weighed flow differs from the estimate by more than 5 %",
         "look whether powder moves freely, and recalibrate the feed factor: the mixture is off by "
         "as much"),
    53: ("the flow is unsteady, by more than 3 %", "check powder moisture, level and disc"),
    54: ("its calibration is old", "recalibrate the feed factor before the next job"),
    55: ("the set-point was clipped", "keep set-points within the disc's speed range"),
}

#: Codes of the system alarms, in the order of their bits in ALARM.
SYSTEM_CODES = tuple(_SYSTEM_ALARMS)
ESTOP, WATCHDOG = 101, 104
#: Numbers of a hopper's own codes, see `hopper_alarm_code`.
EMPTY, LEVEL_LOW, DRIFT, UNSTEADY, OLD_CALIBRATION, CLIPPED = 7, 51, 52, 53, 54, 55
#: The bit of WARNING for a clipped set-point of any hopper.
SETPOINT_CLIPPED_BIT = 1 << CLIPPED - LEVEL_LOW

_HOPPER_BITS_FROM = 8  # of ALARM: bit 8 is channel 1


def hopper_alarm_code(channel: int, number: int) -> int:
    """Alarm code of a hopper: 201 is drive fault of hopper 1, 307 hopper 2 empty."""
    return 100 * (channel + 1) + number


def describe_alarm(code: int, hoppers: Mapping[int, str] | None = None) -> FeederAlarm:
    """An alarm code in words; codes the map does not list are named as such.

    hoppers : what to call each channel's hopper; its number otherwise

    >>> describe_alarm(307).text
    'hopper 2: it is empty'
    """
    if code in _SYSTEM_ALARMS:
        return FeederAlarm(code, *_SYSTEM_ALARMS[code])
    channel, number = code // 100 - 1, code % 100
    if 1 <= channel <= MAX_HOPPERS and number in _HOPPER_ALARMS:
        text, hint = _HOPPER_ALARMS[number]
        return FeederAlarm(code, f"hopper {(hoppers or {}).get(channel, channel)}: {text}", hint)
    return FeederAlarm(code, f"alarm {code}, which its register map does not list",
                       "see its manual")


def describe_first_out_alarm(code: int, bits: int,
                             hoppers: Mapping[int, str] | None = None) -> FeederAlarm:
    """The first-out alarm in words, and which others are active. bits : the word ALARM

    >>> describe_first_out_alarm(103, 0b10_0000_0110).text
    'the mixer pressure is too high (and 2 more: the gas supply pressure is low; hopper 2 has one)'
    """
    first = describe_alarm(code, hoppers)
    others = [
        text for bit, (other, (text, _)) in enumerate(_SYSTEM_ALARMS.items())
        if bits >> bit & 1 and other != code
    ]
    others += [
        f"hopper {(hoppers or {}).get(channel, channel)} has one"
        for channel in range(1, MAX_HOPPERS + 1)
        if bits >> _HOPPER_BITS_FROM + channel - 1 & 1 and channel != code // 100 - 1
    ]
    if not others:
        return first
    return FeederAlarm(code, f"{first.text} (and {len(others)} more: {'; '.join(others)})",
                       first.remedy)


def describe_warnings(word: int) -> list[FeederAlarm]:
    """The warnings of the word WARNING, each by its number, of any hopper.

    >>> [(one.code, one.text) for one in describe_warnings(1)]
    [(51, 'the level is low')]
    """
    found = []
    for bit in range(word.bit_length()):
        if word >> bit & 1:
            number = LEVEL_LOW + bit
            text, hint = _HOPPER_ALARMS.get(number, (
                f"warning bit {bit}, which its register map does not list", "see its manual"))
            found.append(FeederAlarm(number, text, hint))
    return found


_REFUSALS = {
    WriteRefusalCode.NONE: "no reason given",
    WriteRefusalCode.NOT_REMOTE: "its switch is at LOCAL, or remote control is not enabled",
    WriteRefusalCode.FAULTED: "an alarm or a watchdog trip is latched",
    WriteRefusalCode.NO_GAS: "powder needs carrier gas, and gas is off",
    WriteRefusalCode.POWDER_RUNNING: "powder is running",
    WriteRefusalCode.CAUSE_REMAINS: "the cause of the alarm is still there",
    WriteRefusalCode.WATCHDOG_NEEDED: "its watchdog cannot be switched off under remote control",
}


def describe_refusal(code: int) -> str:
    """LAST_REFUSAL in words."""
    try:
        return _REFUSALS[WriteRefusalCode(code)]
    except ValueError:
        return f"reason {code}, which its register map does not list"
