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

#: Grbl's line buffer takes 80 characters; N, four coordinates, F and S need fewer than this.
MAX_LINE = 70

_NUMBER = r"-?[0-9]+(?:\.[0-9]+)?"
_WORD = rf"(?:G(?:[014]|21|90|94)|M[45]|[XYZFSP]{_NUMBER})"
_NUMBERS = re.compile(r"^N([0-9]+) ", re.MULTILINE)
_PROGRAM = re.compile(rf"(?:N[0-9]{{1,7}}(?: {_WORD})+\n)*")


def first_broken_rule(layer: JobLayer, n_materials: int, n_hoppers: int) -> str | None:
    """The first rule this layer breaks, in words, or None."""
    n_lines = len(layer.program)
    lines, flow_s, flow = layer.lines, layer.flow_s, layer.flow_g_s
    if lines.dtype != line_dtype(n_materials) or lines.shape != (n_lines,):
        return f"{n_lines} program lines, but a line table of shape {lines.shape}"
    if n_lines == 0:
        return "no program lines"
    if flow_s.dtype != np.float64 or flow_s.ndim != 1 or len(flow_s) < 2:
        return "fewer than two flow knots"
    if flow.dtype != np.float64 or flow.shape != (len(flow_s), n_hoppers):
        return f"{len(flow_s)} flow knots, but a flow table of shape {flow.shape}"
    return _program_rule(layer) or _table_rule(layer) or _flow_rule(layer)


def _program_rule(layer: JobLayer) -> str | None:
    text = "\n".join(layer.program) + "\n"
    last = layer.first_line + len(layer.program)
    own = [str(line % N_WORD_MODULUS) for line in range(layer.first_line, last)]
    if _NUMBERS.findall(text) != own or max(map(len, layer.program)) > MAX_LINE:
        for at, (line, number) in enumerate(zip(layer.program, own, strict=True), layer.first_line):
            if not line.startswith(f"N{number} "):
                return f"line {at} does not carry its own number"
            if len(line) > MAX_LINE:
                return f"line {at} is longer than {MAX_LINE} characters"
    if text.count("\n") != len(layer.program) or _PROGRAM.fullmatch(text) is None:
        return "a program line holds something else than motion, dwell and beam words"
    return None


def _table_rule(layer: JobLayer) -> str | None:
    lines = layer.lines
    columns = ("end_s", "x_mm", "y_mm", "z_mm", "speed_mm_s", "power_W", "bead_width_mm",
               "fractions")
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
