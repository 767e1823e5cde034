"""Moves as program text: what the controller is sent, byte for byte."""

from __future__ import annotations

import numpy as np

from lmctl.config.machine import Laser
from lmctl.errors import PlanError
from lmctl.job.schema import N_WORD_MODULUS, LineKind
from lmctl.plan.moves import Moves
from lmctl.preflight.power_word import power_decimals

#: Millimetres, absolute, units per minute; then dynamic beam power with the beam at nothing.
OPENING = ("G21 G90 G94", "M4 S0")
CLOSING = ("M5",)

#: Most that an S word's rounding may make of a beam's power.
_POWER_OFF = 0.01


def program_text(
    moves: Moves, first_line: int, laser: Laser, texts: dict[int, str]
) -> tuple[str, ...]:
    """One line of text for each move, numbered from `first_line`.

    texts : what to say on SETUP lines, by their index
    A layer states feed and power at its first motion and each path at its lead-in; in between
    they are repeated only where they change. Moves without beam always say S0.
    Raises PlanError where S words cannot say a beam's power.
    """
    x, y, z = (_numbers(moves.target_mm[:, axis], 3) for axis in range(3))
    feed = _numbers(moves.feed_mm_s * 60, 1)
    power = _powers(moves, laser)
    kinds, paths = moves.kind.tolist(), moves.path.tolist()
    program = []
    at_z = at_feed = at_power = ""
    path = -1
    for i, kind in enumerate(kinds):
        number = f"N{(first_line + i) % N_WORD_MODULUS}"
        if kind == LineKind.SETUP:
            program.append(f"{number} {texts[i]}")
            continue
        if kind == LineKind.DWELL:
            program.append(f"{number} G4 P{_number(float(moves.dwell_s[i]), 3)}")
            continue
        if paths[i] != path:
            at_z = at_feed = at_power = ""
            path = paths[i]
        line = f"{number} G1 X{x[i]} Y{y[i]}"
        if z[i] != at_z:
            line += f" Z{z[i]}"
        if feed[i] != at_feed:
            line += f" F{feed[i]}"
        if kind != LineKind.BEAD:
            line += " S0"
            at_power = "0"
        elif power[i] != at_power:
            line += f" S{power[i]}"
            at_power = power[i]
        at_z, at_feed = z[i], feed[i]
        program.append(line)
    return tuple(program)


def _powers(moves: Moves, laser: Laser) -> list[str]:
    decimals = power_decimals(laser.s_max)
    asked = moves.power_W / laser.max_power_W * laser.s_max
    off = np.abs(np.round(asked, decimals) - asked) > _POWER_OFF * asked
    if off.any():
        step_W = laser.max_power_W / laser.s_max / 10**decimals
        raise PlanError(
            f"a beam of {moves.power_W[off].min():.3g} W is too weak to be told to the controller: "
            f"its S words go in steps of {step_W:.3g} W",
            where=f"laser.max_power_W = {laser.max_power_W:g}, laser.s_max = {laser.s_max}",
            hint="raise the material's power_W, with its speed_mm_s",
        )
    return _numbers(asked, decimals)


def _numbers(values: np.ndarray, decimals: int) -> list[str]:
    return [_number(value, decimals) for value in values.tolist()]


def _number(value: float, decimals: int) -> str:
    """Fixed point without needless zeros; no minus zero."""
    text = f"{value:.{decimals}f}"
    if "." in text:
        text = text.rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
