"""The modal state, and the request of a block once it is checked against that state.

This is the firmware's third step: it makes all remaining checks before anything
changes. Sources: Grbl 1.1 `gcode.c` step 3; NIST RS274/NGC sections 3.5 and 3.6.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import dist

from firmware_protocol.gcode import GcodeError
from simulators.motion.actions import Vector
from simulators.motion.arcs import arc_chords, centre_from_radius, check_radii
from simulators.motion.auxiliary_outputs import PortActions, port_actions
from simulators.motion.offsets import WorkOffsets
from simulators.motion.words import UNSUPPORTED, AxisWordUse, BlockWords

NO_FEED, NO_AXES, BAD_LINE_NUMBER, NO_VALUE = 22, 26, 27, 28
G53_NEEDS_MOTION, AXES_UNUSED, NO_PLANE_AXES = 30, 31, 32
BAD_TARGET, NO_OFFSETS, UNUSED = 33, 35, 36

MAX_LINE_NUMBER = 10_000_000
MM_PER_INCH = 25.4
AXIS_LETTERS = "XYZ"

_PLANES = {170: (0, 1, 2), 180: (2, 0, 1), 190: (1, 2, 0)}
_FREE = frozenset("NFST")  # words that never count as unused
_ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass
class ModalState:
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


@dataclass(frozen=True, slots=True)
class CheckedBlock:
    """The request of a checked block. Nothing in it can be refused any more.

    points : ends of the straight moves to make, machine coordinates
    rate_mm_min : programmed speed along them
    moves : the block is a motion with axis words, and neither G28 nor G30
    change_offsets : call it to apply the change of offsets
    """

    line: int
    motion: int
    feed: float
    points: list[Vector]
    rate_mm_min: float
    rapid: bool
    moves: bool
    dwell_s: float | None
    ports: PortActions | None
    change_offsets: Callable[[], None] | None


def target_position(words: BlockWords, scale: float, base: Vector, position_mm: Vector) -> Vector:
    """Machine coordinates of a block's target. base : origin of its axis words"""
    values = words.values
    x, y, z = (
        values[axis] * scale + base[index] if axis in values else position_mm[index]
        for index, axis in enumerate(AXIS_LETTERS)
    )
    return (x, y, z)


def check_block(
    words: BlockWords,
    modal: ModalState,
    offsets: WorkOffsets,
    position_mm: Vector,
    hal: bool,
    arc_tolerance_mm: float,
) -> CheckedBlock:
    """raises: GcodeError"""
    g, values = words.g, words.values
    line = values.get("N", 0.0)
    if line > MAX_LINE_NUMBER:
        raise GcodeError(BAD_LINE_NUMBER)
    scale = MM_PER_INCH if g.get("units", modal.units) == 200 else 1.0
    feed_mode = g.get("feed", modal.feed_mode)
    feed = modal.feed if feed_mode == modal.feed_mode == 940 else 0.0
    if "F" in values:
        feed = values["F"] * (scale if feed_mode == 940 else 1.0)
    has_axes = not values.keys().isdisjoint(AXIS_LETTERS)
    if has_axes and words.axes is AxisWordUse.NONE:
        words.axes = AxisWordUse.MOTION
    used = set(_FREE)
    non_modal = g.get("nonmodal", 0)
    motion = g.get("motion", modal.motion)
    wcs = g.get("wcs", modal.wcs)
    base = _ZERO
    if non_modal != 530:
        absolute = g.get("distance", modal.distance) == 900
        base = offsets.total(wcs) if absolute else position_mm
    target = target_position(words, scale, base, position_mm)

    dwell_s = None
    if non_modal == 40:
        if "P" not in values:
            raise GcodeError(NO_VALUE)
        used.add("P")
        dwell_s = values["P"]
    if non_modal == 530 and motion not in (0, 10):
        raise GcodeError(G53_NEEDS_MOTION)
    change_offsets = offsets.prepare_change(words, scale, position_mm, wcs, hal, used)
    moves = words.axes is AxisWordUse.MOTION and has_axes
    points: list[Vector] = []
    if words.axes is AxisWordUse.MOTION and motion not in (0, 800):
        if motion == 50:
            raise GcodeError(NO_VALUE if "P" not in values else UNSUPPORTED)
        if feed == 0.0:
            raise GcodeError(NO_FEED)
        if not has_axes and motion != 10:
            raise GcodeError(NO_AXES)
    if words.axes is not AxisWordUse.NONE:
        used.update(AXIS_LETTERS)
    if moves:
        if motion == 800:
            raise GcodeError(AXES_UNUSED)
        points = [target]
        if motion in (20, 30):
            plane = _PLANES[g.get("plane", modal.plane)]
            offset = _centre(words, scale, position_mm, target, plane, motion == 20, used)
            points = arc_chords(position_mm, target, offset, plane, motion == 20, arc_tolerance_mm)
        elif motion >= 382 and target == position_mm:
            raise GcodeError(BAD_TARGET)
    elif non_modal in (280, 300):
        points = [target] if has_axes else []
        points.append(offsets.stored[non_modal])
    ports = port_actions(words.m.get("ports"), values, used) if hal else None
    if not values.keys() <= used:
        raise GcodeError(UNUSED)
    rate_mm_min = feed
    if feed_mode == 930:
        rate_mm_min *= sum(dist(a, b) for a, b in pairwise([position_mm, *points]))
    return CheckedBlock(
        line=int(line),
        motion=motion,
        feed=feed,
        points=points,
        rate_mm_min=rate_mm_min,
        rapid=non_modal in (280, 300) or motion == 0,
        moves=moves,
        dwell_s=dwell_s,
        ports=ports,
        change_offsets=change_offsets,
    )


def _centre(
    words: BlockWords,
    scale: float,
    start: Vector,
    target: Vector,
    plane: tuple[int, int, int],
    clockwise: bool,
    used: set[str],
) -> tuple[float, float]:
    """Offset of an arc's centre from its start, in its plane."""
    axis_u, axis_v, _ = plane
    values = words.values
    if AXIS_LETTERS[axis_u] not in values and AXIS_LETTERS[axis_v] not in values:
        raise GcodeError(NO_PLANE_AXES)
    du, dv = target[axis_u] - start[axis_u], target[axis_v] - start[axis_v]
    if "R" in values:
        used.add("R")
        return centre_from_radius(du, dv, values["R"] * scale, clockwise)
    along_u, along_v = "IJK"[axis_u], "IJK"[axis_v]
    if along_u not in values and along_v not in values:
        raise GcodeError(NO_OFFSETS)
    used.update((along_u, along_v))
    offset = (values.get(along_u, 0.0) * scale, values.get(along_v, 0.0) * scale)
    check_radii(du, dv, *offset)
    return offset
