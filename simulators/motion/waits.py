"""What a line waits for before it can go on."""

from __future__ import annotations

from collections.abc import Generator
from enum import Enum, auto


class WaitReason(Enum):
    PLANNER_ROOM = auto()
    """a free block in the planner"""
    STANDSTILL = auto()
    """the end of all planned motion"""
    NEVER = auto()
    """a reset"""


Waiting = WaitReason | float
"""A float is an instant on the loop's clock [s]."""

Steps = Generator[Waiting, None, int]
"""A line being executed: yields what it waits for, returns its error number or 0."""
