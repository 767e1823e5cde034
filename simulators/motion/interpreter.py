"""G-code interpreter: turns a line into actions, or into the firmware's error number.

Nothing moves or waits here. The modal state is the state *after* the line, like the firmware's
parser state. The order of a line's actions is the firmware's (Grbl 1.1 `gcode.c` step 4; NIST
RS274/NGC section 3.8). A line with one straight move takes a fast path: see `_ordinary`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from firmware_protocol.dialect import GRBLHAL, Dialect
from firmware_protocol.gcode import GcodeError, tokenise_block
from simulators.motion.actions import (
    BEAM_CONSTANT,
    BEAM_DYNAMIC,
    BEAM_OFF,
    Action,
    Dwell,
    ProbeFailure,
    ProgramEnd,
    ProgramPause,
    SetCoolant,
    SetSpindle,
    StraightMove,
    ToolChange,
    Vector,
)
from simulators.motion.modal import (
    AXIS_LETTERS,
    MAX_LINE_NUMBER,
    MM_PER_INCH,
    NO_AXES,
    NO_FEED,
    UNUSED,
    ModalState,
    check_block,
    target_position,
)
from simulators.motion.offsets import WorkOffsets
from simulators.motion.plain_lines import (
    DIGITS_TO_ZERO_TABLE,
    LETTERS_TO_SPACES_TABLE,
    word_value_extractor,
)
from simulators.motion.settings import FirmwareSettings
from simulators.motion.words import BlockWords, GcodeGrammar

ERROR_INVALID_JOG = 16

_JOG_CODES = frozenset((200, 210, 900, 910, 530))


@dataclass
class GcodeInterpreter:
    """Turns lines into actions.

    position_mm : machine coordinates of the last target
    """

    dialect: Dialect
    settings: FirmwareSettings
    position_mm: Vector = (0.0, 0.0, 0.0)
    modal: ModalState = field(default_factory=ModalState)
    offsets: WorkOffsets = field(default_factory=WorkOffsets)

    def __post_init__(self) -> None:
        self._hal = self.dialect is GRBLHAL
        self._grammar = GcodeGrammar(self.dialect)
        self._outputs: tuple[tuple[str, int, float], ...] = ()
        self._next_tool = 0
        self.on_settings_changed()

    def on_settings_changed(self) -> None:
        """Update after a change of settings or offsets."""
        self._laser = self.settings.is_laser_mode
        self._full = self.settings[30]
        self._floor = min(1.0, self.settings[31] / self._full)
        self.work_offset_mm = self.offsets.total(self.modal.wcs)

    def reset(self) -> None:
        """Restore the state after power-up; stored offsets stay."""
        self.modal = ModalState(tool=self.modal.tool)
        self.offsets.reset()
        self._outputs = ()
        self.on_settings_changed()

    def interpret(self, line: bytes) -> tuple[Action, ...] | list[Action]:
        """raises: GcodeError; the state is then unchanged"""
        pick = word_value_extractor(line.translate(DIGITS_TO_ZERO_TABLE))
        if pick is not None:
            motion = self._ordinary(
                *pick((*map(float, line.translate(LETTERS_TO_SPACES_TABLE).split()), None)))
            if motion is not None:
                return (motion,)
        tokens = tokenise_block(line)
        return self._block(self._grammar.classify_words(tokens)) if tokens else ()

    def _ordinary(
        self,
        line: float | None,
        code: float | None,
        x: float | None,
        y: float | None,
        z: float | None,
        feed: float | None,
        speed: float | None,
    ) -> StraightMove | None:
        """The single straight move of these words; None where the full interpreter is needed."""
        modal = self.modal
        rapid = False
        if code != 1.0 and (code is not None or modal.motion != 10):
            if code != 0.0 and (code is not None or modal.motion != 0):
                return None
            rapid = True
        if x is None and y is None and z is None:
            return None
        if speed is None:
            speed = modal.speed
        if feed is None:
            feed = modal.feed
        elif modal.units == 200:
            feed *= MM_PER_INCH
        if line is None:
            line = 0.0
        if (
            feed <= 0.0
            or not 0.0 <= line <= MAX_LINE_NUMBER
            or speed < 0.0
            or modal.feed_mode == 930
            or not (self._laser or speed == modal.speed)
        ):
            return None
        scale = 1.0 if modal.units == 210 else MM_PER_INCH
        at_x, at_y, at_z = self.position_mm
        ox, oy, oz = self.work_offset_mm if modal.distance == 900 else self.position_mm
        modal.motion = 0 if rapid else 10
        modal.feed = feed
        modal.speed = speed
        self.position_mm = target = (
            at_x if x is None else x * scale + ox,
            at_y if y is None else y * scale + oy,
            at_z if z is None else z * scale + oz,
        )
        beam, power = self._beam(rapid)
        outputs, self._outputs = self._outputs, ()
        return StraightMove(target, feed / 60.0, rapid, int(line), beam, power, self._floor,
                            outputs)

    def interpret_jog(self, line: bytes) -> StraightMove:
        """A `$J=` line has its own feed, units and distance mode; the modal state stays."""
        words = self._grammar.classify_words(tokenise_block(line))
        if words.m or not _JOG_CODES.issuperset(words.g.values()):
            raise GcodeError(ERROR_INVALID_JOG)
        values = words.values
        if not values.keys() <= frozenset("NFXYZ"):
            raise GcodeError(ERROR_INVALID_JOG if self._hal else UNUSED)
        if not any(axis in values for axis in AXIS_LETTERS):
            raise GcodeError(NO_AXES)
        if not values.get("F"):
            raise GcodeError(NO_FEED)
        modal = self.modal
        scale = MM_PER_INCH if words.g.get("units", modal.units) == 200 else 1.0
        base: Vector = (0.0, 0.0, 0.0)
        if "nonmodal" not in words.g:
            absolute = words.g.get("distance", modal.distance) == 900
            base = self.work_offset_mm if absolute else self.position_mm
        target = target_position(words, scale, base, self.position_mm)
        return StraightMove(target, values["F"] * scale / 60.0, line=int(values.get("N", 0.0)))

    def _beam(self, rapid: bool) -> tuple[int, float]:
        mode = self.modal.spindle
        if mode == 5 or (rapid and self._laser):
            return BEAM_OFF, 0.0
        power = self.modal.speed / self._full
        if power > 1.0:
            power = 1.0
        return (BEAM_DYNAMIC if mode == 4 and self._laser else BEAM_CONSTANT), power

    def _standstill_power(self, motion: int) -> float:
        """Beam power at standstill, by the spindle state and the motion mode."""
        mode = self.modal.spindle
        if mode == 5 or (self._laser and (mode == 4 or motion not in (10, 20, 30))):
            return 0.0
        return max(min(1.0, self.modal.speed / self._full), self._floor if self.modal.speed else 0)

    def _block(self, words: BlockWords) -> list[Action]:
        modal, g, m = self.modal, words.g, words.m
        block = check_block(words, modal, self.offsets, self.position_mm, self._hal,
                            self.settings[12])
        motion = block.motion
        actions: list[Action] = []
        self._set_speed(words, motion, block.moves, actions)
        self._set_tool(words, actions)
        if m.get("spindle", modal.spindle) != modal.spindle:
            modal.spindle = m["spindle"]
            actions.append(SetSpindle(modal.spindle, self._standstill_power(motion)))
        self._set_coolant(m.get("coolant"), actions)
        if block.ports is not None:
            self._outputs += block.ports.queued
            actions += block.ports.actions
        if block.dwell_s is not None:
            actions.append(Dwell(block.dwell_s))
        modal.feed = block.feed
        modal.feed_mode = g.get("feed", modal.feed_mode)
        modal.plane = g.get("plane", modal.plane)
        modal.units = g.get("units", modal.units)
        modal.wcs = g.get("wcs", modal.wcs)
        modal.distance = g.get("distance", modal.distance)
        modal.retract = g.get("retract", modal.retract)
        modal.tool_length = g.get("tool length", modal.tool_length)
        if block.change_offsets is not None:
            block.change_offsets()
        self.work_offset_mm = self.offsets.total(modal.wcs)
        if block.points:
            probes = block.moves and motion >= 382
            beam, power = self._beam(block.rapid or probes)
            for point in block.points:
                outputs, self._outputs = self._outputs, ()
                actions.append(
                    StraightMove(
                        point,
                        block.rate_mm_min / 60.0,
                        block.rapid,
                        block.line,
                        beam,
                        power,
                        self._floor,
                        outputs,
                    )
                )
            self.position_mm = block.points[-1]
            if probes:
                actions.append(ProbeFailure(alarm=motion in (382, 384)))
        modal.motion = motion
        self._finish(m.get("stop"), actions)
        return actions

    def _set_speed(self, words: BlockWords, motion: int, moves: bool,
                   actions: list[Action]) -> None:
        modal = self.modal
        speed = words.values.get("S", modal.speed)
        beam_on_motions = (10, 20, 30)
        # With M3 the beam is on at standstill, so entering or leaving G1 without a move matters.
        switches = (
            self._laser
            and modal.spindle == 3
            and not moves
            and (modal.motion in beam_on_motions) != (motion in beam_on_motions)
        )
        changed = speed != modal.speed
        modal.speed = speed
        if modal.spindle != 5 and (changed or switches) and not (moves and self._laser):
            actions.append(SetSpindle(modal.spindle, self._standstill_power(motion)))

    def _set_tool(self, words: BlockWords, actions: list[Action]) -> None:
        if "T" in words.values:
            self._next_tool = int(words.values["T"])
            if not self._hal:
                self.modal.tool = self._next_tool
        if "tool" in words.m:
            actions.append(ToolChange())

    def confirm_tool_change(self) -> None:
        """grblHAL: the operator has loaded and acknowledged the tool selected by T."""
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
            actions.append(SetCoolant(flood, mist))

    def _finish(self, stop: int | None, actions: list[Action]) -> None:
        modal = self.modal
        if stop in (0, 1):
            if stop == 0:
                actions.append(ProgramPause())
        elif stop is not None:
            modal.motion, modal.plane, modal.distance = 10, 170, 900
            modal.feed_mode, modal.wcs = 940, 540
            modal.spindle, modal.flood, modal.mist = 5, False, False
            self.on_settings_changed()
            actions.append(ProgramEnd())
