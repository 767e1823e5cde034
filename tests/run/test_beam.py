"""What is done to beam and motion when something on the host's own side goes wrong."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import pytest

from lmctl.errors import JournalError
from lmctl.run.cell.beam_control import BeamControl


class Motion:
    """Holds and resets, and remembers it."""

    def __init__(self):
        self.done = []

    async def hold(self):
        self.done.append("hold")

    async def reset(self):
        self.done.append("reset")


def test_a_journal_that_cannot_be_written_leaves_no_motion_planned():
    motion = Motion()

    def at_rest():
        motion.done.append("at rest")
        raise JournalError("the disk is full")

    with pytest.raises(JournalError):
        asyncio.run(BeamControl(SimpleNamespace(motion=motion, safety=None)).stop(at_rest, print))
    assert motion.done == ["hold", "at rest", "reset"]
