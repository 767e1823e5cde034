"""What a kind of fault is: whom it strikes, its parameters, what it asks of the host."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

ParameterValue = float | int | str | bool


class FaultTarget(Enum):
    """What a fault befalls, and so what must be named with it."""

    MOTION = "the motion controller"
    LINK = "the link of a device"  # device
    MODBUS = "a Modbus device"  # device
    FEEDER = "a feeder"  # device
    HOPPER = "a hopper of a feeder"  # device and channel
    SAFETY = "the safety device"
    CELL = "the whole cell"
    HOST = "the host"


class ExpectedReaction(Enum):
    """What a host that controls a run has to do about it."""

    STOP = "stops beam, motion and powder"
    MAY_STOP = "may go on, or stop"
    CONTINUE = "goes on"


@dataclass(frozen=True)
class FaultParameter:
    """One knob of a fault: a number from least to most, one of choices, or yes and no.

    default : None where it must be given. is_integer : an integer
    """

    name: str
    default: ParameterValue | None
    description: str
    minimum: float = 0.0
    maximum: float = 0.0
    is_integer: bool = False
    choices: tuple[str, ...] = ()

    def reason_invalid(self, value: object) -> str:
        """Why value will not do; "" where it will."""
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
    alarm : a word or two that a host's first alarm should have, "" where there is nothing to name
    is_lasting : it stands until it is cleared; otherwise it is over as soon as it has happened
    """

    name: str
    description: str
    target: FaultTarget
    expected_reaction: ExpectedReaction
    alarm: str
    parameters: tuple[FaultParameter, ...] = ()
    is_lasting: bool = False
