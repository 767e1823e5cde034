"""Arcs as the firmware generates them: chords that stay within $12 of the circle."""

from __future__ import annotations

from math import atan2, cos, floor, hypot, pi, sin, sqrt

from firmware_protocol.gcode import GcodeError
from simulators.motion.actions import Vector

BAD_TARGET, BAD_RADIUS = 33, 34

_SAME_ANGLE = 5e-7  # ARC_ANGULAR_TRAVEL_EPSILON: less is a full circle


def centre_from_radius(du: float, dv: float, radius: float, clockwise: bool) -> tuple[float, float]:
    """Offset of the centre from the start, for a chord (du, dv) and the R word.

    A negative radius selects the longer arc. NIST RS274/NGC 3.5.3.1.
    raises : GcodeError 33 without a chord, 34 where the radius cannot span it
    """
    chord = hypot(du, dv)
    if chord == 0.0:
        raise GcodeError(BAD_TARGET)
    square = 4.0 * radius * radius - chord * chord
    if square < 0.0:
        raise GcodeError(BAD_RADIUS)
    height = -sqrt(square) / chord
    if not clockwise:
        height = -height
    if radius < 0.0:
        height = -height
    return 0.5 * (du - dv * height), 0.5 * (dv + du * height)


def check_radii(du: float, dv: float, offset_u: float, offset_v: float) -> None:
    """raises: GcodeError 33 where start and end lie on different circles (0.1 % or 0.005 mm)"""
    start, end = hypot(offset_u, offset_v), hypot(du - offset_u, dv - offset_v)
    difference = abs(end - start)
    if difference > 0.005 and (difference > 0.5 or difference > 0.001 * start):
        raise GcodeError(BAD_TARGET)


def arc_chords(
    start: Vector,
    end: Vector,
    offset: tuple[float, float],
    plane: tuple[int, int, int],
    clockwise: bool,
    tolerance_mm: float,
) -> list[Vector]:
    """End points of the chords from start to end; the last one is exactly the end.

    offset : of the centre from the start, along the plane's first two axes
    plane : indices of its two axes and of the third, along which the arc is a helix
    """
    axis_u, axis_v, axis_w = plane
    centre_u, centre_v = start[axis_u] + offset[0], start[axis_v] + offset[1]
    radius = hypot(*offset)
    at = atan2(-offset[1], -offset[0])
    travel = atan2(end[axis_v] - centre_v, end[axis_u] - centre_u) - at
    travel = (travel + pi) % (2.0 * pi) - pi
    if clockwise:
        if travel >= -_SAME_ANGLE:
            travel -= 2.0 * pi
    elif travel <= _SAME_ANGLE:
        travel += 2.0 * pi
    sagitta = sqrt(max(0.0, tolerance_mm * (2.0 * radius - tolerance_mm)))
    count = floor(abs(0.5 * travel * radius) / sagitta) if sagitta > 0.0 else 0
    points: list[Vector] = []
    for index in range(1, count):
        part = index / count
        point = [0.0, 0.0, 0.0]
        point[axis_u] = centre_u + radius * cos(at + travel * part)
        point[axis_v] = centre_v + radius * sin(at + travel * part)
        point[axis_w] = start[axis_w] + (end[axis_w] - start[axis_w]) * part
        points.append((point[0], point[1], point[2]))
    points.append(end)
    return points
