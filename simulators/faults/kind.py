"""Definition of a fault kind: its target, its parameters and the expected host reaction."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

ParameterValue = float | int | str | bool


class FaultTarget(Enum):
    """What a fault applies to, and so what the caller must name with it."""

    MOTION = "the motion controller"
    LINK = "the link of a device"  # device
    MODBUS = "a Modbus device"  # device
    FEEDER = "a feeder"  # device
    HOPPER = "a hopper of a feeder"  # device and channel
    SAFETY = "the safety device"
    CELL = "the whole cell"
    HOST = "the host"


class ExpectedReaction(Enum):
    """What a host that controls a run must do on this fault."""

    STOP = "stops beam, motion and powder"
    MAY_STOP = "may go on, or stop"
    CONTINUE = "goes on"


@dataclass(frozen=True)
class FaultParameter:
    """One parameter of a fault: a number from minimum to maximum, one of choices, or a boolean.

    default : None where a value is required. is_integer : the value must be an integer
    """

    name: str
    default: ParameterValue | None
    description: str
    minimum: float = 0.0
    maximum: float = 0.0
    is_integer: bool = False
    choices: tuple[str, ...] = ()

    def reason_invalid(self, value: object) -> str:
        """Return why value is invalid; "" if it is valid."""
        if self.choices:
            wanted = " or ".join(repr(choice) for choice in self.choices)
            return "" if value in self.choices else f"must be {wanted}"
        if isinstance(self.default, bool):
            return "" if isinstance(value, bool) else "must be true or false"
        if isinstance(value, bool) or not isinstance(value,
                                                     int if self.is_integer else int | float):
            return "must be a whole number" if self.is_integer else "must be a number"
        assert isinstance(value, int | float)
        if not self.minimum <= value <= self.maximum:  # not a number is outside, too
            return f"must be from {self.minimum:g} to {self.maximum:g}"
        return ""


@dataclass(frozen=True)
class FaultKind:
    """A kind of fault.

    description : in plain words
    alarm : words that the host's first alarm should contain, "" for none
    is_lasting : the fault stays until it is cleared; otherwise it is a single event
    """

    name: str
    description: str
    target: FaultTarget
    expected_reaction: ExpectedReaction
    alarm: str
    parameters: tuple[FaultParameter, ...] = ()
    is_lasting: bool = False
