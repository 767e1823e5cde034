from collections.abc import Callable

import pytest

from firmware_protocol.status import StatusReport, parse_status
from simulators.motion.config import MotionConfig
from simulators.motion.controller import SimulatedController

LASER_CELL = {10: 511, 30: 1000, 32: 1, 110: 6000, 111: 6000, 112: 6000}
LASER_CELL |= {120: 500, 121: 500, 122: 500}


class Rig:
    """A controller on a hand-driven clock, with what it said as lines."""

    def __init__(self, dialect: str, **config) -> None:
        settings = LASER_CELL | ({10: 3} if dialect == "grbl" else {}) | config.pop("settings", {})
        self.controller = SimulatedController(MotionConfig(dialect=dialect, settings=settings,
                                                           **config))
        self.machine = self.controller.machine
        self.trace = self.machine.trace
        self.now_s = 0.0

    def send(self, data: bytes | str) -> list[str]:
        """Write; what comes back at the same instant."""
        if isinstance(data, str):
            data = data.encode("latin-1")
        return self._lines(self.controller.receive(data, self.now_s))

    def wait(self, seconds: float) -> list[str]:
        """Let time pass; what comes back meanwhile."""
        until_s = self.now_s + seconds
        said, vain = b"", 0
        while True:
            due_s = self.controller.next_wake_s()
            if due_s is None or due_s > until_s:
                break
            vain = vain + 1 if due_s <= self.now_s else 0
            assert vain < 10, "woken in vain"
            self.now_s = max(self.now_s, due_s)
            said += self.controller.advance(self.now_s)
        self.now_s = until_s
        said += self.controller.advance(until_s)
        return self._lines(said)

    def ask(self, data: bytes | str, seconds: float = 0.0) -> list[str]:
        """Write, let time pass, and return everything said."""
        return self.send(data) + self.wait(seconds)

    def status(self) -> StatusReport:
        """The answer to `?` now."""
        (text,) = self.send("?")
        report = parse_status(text)
        assert report is not None, text
        return report

    def overrides(self) -> tuple[int, int, int]:
        """As reported; they come one report later when the work offset is due."""
        return self.status().override_percents or self.status().override_percents

    @staticmethod
    def _lines(data: bytes) -> list[str]:
        assert data == b"" or data.endswith(b"\r\n")
        return data.decode("latin-1").split("\r\n")[:-1]


@pytest.fixture(scope="session")
def rig() -> Callable[..., Rig]:
    """Makes rigs: rig("grblhal", settings={...}, planner_blocks=...)."""
    return Rig
