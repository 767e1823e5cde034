"""Reports of the controller: their fields, format and frequency.

Grbl 1.1 `report.c`: the work offset comes with every 10th report (30th while busy), overrides with
every 10th (20th), both one report after the other at the start and at once when they change.
grblHAL adds the accessories whenever *they* change.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from firmware_protocol.dialect import GRBLHAL, Dialect
from firmware_protocol.messages import (
    FeedbackMessage,
    Message,
    SettingMessage,
    StartupBlockSetting,
    StatusMessage,
)
from firmware_protocol.status import StatusReport
from simulators.motion.actions import Vector
from simulators.motion.auxiliary_outputs import ANALOG_IN, ANALOG_OUT, DIGITAL_IN, DIGITAL_OUT
from simulators.motion.interpreter import GcodeInterpreter
from simulators.motion.offsets import GRBL_WORK_OFFSET_CODES, GRBLHAL_WORK_OFFSET_CODES
from simulators.motion.settings import FirmwareSettings
from simulators.motion.states import MOVING_STATES, ControllerState

_BUSY = MOVING_STATES | {ControllerState.HOLD, ControllerState.DOOR}
_OFFSET_EVERY, _OFFSET_EVERY_BUSY = 10, 30
_OVERRIDES_EVERY, _OVERRIDES_EVERY_BUSY = 10, 20

_MPOS, _BUFFERS, _LINE, _FEED, _PINS, _OFFSET, _OVERRIDES = (1 << bit for bit in range(7))


class ReportFields(NamedTuple):
    """The contents of a status report."""

    state: ControllerState
    substate: int | None
    position_mm: Vector
    offset_mm: Vector
    blocks_free: int
    rx_free: int
    line: int
    feed_mm_min: float
    speed: float
    overrides: tuple[int, int, int]
    accessories: str
    pins: str
    homed: bool
    tool: int
    input_result: int | None


class StatusReporter:
    """Decides which of the occasional fields the next report carries."""

    def __init__(self, dialect: Dialect) -> None:
        self._hal = dialect is GRBLHAL
        self._show_homed = True
        self._offset_mm: Vector = (0.0, 0.0, 0.0)
        self.on_restart()

    def on_restart(self) -> None:
        """Restart the field counters after power-up and every reset."""
        self._offset_in = 1 if self._hal else 0
        self._overrides_in = 0
        self._show_accessories = self._hal
        self._show_reference = True
        self._show_input = False
        self._show_tool = False

    def on_overrides_changed(self) -> None:
        self._overrides_in = 0

    def on_accessories_changed(self) -> None:
        """grblHAL reports accessories alone, Grbl only together with the overrides."""
        if self._hal:
            self._show_accessories = True
        else:
            self._overrides_in = 0

    def on_homed_changed(self) -> None:
        self._show_homed = True

    def on_tool_requested(self) -> None:
        self._show_tool = True

    def on_input_read(self) -> None:
        self._show_input = True

    def next_report(self, now: ReportFields, mask: int, everything: bool = False) -> StatusMessage:
        """The next report under the `$10` mask; everything: with all fields (0x87)."""
        if not self._hal:
            mask = (mask & (_MPOS | _BUFFERS)) | _FEED | _PINS | _OFFSET | _OVERRIDES
        if now.offset_mm != self._offset_mm:
            self._offset_mm = now.offset_mm
            self._offset_in = 0
        if everything:
            self._offset_in = self._overrides_in = 0
            self._show_accessories = self._show_homed = self._show_reference = True
        offset, overrides = self._due(now.state, mask, everything)
        accessories = None
        if self._show_accessories or (overrides and now.accessories):
            accessories = now.accessories
        # asked for with every report, but once with the tool instead
        if now.state is ControllerState.TOOL:
            accessories = now.accessories + ("" if self._show_tool else "T")
        self._show_accessories = False
        (x, y, z), (ox, oy, oz) = now.position_mm, now.offset_mm
        work = (x - ox, y - oy, z - oz)
        return StatusMessage(
            StatusReport(
                state=now.state.value,
                substate=now.substate,
                machine_mm=now.position_mm if mask & _MPOS else None,
                work_mm=None if mask & _MPOS else work,
                planner_blocks_free=now.blocks_free if mask & _BUFFERS else None,
                rx_bytes_free=now.rx_free if mask & _BUFFERS else None,
                line_number=now.line if mask & _LINE and now.line else None,
                feed_mm_min=now.feed_mm_min if mask & _FEED else None,
                spindle_speed=now.speed if mask & _FEED else None,
                active_pins=now.pins if mask & _PINS and now.pins else None,
                offset_mm=now.offset_mm if offset else None,
                override_percents=now.overrides if overrides else None,
                accessories=accessories,
                unknown_fields=tuple(self._others(now, everything)),
            )
        )

    def _due(self, state: ControllerState, mask: int, everything: bool) -> tuple[bool, bool]:
        busy = state in _BUSY
        offset = overrides = False
        if mask & _OFFSET:
            if self._offset_in > 0:
                self._offset_in -= 1
            else:
                offset = True
                self._offset_in = (_OFFSET_EVERY_BUSY if busy else _OFFSET_EVERY) - 1
                if self._overrides_in == 0 and not everything:
                    self._overrides_in = 1
        if mask & _OVERRIDES:
            if self._overrides_in > 0:
                self._overrides_in -= 1
            else:
                overrides = True
                self._overrides_in = (_OVERRIDES_EVERY_BUSY if busy else _OVERRIDES_EVERY) - 1
        return offset, overrides

    def _others(self, now: ReportFields, everything: bool) -> Iterator[tuple[str, str]]:
        if not self._hal:
            return
        if self._show_homed:
            yield "H", str(int(now.homed))
        if self._show_tool:
            yield "T", str(now.tool)
        if self._show_reference:
            yield "TLR", "0"
        if self._show_input and now.input_result is not None:
            yield "In", str(now.input_result)
        if everything:
            yield "FW", "grblHAL"
        self._show_homed = self._show_reference = False
        self._show_tool = self._show_input = False


def identity_lines(dialect: Dialect, info: str, planner_blocks: int,
                   rx_bytes: int) -> list[Message]:
    """`$I`."""
    options = f"{dialect.options},{planner_blocks},{rx_bytes}"
    if dialect is not GRBLHAL:
        return [FeedbackMessage("VER", f"{dialect.version}:{info}"),
                FeedbackMessage("OPT", options)]
    return [
        FeedbackMessage("VER", f"{dialect.version}:{info}"),
        FeedbackMessage("OPT", f"{options},3,0"),
        FeedbackMessage("AXS", "3:XYZ"),
        FeedbackMessage("NEWOPT", "ENUMS,RT+,TC,SED"),
        FeedbackMessage("FIRMWARE", "grblHAL"),
        FeedbackMessage("SIGNALS", "D"),
        FeedbackMessage("NVS STORAGE", "*EEPROM"),
        FeedbackMessage("DRIVER", "Simulator"),
        FeedbackMessage("DRIVER VERSION", "260324"),
        FeedbackMessage("AUX IO", f"{DIGITAL_IN},{DIGITAL_OUT},{ANALOG_IN},{ANALOG_OUT}"),
    ]


def parser_state_line(dialect: Dialect, interpreter: GcodeInterpreter) -> FeedbackMessage:
    """`$G`."""
    modal = interpreter.modal
    hal = dialect is GRBLHAL
    codes = [modal.motion, modal.wcs, modal.plane, modal.units, modal.distance, modal.feed_mode]
    if hal:
        codes += [400, modal.tool_length, modal.retract, 500]
    words = [f"G{code // 10}" + (f".{code % 10}" if code % 10 else "") for code in codes]
    words.append(f"M{modal.spindle}")
    words += [word for word, on in (("M7", modal.mist), ("M8", modal.flood)) if on]
    if not (modal.mist or modal.flood):
        words.append("M9")
    words += [f"T{modal.tool}", f"F{modal.feed:.0f}", f"S{modal.speed:.0f}" + ("." if hal else "")]
    return FeedbackMessage("GC", " ".join(words))


def parameter_lines(dialect: Dialect, interpreter: GcodeInterpreter,
                    probed_mm: Vector) -> list[Message]:
    """`$#`."""
    offsets = interpreter.offsets
    hal = dialect is GRBLHAL
    named = [
        (f"G{code // 10}" + (f".{code % 10}" if code % 10 else ""), offsets.systems[code])
        for code in (GRBLHAL_WORK_OFFSET_CODES if hal else GRBL_WORK_OFFSET_CODES)
    ]
    named += [("G28", offsets.stored[280]), ("G30", offsets.stored[300]), ("G92", offsets.g92)]
    messages: list[Message] = [FeedbackMessage(name, _vector(value)) for name, value in named]
    messages.append(FeedbackMessage("TLO",
                                    _vector(offsets.tool) if hal else f"{offsets.tool[2]:.3f}"))
    messages.append(FeedbackMessage("PRB", f"{_vector(probed_mm)}:0"))
    return messages


def settings_listing(settings: FirmwareSettings) -> list[Message]:
    """`$$`."""
    return [SettingMessage(number, value) for number, value in settings.listing()]


def startup_listing(lines: dict[int, str]) -> list[Message]:
    """`$N`."""
    return [StartupBlockSetting(number, block) for number, block in sorted(lines.items())]


def _vector(value: Vector) -> str:
    return ",".join(f"{axis:.3f}" for axis in value)
