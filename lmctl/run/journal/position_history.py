"""What a machine's journal proves of the position of a controller without homing ($22=0).

Such a controller counts its steps from where it was switched on, and calls that place 0, 0, 0.
One that has restarted, or was moved while it was off, reports positions that look like any other.
So every command notes where it left the machine, and every run by which way it moves it before
the job. A position that this does not explain is lost until the operator has stated it on every
axis (`lmctl machine offset --here`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.machine import MotionSettings

#: A machine that has not moved reports the same place [mm]: reports have three decimals.
SAME_MM = 0.0015

#: A machine this near to a way that it was sent is on it [mm]: steps and rounding are finer.
_ON_WAY_MM = 0.05

_AXES = frozenset("XYZ")


@dataclass(frozen=True)
class PositionHistory:
    """The journal of one machine, as far as it concerns the position.

    left_mm : machine coordinates where it was last seen; None where no command has seen it
    lost : why its position is lost, in words; "" where it is not, or has been stated since
    stated_axes : the axes on which it has been stated since it was lost
    broken_off : the act under way when its host died, in words; "" where every act has ended
    way_mm : (n, 3) machine coordinates, the way to the purge position that a run broken off was to
        take; empty where there is none
    is_stated_since_run : whether the operator has stated every axis since the last run
    """

    left_mm: tuple[float, ...] | None = None
    lost: str = ""
    stated_axes: frozenset[str] = frozenset()
    broken_off: str = ""
    way_mm: tuple[tuple[float, ...], ...] = ()
    is_stated_since_run: bool = False

    def why_lost(self, at_mm: Sequence[float]) -> str:
        """Why a position in machine coordinates is not that of the machine; "" where it may be."""
        at = tuple(at_mm)
        if self.lost:
            return self.lost
        if self.broken_off:
            if any(at) and (self._is_where_left(at) or _is_on(self.way_mm, at)):
                return ""
            return f"{_power_cycled(at)}{self.broken_off} was broken off, and has not said where"
        if self.left_mm is None or self._is_where_left(at):
            return ""
        return (f"{_power_cycled(at)}it says {point_text(at)}, and was left at "
                f"{point_text(self.left_mm)}")

    def _is_where_left(self, at_mm: Sequence[float]) -> bool:
        return self.left_mm is not None and len(self.left_mm) == len(at_mm) and all(
            abs(now - then) < SAME_MM for now, then in zip(at_mm, self.left_mm, strict=True))


def read_position_history(records: Iterable[dict[str, Any]]) -> PositionHistory:
    """What the records of one machine's journal prove, in their order."""
    before = history = PositionHistory()
    act: dict[str, Any] = {}
    for record in records:
        if record["kind"] == "act":
            act, before = record, history
            history = _begun(history, act)
        elif record["kind"] == "ended":
            # One that never came to the machine has changed nothing.
            history = _ended(history, act, record) if record.get("seen") else before
    return history


def _begun(history: PositionHistory, act: dict[str, Any]) -> PositionHistory:
    if act["do"] != "run":
        return replace(history, broken_off=f"`lmctl machine {act['do']}`", way_mm=())
    return replace(
        history, left_mm=_point(act.get("from_mm")) or history.left_mm, broken_off=str(act["run"]),
        way_mm=tuple(map(tuple, act.get("way_mm") or ())), is_stated_since_run=False,
        # A run begins only where the position is known, or its operator has restored it.
        lost="", stated_axes=frozenset(),
    )


def _ended(
    history: PositionHistory, act: dict[str, Any], record: dict[str, Any]
) -> PositionHistory:
    lost = str(record.get("lost") or "")
    stated = history.stated_axes if history.lost else frozenset()
    if act.get("here") and "why" not in record:
        stated |= set(act.get("axes") or ())
    whole = stated >= _AXES
    return PositionHistory(
        _point(record.get("machine_mm")) or history.left_mm, "" if whole else lost,
        frozenset() if whole else stated,
        is_stated_since_run=whole or (history.is_stated_since_run and not lost),
    )


def way_to_purge_mm(at_mm: Sequence[float], motion: MotionSettings) -> FloatArray:
    """The way to the purge position in program coordinates, (4, 3): up off the part, across, down.

    at_mm : where the machine is, program coordinates
    """
    purge = np.array(motion.purge_mm, dtype=np.float64)
    at = np.array(at_mm[:3], dtype=np.float64)
    height_mm = min(max(purge[2], at[2] + motion.clearance_mm), motion.travel_mm.z[1])
    return np.array([at, [*at[:2], height_mm], [*purge[:2], height_mm], purge])


def point_text(at_mm: Iterable[float]) -> str:
    """A place in words."""
    return " ".join(f"{axis}{value:.3f}" for axis, value in zip("XYZ", at_mm, strict=False))


def _power_cycled(at_mm: Sequence[float]) -> str:
    if any(at_mm):
        return ""
    return "it says 0, 0, 0, as every controller does that was switched off and on; "


def _is_on(way_mm: Sequence[Sequence[float]], at_mm: Sequence[float]) -> bool:
    if len(way_mm) < 2:
        return False
    way, at = np.asarray(way_mm, dtype=np.float64), np.asarray(at_mm[:3], dtype=np.float64)
    along = np.diff(way, axis=0)
    length2 = np.einsum("ij,ij->i", along, along)
    share = np.einsum("ij,ij->i", at - way[:-1], along)
    share = np.clip(np.divide(share, length2, out=np.zeros_like(share), where=length2 > 0), 0, 1)
    off_mm = np.linalg.norm(at - (way[:-1] + share[:, None] * along), axis=1)
    return bool(off_mm.min() <= _ON_WAY_MM)


def _point(value: Any) -> tuple[float, ...] | None:
    return tuple(map(float, value)) if isinstance(value, list) and value else None
