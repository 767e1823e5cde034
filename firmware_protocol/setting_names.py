"""Short descriptions of the numbered settings (`$n=value`) of both firmwares.

Sources: Grbl 1.1 `doc/markdown/settings.md`; grblHAL wiki, "Additional or extended settings".
Numbers with the same meaning in both are listed once.
"""

from __future__ import annotations

_AXES = "XYZABC"

_NAMES = {
    0: "step pulse length [µs]",
    1: "step idle delay [ms]",
    2: "step pins inverted (mask)",
    3: "axis directions inverted (mask)",
    4: "step enable inverted",
    5: "limit pins inverted",
    6: "probe pin inverted",
    9: "spindle PWM options (mask)",
    10: "what status reports carry (mask)",
    11: "junction deviation [mm]",
    12: "arc tolerance [mm]",
    13: "reports in inches",
    14: "control pins inverted (mask)",
    15: "coolant pins inverted (mask)",
    16: "spindle pins inverted (mask)",
    17: "pull-ups of control pins off (mask)",
    18: "pull-ups of limit pins off (mask)",
    19: "pull-up of the probe pin off",
    20: "soft limits",
    21: "hard limits",
    22: "homing cycle",
    23: "homing directions inverted (mask)",
    24: "homing: slow feed [mm/min]",
    25: "homing: search rate [mm/min]",
    26: "homing: switch debounce [ms]",
    27: "homing: pull-off [mm]",
    28: "G73 retract [mm]",
    29: "step pulse delay [µs]",
    30: "S word of full power (greatest spindle speed)",
    31: "S word of least power (least spindle speed)",
    32: "laser mode",
    33: "spindle PWM frequency [Hz]",
    34: "spindle PWM when off [%]",
    35: "spindle PWM at least [%]",
    36: "spindle PWM at most [%]",
    37: "motors left without current at rest (mask)",
    39: "printable real-time command characters",
    40: "jogs limited to the travel",
    41: "parking",
    42: "parking axis",
    43: "homing passes",
    44: "axes homed first (mask)",
    45: "axes homed second (mask)",
    46: "axes homed third (mask)",
    60: "overrides restored at the program's end",
    61: "safety door ignored while idle",
    62: "sleep allowed",
    63: "feed hold: laser off, spindle and coolant restored (mask)",
    64: "alarm at every start",
    384: "G92 forgotten at power off",
    398: "planner buffer [blocks]",
    481: "interval of reports without a question [ms]",
}
_OF_AXES = {
    100: "steps per mm of {axis}",
    110: "greatest rate of {axis} [mm/min]",
    120: "acceleration of {axis} [mm/s²]",
    130: "travel of {axis} [mm]",
}


def setting_name(number: int) -> str:
    """A setting in a few words, "" where it is not known.

    >>> setting_name(111)
    'greatest rate of Y [mm/min]'
    """
    first = number // 10 * 10
    if first in _OF_AXES and number - first < len(_AXES):
        return _OF_AXES[first].format(axis=_AXES[number - first])
    return _NAMES.get(number, "")
