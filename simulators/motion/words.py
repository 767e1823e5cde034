"""Sorts the words of a block into modal groups and values, or refuses it as the firmware does.

This is the first half of the firmware's interpreter: it finds every error in a block that does
not depend on the machine's state. Sources: Grbl 1.1 `gcode.c` steps 1 and 2; NIST RS274/NGC
section 3.4 (modal groups).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from firmware_protocol.dialect import GRBLHAL, Dialect
from firmware_protocol.gcode import GcodeError

NEGATIVE, UNSUPPORTED, GROUP_CLASH, NOT_WHOLE = 4, 20, 21, 23
AXIS_CLASH, REPEATED = 24, 25


class AxisWordUse(Enum):
    """The purpose of the axis words in a block."""

    NONE = 0
    NON_MODAL = 1
    MOTION = 2
    TOOL_LENGTH = 3


@dataclass(slots=True)
class BlockWords:
    """One block. Codes are ten times the number: 382 is G38.2.

    g, m : modal group -> code, of the groups present in the block
    values : letter -> value
    """

    g: dict[str, int] = field(default_factory=dict)
    m: dict[str, int] = field(default_factory=dict)
    values: dict[str, float] = field(default_factory=dict)
    axes: AxisWordUse = AxisWordUse.NONE


def _groups(table: dict[str, str]) -> dict[int, str]:
    return {
        round(float(code) * 10): group for group, codes in table.items() for code in codes.split()
    }


_G_GRBL = _groups(
    {
        "nonmodal": "4 10 28 28.1 30 30.1 53 92 92.1",
        "motion": "0 1 2 3 38.2 38.3 38.4 38.5 80",
        "plane": "17 18 19",
        "distance": "90 91",
        "arc distance": "91.1",
        "feed": "93 94",
        "units": "20 21",
        "cutter": "40",
        "tool length": "43.1 49",
        "wcs": "54 55 56 57 58 59",
        "path": "61",
    }
)
_G_GRBLHAL = _G_GRBL | _groups(
    {"motion": "5", "wcs": "59.1 59.2 59.3", "retract": "98 99", "scaling": "50"}
)
_M_GRBL = _groups({"stop": "0 1 2 30", "spindle": "3 4 5", "coolant": "8 9"})
_M_GRBLHAL = _M_GRBL | _groups({"coolant": "7", "tool": "6", "ports": "62 63 64 65 66 67 68"})
_LETTERS_GRBL = frozenset("FIJKLNPRSTXYZ")
_LETTERS_GRBLHAL = _LETTERS_GRBL | frozenset("DEHQ")
_NOT_NEGATIVE = frozenset("FNPTS")
_MOTION_WITH_AXES = frozenset((0, 10, 20, 30, 50, 382, 383, 384, 385))
_NON_MODAL_WITH_AXES = frozenset((100, 280, 300, 920))


class GcodeGrammar:
    """The codes and letters that one firmware supports."""

    def __init__(self, dialect: Dialect) -> None:
        hal = dialect is GRBLHAL
        self._g = _G_GRBLHAL if hal else _G_GRBL
        self._m = _M_GRBLHAL if hal else _M_GRBL
        self._letters = _LETTERS_GRBLHAL if hal else _LETTERS_GRBL

    def classify_words(self, tokens: list[tuple[str, float]]) -> BlockWords:
        """raises: GcodeError at the first word, from the left, that the firmware refuses"""
        words = BlockWords()
        for letter, value in tokens:
            if letter == "G":
                self._sort_g(words, value)
            elif letter == "M":
                self._sort_m(words, value)
            else:
                if letter not in self._letters:
                    raise GcodeError(UNSUPPORTED)
                if letter in words.values:
                    raise GcodeError(REPEATED)
                if value < 0.0 and letter in _NOT_NEGATIVE:
                    raise GcodeError(NEGATIVE)
                words.values[letter] = value
        return words

    def _sort_g(self, words: BlockWords, value: float) -> None:
        code = round(value * 10)
        group = self._g.get(code)
        if group is None or abs(value * 10 - code) > 1e-6:
            raise GcodeError(UNSUPPORTED)
        wants = AxisWordUse.NONE
        if code in _MOTION_WITH_AXES:
            wants = AxisWordUse.MOTION
        elif code in _NON_MODAL_WITH_AXES:
            wants = AxisWordUse.NON_MODAL
        elif group == "tool length":
            wants = AxisWordUse.TOOL_LENGTH
        if wants is not AxisWordUse.NONE:
            if words.axes is not AxisWordUse.NONE:
                raise GcodeError(AXIS_CLASH)
            words.axes = wants
        if group in words.g:
            raise GcodeError(GROUP_CLASH)
        words.g[group] = code

    def _sort_m(self, words: BlockWords, value: float) -> None:
        if value != int(value):
            raise GcodeError(NOT_WHOLE)
        group = self._m.get(int(value) * 10)
        if group is None:
            raise GcodeError(UNSUPPORTED)
        if group in words.m:
            raise GcodeError(GROUP_CLASH)
        words.m[group] = int(value)
