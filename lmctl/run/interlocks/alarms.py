"""What is not as it must be, in plain words: first-out, latched until an operator goes on.

An `Interlock` is what a hold answers: beam and motion down, then powder, and the run waits for its
operator. Everything else that goes wrong ends the run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from lmctl.errors import MachineError
from lmctl.machine.feeder.warnings import FeederWarning


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


def _tell_nobody(line: str) -> None:
    pass


class Alarms:
    """The alarms of a run since it last went on, the first one first, and the warnings that stand.

    told : called with a line for people as an alarm or warning comes, and as a warning is over
    warnings : oldest first
    """

    def __init__(self) -> None:
        self.told: Callable[[str], None] = _tell_nobody
        self.warnings: list[FeederWarning] = []
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
        self.told(f"alarm: {alarm.what}" + (f"; what to do: {alarm.hint}" if alarm.hint else ""))
        return alarm

    def warn(self, warning: FeederWarning, *, stands: bool) -> None:
        """A warning has appeared, or is over."""
        if stands:
            self.warnings.append(warning)
            self.told(f"warning: {warning.what}; what to do: {warning.hint}")
        else:
            self.warnings.remove(warning)
            self.told(f"no longer: {warning.what}")

    def acknowledged(self) -> None:
        """The operator has seen them and the run goes on."""
        self._alarms.clear()
