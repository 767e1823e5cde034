"""Work offsets: G54 to G59.3, G92, tool length, and the stored positions of G28 and G30."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from firmware_protocol.gcode import GcodeError
from simulators.motion.actions import Vector
from simulators.motion.words import UNSUPPORTED, BlockWords

NO_AXES, NO_VALUE, NO_SUCH_SYSTEM, TOOL_AXIS = 26, 28, 29, 37

GRBL_WORK_OFFSET_CODES = (540, 550, 560, 570, 580, 590)
GRBLHAL_WORK_OFFSET_CODES = (*GRBL_WORK_OFFSET_CODES, 591, 592, 593)

_ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass
class WorkOffsets:
    """systems, stored : by code (540 is G54; 280, 300), machine coordinates [mm]."""

    systems: dict[int, Vector] = field(
        default_factory=lambda: dict.fromkeys(GRBLHAL_WORK_OFFSET_CODES, _ZERO)
    )
    stored: dict[int, Vector] = field(default_factory=lambda: {280: _ZERO, 300: _ZERO})
    g92: Vector = _ZERO
    tool: Vector = _ZERO

    def total(self, wcs: int) -> Vector:
        """The work zero in machine coordinates."""
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = self.systems[wcs], self.g92, self.tool
        return (ax + bx + cx, ay + by + cy, az + bz + cz)

    def reset(self) -> None:
        """Clear the volatile offsets at a reset; the stored ones stay."""
        self.g92 = self.tool = _ZERO

    def restore(self) -> None:
        """`$RST=#`: set all offsets to zero."""
        self.systems = dict.fromkeys(GRBLHAL_WORK_OFFSET_CODES, _ZERO)
        self.stored = {280: _ZERO, 300: _ZERO}
        self.reset()

    def prepare_change(
        self,
        words: BlockWords,
        scale: float,
        position_mm: Vector,
        wcs: int,
        many_systems: bool,
        used: set[str],
    ) -> Callable[[], None] | None:
        """The checked change for a block (G10, G28.1, G30.1, G43.1, G49, G92), not yet applied.

        raises : GcodeError
        """
        code = words.g.get("nonmodal", 0)
        if code == 100:
            return self._write_system(words, scale, position_mm, wcs, many_systems, used)
        if code in (281, 301):
            return lambda: self.stored.update({code - 1: position_mm})
        if code == 920:
            given = self._given(words, scale)
            return lambda: self._set_g92(
                _replaced(self.g92, given, position_mm, self.systems[wcs], self.tool)
            )
        if code == 921:
            return lambda: self._set_g92(_ZERO)
        length = words.g.get("tool length", 0)
        if length == 431:
            given = self._given(words, scale)
            if given[0] is not None or given[1] is not None or given[2] is None:
                raise GcodeError(TOOL_AXIS)
            along_z = given[2]
            return lambda: self._set_tool((0.0, 0.0, along_z))
        if length == 490:
            return lambda: self._set_tool(_ZERO)
        return None

    def _write_system(
        self,
        words: BlockWords,
        scale: float,
        position_mm: Vector,
        wcs: int,
        many_systems: bool,
        used: set[str],
    ) -> Callable[[], None]:
        values = words.values
        given = self._given(words, scale)
        if "P" not in values or "L" not in values:
            raise GcodeError(NO_VALUE)
        systems = GRBLHAL_WORK_OFFSET_CODES if many_systems else GRBL_WORK_OFFSET_CODES
        index = int(values["P"])
        if index > len(systems):
            raise GcodeError(NO_SUCH_SYSTEM)
        if values["L"] not in (2.0, 20.0):
            raise GcodeError(UNSUPPORTED)
        used.update("PL")
        target = wcs if index == 0 else systems[index - 1]
        if values["L"] == 20.0:
            offset = _replaced(self.systems[target], given, position_mm, self.g92, self.tool)
        else:
            offset = _chosen(given, self.systems[target])
        return lambda: self.systems.update({target: offset})

    def _set_g92(self, offset: Vector) -> None:
        self.g92 = offset

    def _set_tool(self, offset: Vector) -> None:
        self.tool = offset

    @staticmethod
    def _given(words: BlockWords, scale: float) -> list[float | None]:
        given = [words.values[axis] * scale if axis in words.values else None for axis in "XYZ"]
        if given == [None, None, None]:
            raise GcodeError(NO_AXES)
        return given


def _chosen(given: list[float | None], otherwise: Vector) -> Vector:
    x, y, z = (b if a is None else a for a, b in zip(given, otherwise, strict=True))
    return (x, y, z)


def _replaced(
    offset: Vector, given: list[float | None], position: Vector, *others: Vector
) -> Vector:
    """The offset that gives the position the commanded work coordinates."""
    x, y, z = (
        offset[axis] if value is None else position[axis] - value - sum(o[axis] for o in others)
        for axis, value in enumerate(given)
    )
    return (x, y, z)
