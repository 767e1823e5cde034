"""Configuration of a simulated motion controller: dialect, buffer sizes, settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class MotionConfig:
    """One simulated controller.

    dialect : "grbl" (Grbl 1.1h) or "grblhal".
    rx_bytes, planner_blocks : as the controller's `$I` reports them; None is the dialect's own
        (Grbl 128 and 15, grblHAL 1024 and 100). One byte of rx_bytes is never usable.
    settings : `$` number to value, over the dialect's defaults; checked as `$n=value` is.
    info : the user info string that `$I` shows in `[VER:...:info]`.
    """

    dialect: str = "grblhal"
    rx_bytes: int | None = None
    planner_blocks: int | None = None
    settings: Mapping[int, float] = field(default_factory=dict)
    info: str = "lmctl-bench"
