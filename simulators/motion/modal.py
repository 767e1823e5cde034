"""G-code interpreter: a line and the modal state give actions, or the firmware's error number.

Nothing moves or waits here. The state is that *behind* the line, as the firmware's parser state
is; the order of a line's actions is the firmware's (Grbl 1.1 `gcode.c` step 4; NIST RS274/NGC
section 3.8). The ordinary line, one straight move, takes a short way through.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

from firmware_protocol.dialect import GRBLHAL, Dialect
from firmware_protocol.gcode import GcodeError, tokenise
from simulators.motion.actions import (
    BEAM_CONSTANT,
    BEAM_DYNAMIC,
    BEAM_OFF,
    Action,
    Coolant,
    Dwell,
    Motion,
    Pause,
    Probe,
    ProgramEnd,
    Spindle,
    ToolChange,
    Vector,
)
from simulators.motion.arcs import centre_from_radius, check_radii, chords
from simulators.motion.offsets import Offsets
from simulators.motion.ports import port_actions
from simulators.motion.settings import Settings
from simulators.motion.words import UNSUPPORTED, Axes, Grammar, Words

NO_FEED, NO_AXES, BAD_LINE_NUMBER, NO_VALUE = 22, 26, 27, 28
G53_NEEDS_MOTION, AXES_UNUSED, NO_PLANE_AXES, BAD_TARGET, NO_OFFSETS, UNUSED = (
    30,
    31,
    32,
    33,
    35,
    36,
)
BAD_JOG = 16

_MAX_LINE = 10_000_000
_INCH_MM = 25.4
_AXES = "XYZ"
_NUMERIC = b"0123456789.+- "
_ORDINARY = frozenset(b"NGXYZFS")
_PLANES = {170: (0, 1, 2), 180: (2, 0, 1), 190: (1, 2, 0)}
_FREE = frozenset("NFST")  # words that are never left over
_JOG_CODES = frozenset((200, 210, 900, 910, 530))


@lru_cache(maxsize=256)
def _is_ordinary(letters: bytes) -> bool:
    """The letters of a line are those of one straight move, none of them twice."""
    return bool(letters) and len(set(letters)) == len(letters) and _ORDINARY.issuperset(letters)


@dataclass
class Modal:
    """The parser state, codes ten times the number. feed [mm/min, or 1/min under G93]."""

    motion: int = 0
    wcs: int = 540
    plane: int = 170
    units: int = 210
    distance: int = 900
    feed_mode: int = 940
    tool_length: int = 490
    retract: int = 980
    spindle: int = 5
    flood: bool = False
    mist: bool = False
    tool: int = 0
    feed: float = 0.0
    speed: float = 0.0


@dataclass
class Interpreter:
    """Turns lines into actions.

    position_mm : machine coordinates of the last target
    """

    dialect: Dialect
    settings: Settings
    position_mm: Vector = (0.0, 0.0, 0.0)
    modal: Modal = field(default_factory=Modal)
    offsets: Offsets = field(default_factory=Offsets)

    def __post_init__(self) -> None:
        self._hal = self.dialect is GRBLHAL
        self._grammar = Grammar(self.dialect)
        self._outputs: tuple[tuple[str, int, float], ...] = ()
        self._next_tool = 0
        self.refresh()

    def refresh(self) -> None:
        """Settings or offsets have changed."""
        self._laser = self.settings.laser
        self._full = self.settings[30]
        self._floor = min(1.0, self.settings[31] / self._full)
        self.work_offset_mm = self.offsets.total(self.modal.wcs)

    def reset(self) -> None:
        """Back to the state after power-up; stored offsets stay."""
        self.modal = Modal(tool=self.modal.tool)
        self.offsets.reset()
        self._outputs = ()
        self.refresh()

    def interpret(self, line: bytes) -> tuple[Action, ...] | list[Action]:
        """raises: GcodeError; the state is then as before"""
        letters = line.translate(None, _NUMERIC)
        if _is_ordinary(letters):
            words = line.decode().split()
            try:
                if len(words) == len(letters):
                    # Only digits, signs and points are left to float(), and each word has its own
                    # letter: what float() takes is what the firmware takes.
                    motion = self._ordinary({word[0]: float(word[1:]) for word in words})
                    if motion is not None:
                        return (motion,)
            except ValueError:
                pass  # the long way finds the error number
        tokens = tokenise(line)
        return self._block(self._grammar.sort(tokens)) if tokens else ()

    def _ordinary(self, values: dict[str, float]) -> Motion | None:
        """The one straight move that these words ask for; None where it takes a longer look."""
        modal = self.modal
        rapid = False
        code = values.get("G")
        if code != 1.0 and (code is not None or modal.motion != 10):
            if code != 0.0 and (code is not None or modal.motion != 0):
                return None
            rapid = True
        speed = values.get("S", modal.speed)
        feed = values.get("F")
        if feed is None:
            feed = modal.feed
        elif modal.units == 200:
            feed *= _INCH_MM
        line = values.get("N", 0.0)
        if (
            feed <= 0.0
            or not 0.0 <= line <= _MAX_LINE
            or speed < 0.0
            or modal.feed_mode == 930
            or not (self._laser or speed == modal.speed)
        ):
            return None
        scale = 1.0 if modal.units == 210 else _INCH_MM
        x, y, z = self.position_mm
        ox, oy, oz = self.work_offset_mm if modal.distance == 900 else self.position_mm
        if "X" in values:
            x = values["X"] * scale + ox
        if "Y" in values:
            y = values["Y"] * scale + oy
        if "Z" in values:
            z = values["Z"] * scale + oz
        elif "X" not in values and "Y" not in values:
            return None
        modal.motion = 0 if rapid else 10
        modal.feed = feed
        modal.speed = speed
        self.position_mm = target = (x, y, z)
        beam, power = self._beam(rapid)
        outputs, self._outputs = self._outputs, ()
        return Motion(target, feed / 60.0, rapid, int(line), beam, power, self._floor, outputs)

    def jog(self, line: bytes) -> Motion:
        """A `$J=` line: its own feed, units and distance mode; the modal state stays."""
        words = self._grammar.sort(tokenise(line))
        if words.m or not _JOG_CODES.issuperset(words.g.values()):
            raise GcodeError(BAD_JOG)
        values = words.values
        if not values.keys() <= frozenset("NFXYZ"):
            raise GcodeError(BAD_JOG if self._hal else UNUSED)
        if not any(axis in values for axis in _AXES):
            raise GcodeError(NO_AXES)
        if not values.get("F"):
            raise GcodeError(NO_FEED)
        modal = self.modal
        scale = _INCH_MM if words.g.get("units", modal.units) == 200 else 1.0
        target = self._target(
            words, scale, words.g.get("distance", modal.distance), "nonmodal" in words.g
        )
        return Motion(target, values["F"] * scale / 60.0, line=int(values.get("N", 0.0)))

    def _beam(self, rapid: bool) -> tuple[int, float]:
        mode = self.modal.spindle
        if mode == 5 or (rapid and self._laser):
            return BEAM_OFF, 0.0
        power = self.modal.speed / self._full
        if power > 1.0:
            power = 1.0
        return (BEAM_DYNAMIC if mode == 4 and self._laser else BEAM_CONSTANT), power

    def _standing(self, motion: int) -> float:
        """Beam power at standstill, by the spindle state and the motion mode."""
        mode = self.modal.spindle
        if mode == 5 or (self._laser and (mode == 4 or motion not in (10, 20, 30))):
            return 0.0
        return max(min(1.0, self.modal.speed / self._full), self._floor if self.modal.speed else 0)

    def _target(self, words: Words, scale: float, distance: int, machine: bool) -> Vector:
        values = words.values
        if machine:
            base: Vector = (0.0, 0.0, 0.0)
        else:
            base = self.work_offset_mm if distance == 900 else self.position_mm
        x, y, z = (
            values[axis] * scale + base[index] if axis in values else self.position_mm[index]
            for index, axis in enumerate(_AXES)
        )
        return (x, y, z)

    def _block(self, words: Words) -> list[Action]:
        g, m, values = words.g, words.m, words.values
        modal = self.modal
        if values.get("N", 0.0) > _MAX_LINE:
            raise GcodeError(BAD_LINE_NUMBER)
        line = int(values.get("N", 0.0))
        scale = _INCH_MM if g.get("units", modal.units) == 200 else 1.0
        feed_mode = g.get("feed", modal.feed_mode)
        feed = modal.feed if feed_mode == modal.feed_mode == 940 else 0.0
        if "F" in values:
            feed = values["F"] * (scale if feed_mode == 940 else 1.0)
        has_axes = any(axis in values for axis in _AXES)
        if has_axes and words.axes is Axes.NONE:
            words.axes = Axes.MOTION
        used = set(_FREE)
        non_modal = g.get("nonmodal", 0)
        motion = g.get("motion", modal.motion)
        distance = g.get("distance", modal.distance)
        plane = _PLANES[g.get("plane", modal.plane)]
        target = self._target(words, scale, distance, non_modal == 530)

        # Everything that can be refused comes before anything changes.
        if non_modal == 40:
            if "P" not in values:
                raise GcodeError(NO_VALUE)
            used.add("P")
        if non_modal == 530 and motion not in (0, 10):
            raise GcodeError(G53_NEEDS_MOTION)
        offsets_change = self.offsets.prepare(
            words, scale, self.position_mm, modal.wcs, self._hal, used
        )
        moves = words.axes is Axes.MOTION and has_axes
        points: list[Vector] = []
        if words.axes is Axes.MOTION and motion not in (0, 800):
            if motion == 50:
                raise GcodeError(NO_VALUE if "P" not in values else UNSUPPORTED)
            if feed == 0.0:
                raise GcodeError(NO_FEED)
            if not has_axes and motion != 10:
                raise GcodeError(NO_AXES)
        if moves:
            used.update(_AXES)
            if motion == 800:
                raise GcodeError(AXES_UNUSED)
            points = [target]
            if motion in (20, 30):
                points = self._arc(words, scale, target, plane, motion == 20, used)
            elif motion >= 382 and target == self.position_mm:
                raise GcodeError(BAD_TARGET)
        elif non_modal in (280, 300):
            used.update(_AXES)
            points = [target] if has_axes else []
            points.append(self.offsets.stored[non_modal])
        ports = port_actions(m.get("ports"), values, used) if self._hal else None
        if not values.keys() <= used | ({"H", "D"} if self._hal else set()):
            raise GcodeError(UNUSED)

        actions: list[Action] = []
        self._set_speed(words, motion, moves, actions)
        self._set_tool(words, actions)
        if m.get("spindle", modal.spindle) != modal.spindle:
            modal.spindle = m["spindle"]
            actions.append(Spindle(modal.spindle, self._standing(motion)))
        self._set_coolant(m.get("coolant"), actions)
        if ports is not None:
            self._outputs += ports.queued
            actions += ports.actions
        if non_modal == 40:
            actions.append(Dwell(values["P"]))
        modal.feed_mode, modal.feed = feed_mode, feed
        modal.plane = g.get("plane", modal.plane)
        modal.units = g.get("units", modal.units)
        modal.wcs = g.get("wcs", modal.wcs)
        modal.distance = distance
        modal.retract = g.get("retract", modal.retract)
        modal.tool_length = g.get("tool length", modal.tool_length)
        if offsets_change is not None:
            offsets_change()
        self.work_offset_mm = self.offsets.total(modal.wcs)
        if points:
            rapid = non_modal in (280, 300) or motion == 0
            rate = feed if feed_mode == 940 else feed * self._length(points)
            beam, power = self._beam(rapid or motion >= 382)
            for point in points:
                outputs, self._outputs = self._outputs, ()
                actions.append(
                    Motion(point, rate / 60.0, rapid, line, beam, power, self._floor, outputs)
                )
            self.position_mm = points[-1]
            if moves and motion >= 382:
                actions.append(Probe(alarm=motion in (382, 384)))
        modal.motion = motion
        self._finish(m.get("stop"), actions)
        return actions

    def _arc(
        self,
        words: Words,
        scale: float,
        target: Vector,
        plane: tuple[int, int, int],
        clockwise: bool,
        used: set[str],
    ) -> list[Vector]:
        axis_u, axis_v, _ = plane
        values = words.values
        if _AXES[axis_u] not in values and _AXES[axis_v] not in values:
            raise GcodeError(NO_PLANE_AXES)
        du = target[axis_u] - self.position_mm[axis_u]
        dv = target[axis_v] - self.position_mm[axis_v]
        if "R" in values:
            used.add("R")
            offset = centre_from_radius(du, dv, values["R"] * scale, clockwise)
        else:
            letters = ("IJK"[axis_u], "IJK"[axis_v])
            if not any(letter in values for letter in letters):
                raise GcodeError(NO_OFFSETS)
            used.update(letters)
            offset = (
                values.get(letters[0], 0.0) * scale,
                values.get(letters[1], 0.0) * scale,
            )
            check_radii(du, dv, *offset)
        return chords(self.position_mm, target, offset, plane, clockwise, self.settings[12])

    def _length(self, points: list[Vector]) -> float:
        """Of the path, for inverse-time feed."""
        total, here = 0.0, self.position_mm
        for point in points:
            total += sum((b - a) ** 2 for a, b in zip(here, point, strict=True)) ** 0.5
            here = point
        return total

    def _set_speed(self, words: Words, motion: int, moves: bool, actions: list[Action]) -> None:
        modal = self.modal
        speed = words.values.get("S", modal.speed)
        burning = (10, 20, 30)
        # With M3 the beam burns at standstill, so entering or leaving G1 without a move shows.
        switches = (
            self._laser
            and modal.spindle == 3
            and not moves
            and (modal.motion in burning) != (motion in burning)
        )
        changed = speed != modal.speed
        modal.speed = speed
        if modal.spindle != 5 and (changed or switches) and not (moves and self._laser):
            actions.append(Spindle(modal.spindle, self._standing(motion)))

    def _set_tool(self, words: Words, actions: list[Action]) -> None:
        if "T" in words.values:
            self._next_tool = int(words.values["T"])
            if not self._hal:
                self.modal.tool = self._next_tool
        if "tool" in words.m:
            actions.append(ToolChange())

    def mount_tool(self) -> None:
        """grblHAL: the tool selected by T has been put in and acknowledged."""
        self.modal.tool = self._next_tool

    def _set_coolant(self, code: int | None, actions: list[Action]) -> None:
        modal = self.modal
        if code is None:
            return
        flood, mist = (code == 8 or modal.flood, code == 7 or modal.mist)
        if code == 9:
            flood = mist = False
        if (flood, mist) != (modal.flood, modal.mist):
            modal.flood, modal.mist = flood, mist
            actions.append(Coolant(flood, mist))

    def _finish(self, stop: int | None, actions: list[Action]) -> None:
        modal = self.modal
        if stop in (0, 1):
            if stop == 0:
                actions.append(Pause())
        elif stop is not None:
            modal.motion, modal.plane, modal.distance = 10, 170, 900
            modal.feed_mode, modal.wcs = 940, 540
            modal.spindle, modal.flood, modal.mist = 5, False, False
            self.refresh()
            actions.append(ProgramEnd())
