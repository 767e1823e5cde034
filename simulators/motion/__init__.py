"""A simulated motion controller with the protocol, planner and motion of Grbl 1.1h and grblHAL.

`sim = MotionSimulator(MotionConfig(...))` is the controller on the running loop's clock;
`server.serve_tcp(sim, host, port)` and `server.open_pty(sim)` put it on a port;
`sim.trace` is the exact record of what was executed.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simulators.motion.config import MotionConfig as MotionConfig
    from simulators.motion.settings import FirmwareSettings as FirmwareSettings
    from simulators.motion.settings import SettingError as SettingError
    from simulators.motion.simulator import MotionSimulator as MotionSimulator
    from simulators.motion.trace import MotionTrace as MotionTrace

#: Public names and the modules that hold them; a module is loaded on first use.
_HOMES = {
    "FirmwareSettings": "simulators.motion.settings",
    "MotionConfig": "simulators.motion.config",
    "MotionSimulator": "simulators.motion.simulator",
    "MotionTrace": "simulators.motion.trace",
    "SettingError": "simulators.motion.settings",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
