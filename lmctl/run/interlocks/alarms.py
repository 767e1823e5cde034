"""What is not as it must be, in plain words: first-out, latched until an operator goes on.

An `Interlock` is what a hold answers: beam and motion down, then powder, and the run waits for its
operator. Everything else that goes wrong ends the run.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from lmctl.errors import MachineError


class Interlock(MachineError):  # noqa: N818 (it is the cell's own word)
    """A reason to hold. name : of the interlock, one alarm a name."""

    def __init__(
        self, name: str, what: str, *, where: str | Sequence[str] = (), hint: str = ""
    ) -> None:
        super().__init__(what, where=where, hint=hint)
        self.name = name

    @classmethod
    def of(cls, name: str, error: MachineError) -> Interlock:
        """The same report as an interlock."""
        return error if isinstance(error, cls) else cls(
            name, error.what, where=error.where, hint=error.hint
        )


class EmergencyStop(MachineError):  # noqa: N818
    """The safety chain is open: the controller is reset at once, and its position is lost."""


@dataclass(frozen=True)
class Alarm:
    """One alarm as operators see it. at_s : machine time since the run began."""

    name: str
    what: str
    where: tuple[str, ...]
    hint: str
    at_s: float


class Alarms:
    """The alarms of a run since it last went on, the first one first."""

    def __init__(self) -> None:
        self._alarms: dict[str, Alarm] = {}

    def __iter__(self) -> Iterator[Alarm]:
        return iter(tuple(self._alarms.values()))

    def __len__(self) -> int:
        return len(self._alarms)

    @property
    def first(self) -> Alarm | None:
        """What came first: the others may follow from it."""
        return next(iter(self._alarms.values()), None)

    def add(self, error: MachineError, at_s: float) -> Alarm | None:
        """Add an alarm; None where it stands already."""
        name = error.name if isinstance(error, Interlock) else error.what
        if name in self._alarms:
            return None
        alarm = self._alarms[name] = Alarm(name, error.what, error.where, error.hint, at_s)
        return alarm

    def acknowledged(self) -> None:
        """The operator has seen them and the run goes on."""
        self._alarms.clear()
