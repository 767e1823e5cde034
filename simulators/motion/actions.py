"""The actions that a line of G-code asks for, in the order of execution."""

from __future__ import annotations

from typing import NamedTuple

Vector = tuple[float, float, float]

BEAM_OFF, BEAM_CONSTANT, BEAM_DYNAMIC = 0, 1, 2


class StraightMove(NamedTuple):
    """One straight move.

    target_mm : machine coordinates
    rate_mm_s : programmed feed; ignored for a rapid
    line : N word, 0 without one
    power : S over its maximum, before any override, when `beam` is not BEAM_OFF
    floor : least power while the beam is on, as a fraction ($31 over $30)
    outputs : (kind, port, value) switched at the moment the move starts (M62, M63, M67)
    """

    target_mm: Vector
    rate_mm_s: float
    rapid: bool = False
    line: int = 0
    beam: int = BEAM_OFF
    power: float = 0.0
    floor: float = 0.0
    outputs: tuple[tuple[str, int, float], ...] = ()


class SetSpindle(NamedTuple):
    """Wait for all motion; then M3, M4 or M5 (mode 3, 4, 5), or a new S that needs the wait.

    standstill_power : beam power at standstill from now on, as a fraction
    """

    mode: int
    standstill_power: float


class SetCoolant(NamedTuple):
    """Wait for all motion; then M7, M8, M9."""

    flood: bool
    mist: bool


class Dwell(NamedTuple):
    """Wait for all motion, then for the dwell time (G4)."""

    seconds: float


class SetOutput(NamedTuple):
    """Wait for all motion; then set an output: "D" digital (M64, M65), "A" analog (M68)."""

    kind: str
    port: int
    value: float


class ReadInput(NamedTuple):
    """Wait for all motion and then for an input, which stays low (M66).

    seconds : how long to wait before the read times out
    result : 0 as read, -1 after a timeout
    """

    seconds: float
    result: int


class ProbeFailure(NamedTuple):
    """The probing move before this action ended without contact (G38.x)."""

    alarm: bool


class ProgramPause(NamedTuple):
    """Wait for all motion, then for a cycle start (M0, M1)."""


class ToolChange(NamedTuple):
    """Wait for all motion, then read no line until a cycle start (M6)."""


class ProgramEnd(NamedTuple):
    """Wait for all motion; outputs off, overrides back to 100 % (M2, M30)."""


Action = (
    StraightMove
    | SetSpindle
    | SetCoolant
    | Dwell
    | SetOutput
    | ReadInput
    | ProbeFailure
    | ProgramPause
    | ToolChange
    | ProgramEnd
)
