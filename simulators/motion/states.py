"""The states of the controller, by the names its status report gives them."""

from __future__ import annotations

from enum import Enum


class ControllerState(Enum):
    __hash__ = object.__hash__  # Enum's own hash runs in Python, and states are looked up often

    IDLE = "Idle"
    RUN = "Run"
    HOLD = "Hold"
    JOG = "Jog"
    HOME = "Home"
    ALARM = "Alarm"
    CHECK = "Check"
    DOOR = "Door"
    SLEEP = "Sleep"
    TOOL = "Tool"


MOVING_STATES = frozenset((ControllerState.RUN, ControllerState.JOG, ControllerState.HOME))
"""States in which the axes may be moving without a stop command."""

SUSPENDED_STATES = frozenset((ControllerState.HOLD, ControllerState.DOOR, ControllerState.SLEEP,
                              ControllerState.TOOL))
"""States in which no line is read from the receive buffer."""
