"""Rules for every layer of a job, checked when it is written and when it is read.

A job's text goes to the machine unchanged, so a reader trusts nothing: it accepts only the words
that a plan consists of. It refuses `$` commands, real-time characters and bytes above 0x7F. It also
refuses inches, offsets, other frames, words that store values in the controller (G10, G28.1), and
M3, whose beam stays on at standstill.
"""

from __future__ import annotations

import re

import numpy as np

from lmctl.job.schema import N_WORD_MODULUS, JobLayer, LineKind, line_dtype

_MOST_DIGITS = len(str(N_WORD_MODULUS - 1))

#: Grbl's line buffer takes 80 characters; N, four coordinates, F and S need fewer than this.
MAX_LINE = 70

_NUMBER = r"-?[0-9]++(?:\.[0-9]++)?+"
_WORD = rf"(?:[XYZFSP]{_NUMBER}|G(?:[014]|21|90|94)|M[45])"
# Possessive: no word can be read in two ways, so that nothing is ever tried again.
_PROGRAM = re.compile(rf"(?:N[0-9]{{1,7}}+(?: {_WORD})++\n)*+")


def first_broken_rule(layer: JobLayer, n_materials: int, n_hoppers: int) -> str | None:
    """The first rule this layer breaks, in words, or None."""
    n_lines = len(layer.program)
    lines, flow_s, flow = layer.lines, layer.flow_s, layer.flow_g_s
    if lines.dtype != line_dtype(n_materials) or lines.shape != (n_lines,):
        return f"{n_lines} program lines, but a line table of shape {lines.shape}"
    if flow_s.dtype != np.float64 or flow_s.ndim != 1 or len(flow_s) < 2:
        return "fewer than two flow knots"
    if flow.dtype != np.float64 or flow.shape != (len(flow_s), n_hoppers):
        return f"{len(flow_s)} flow knots, but a flow table of shape {flow.shape}"
    return _program_rule(layer) or _table_rule(layer) or _flow_rule(layer)


def _program_rule(layer: JobLayer) -> str | None:
    text = "\n".join(layer.program) + "\n"
    if not _numbers_fit(text.encode("ascii", "replace"), layer.first_line, len(layer.program)):
        for at, line in enumerate(layer.program, layer.first_line):
            if not line.startswith(f"N{at % N_WORD_MODULUS} "):
                return f"line {at} does not carry its own number"
            if len(line) > MAX_LINE:
                return f"line {at} is longer than {MAX_LINE} characters"
    if text.count("\n") != len(layer.program) or _PROGRAM.fullmatch(text) is None:
        return "a program line holds something else than motion, dwell and beam words"
    return None


def _numbers_fit(text: bytes, first_line: int, n_lines: int) -> bool:
    """Whether each of so many lines begins with its own number and a space, and is short enough."""
    data = np.frombuffer(text, np.uint8)
    ends = np.flatnonzero(data == ord("\n"))
    if len(ends) != n_lines:
        return False
    begins = np.append(0, ends[:-1] + 1)
    number = np.arange(first_line, first_line + n_lines) % N_WORD_MODULUS
    digits = 1 + sum((number >= 10**k).astype(np.intp) for k in range(1, _MOST_DIGITS))
    length = ends - begins
    if length.max() > MAX_LINE or (length < digits + 2).any():
        return False
    if (data[begins] != ord("N")).any() or (data[begins + digits + 1] != ord(" ")).any():
        return False
    for place in range(_MOST_DIGITS):  # from the last digit to the first
        has = digits > place
        wanted = ord("0") + number[has] // 10**place % 10
        if (data[(begins + digits - place)[has]] != wanted).any():
            return False
    return True


def _table_rule(layer: JobLayer) -> str | None:
    lines = layer.lines
    columns = ("end_s", "x_mm", "y_mm", "z_mm", "speed_mm_s", "power_W", "bead_width_mm",
               "fractions", "designed")
    if not all(np.isfinite(lines[name]).all() for name in columns):
        return "a line's time, position, speed, power or composition is not a number"
    if (np.diff(lines["end_s"], prepend=layer.flow_s[0]) < 0).any():
        return "program time runs backwards"
    if not np.isin(lines["kind"], [int(kind) for kind in LineKind]).all():
        return "a line is of no known kind"
    beam_off = lines["kind"] != LineKind.BEAD
    if (lines["power_W"] < 0).any() or (lines["power_W"][beam_off] != 0).any():
        return "the beam is on in a line that is no bead"
    if (np.abs(lines["fractions"].sum(axis=1) - 1) > 1e-4).any():
        return "volume fractions do not sum to 1"
    if (lines["fractions"] < 0).any():
        return "a volume fraction is negative"
    return None


def _flow_rule(layer: JobLayer) -> str | None:
    if not (np.isfinite(layer.flow_s).all() and np.isfinite(layer.flow_g_s).all()):
        return "a powder flow or its time is not a number"
    if (np.diff(layer.flow_s) <= 0).any():
        return "times of the powder flow do not rise"
    if (layer.flow_g_s < 0).any():
        return "a powder flow is negative"
    return None
