"""What a kind of fault is: whom it strikes, its parameters, what it asks of the host."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

Value = float | int | str | bool


class Strikes(Enum):
    """What a fault befalls, and so what must be named with it."""

    MOTION = "the motion controller"
    LINK = "the link of a device"  # device
    MODBUS = "a Modbus device"  # device
    FEEDER = "a feeder"  # device
    HOPPER = "a hopper of a feeder"  # device and channel
    SAFETY = "the safety device"
    CELL = "the whole cell"
    HOST = "the host"


class Host(Enum):
    """What a host that controls a run has to do about it."""

    STOPS = "stops beam, motion and powder"
    MAY_STOP = "may go on, or stop"
    GOES_ON = "goes on"


@dataclass(frozen=True)
class Parameter:
    """One knob of a fault: a number from least to most, one of choices, or yes and no.

    default : None where it must be given. whole : an integer
    """

    name: str
    default: Value | None
    doc: str
    least: float = 0.0
    most: float = 0.0
    whole: bool = False
    choices: tuple[str, ...] = ()

    def mistake(self, value: object) -> str:
        """Why value will not do; "" where it will."""
        if self.choices:
            wanted = " or ".join(repr(choice) for choice in self.choices)
            return "" if value in self.choices else f"must be {wanted}"
        if isinstance(self.default, bool):
            return "" if isinstance(value, bool) else "must be true or false"
        if isinstance(value, bool) or not isinstance(value, int if self.whole else int | float):
            return "must be a whole number" if self.whole else "must be a number"
        assert isinstance(value, int | float)
        if not self.least <= value <= self.most:  # not a number is outside, too
            return f"must be from {self.least:g} to {self.most:g}"
        return ""


@dataclass(frozen=True)
class FaultKind:
    """A kind of fault.

    does : in plain words
    alarm : a word or two that a host's first alarm should have, "" where there is nothing to name
    lasts : it stands until it is cleared; otherwise it is over as soon as it has happened
    """

    name: str
    does: str
    strikes: Strikes
    host: Host
    alarm: str
    parameters: tuple[Parameter, ...] = ()
    lasts: bool = False
