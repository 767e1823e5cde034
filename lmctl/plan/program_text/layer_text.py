"""The timed lines of one layer as the job holds them: program text, line table, powder flow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.config.machine import LaserSettings
from lmctl.errors import PlanError
from lmctl.job.packed_layer import PackedLayer, pack_layer_arrays
from lmctl.job.schema import LineKind, line_dtype
from lmctl.plan.program_text.line_bytes import (
    COORDINATE_DECIMALS,
    DWELL_DECIMALS,
    FEED_DECIMALS,
    line_bytes,
)
from lmctl.plan.sequence.moves import Moves
from lmctl.plan.sequence.powder_flow import PowderFlow
from lmctl.preflight.s_word import s_word_decimals

#: Millimetres, absolute, units per minute; then dynamic beam power at zero.
OPENING_LINES = ("G21 G90 G94", "M4 S0")
CLOSING_LINES = ("M5",)

#: Most that an S word's rounding may make of a beam's power.
_POWER_OFF = 0.01


@dataclass(frozen=True)
class LayerLines:
    """What the sequence stage hands to the text stage: one layer's lines with their times.

    moves : n lines; end_s : (n,) program time at each line's end; flow : wanted at the nozzle
    first_line, first_path : numbers of the layer's first line and path in the job
    designed : (n, materials) volume fractions of the part file at each line's end, zeros for all
        but beads; None for a layer without beads
    opens, closes : whether the program begins, or ends, with this layer
    """

    index: int
    z_mm: float
    first_line: int
    first_path: int
    moves: Moves
    end_s: FloatArray
    flow: PowderFlow
    designed: FloatArray | None
    laser_settings: LaserSettings
    opens: bool
    closes: bool


def packed_layer(layer: LayerLines) -> PackedLayer:
    """The bytes of a layer, checked against the rules of the job format.

    Raises PlanError where S words cannot express a beam's power.
    """
    moves = layer.moves
    table = np.zeros(len(moves), line_dtype(moves.fractions.shape[1]))
    table["end_s"] = layer.end_s
    table["x_mm"], table["y_mm"], table["z_mm"] = moves.target_mm.T
    table["speed_mm_s"] = moves.feed_mm_s
    table["power_W"] = moves.power_W
    table["bead_width_mm"] = moves.bead_width_mm
    table["path"] = np.where(moves.path >= 0, moves.path + layer.first_path, -1)
    table["kind"] = moves.kind
    table["fractions"] = moves.fractions
    if layer.designed is not None:
        table["designed"] = layer.designed
    return pack_layer_arrays(
        index=layer.index, z_mm=layer.z_mm, first_line=layer.first_line,
        first_path=layer.first_path, program=program_bytes(layer), lines=table,
        flow_s=layer.flow.times_s, flow_g_s=layer.flow.g_s)


def program_bytes(layer: LayerLines) -> bytes:
    """The program text of a layer, a line end after each line.

    Raises PlanError where S words cannot express a beam's power.
    """
    moves = layer.moves
    decimals = s_word_decimals(layer.laser_settings.s_max)
    setup = (OPENING_LINES if layer.opens else ()) + (CLOSING_LINES if layer.closes else ())
    return line_bytes(
        moves.kind, moves.path, _integers(moves.target_mm, COORDINATE_DECIMALS),
        _integers(moves.feed_mm_s * 60, FEED_DECIMALS),
        _integers(_power_words(moves, layer.laser_settings, decimals), decimals),
        _integers(moves.dwell_s, DWELL_DECIMALS), layer.first_line, decimals, setup)


def _integers(values: FloatArray, decimals: int) -> NDArray[np.int64]:
    return np.asarray(np.rint(values * 10**decimals).astype(np.int64))


def _power_words(moves: Moves, laser: LaserSettings, decimals: int) -> FloatArray:
    """Beam power as S words."""
    asked = moves.power_W / laser.max_power_W * laser.s_max
    off = (moves.kind == LineKind.BEAD) & (
        np.abs(np.round(asked, decimals) - asked) > _POWER_OFF * asked)
    if off.any():
        step_W = laser.max_power_W / laser.s_max / 10**decimals
        raise PlanError(
            f"a beam of {moves.power_W[off].min():.3g} W is too weak to be sent to the controller: "
            f"its S words go in steps of {step_W:.3g} W",
            where=f"laser.max_power_W = {laser.max_power_W:g}, laser.s_max = {laser.s_max}",
            hint="raise the material's power_W, with its speed_mm_s",
        )
    return np.asarray(asked)
