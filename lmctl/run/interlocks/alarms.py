"""Alarms of a run in plain words: first-out, latched until the operator resumes.

An `InterlockError` holds the run: beam and motion stop first, then powder, and the run waits for
its operator. Every other error ends the run. `RunAlarms` lists all of them in the order in which
they were found: the first is the cause, later ones may follow from it. Some causes are reported
after their effects: a controller that loses power is silent before it reports its restart. Such a
cause names the alarms that it explains.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from lmctl.errors import LmctlError, MachineError
from lmctl.machine.feeder.warnings import FeederWarning


class RunTripError(MachineError):
    """A reason to end the run, or to hold it.

    name : of the trip, one alarm a name
    explains : names of alarms that this is the cause of, though they may have come before it
    cleared_s : machine time at which it was no longer so, None while it is active
    """

    def __init__(
        self, name: str, what: str, *, where: str | Sequence[str] = (), hint: str = "",
        explains: Collection[str] = (),
    ) -> None:
        super().__init__(what, where=where, hint=hint)
        self.name = name
        self.explains = frozenset(explains)


class InterlockError(RunTripError):
    """A reason to hold."""

    @classmethod
    def from_error(cls, name: str, error: MachineError) -> InterlockError:
        """The same report as an interlock."""
        return error if isinstance(error, cls) else cls(
            name, error.what, where=error.where, hint=error.hint
        )


class EmergencyStopError(RunTripError):
    """The safety chain is open: the controller is reset at once, and its position is lost."""


@dataclass(frozen=True)
class RunAlarm:
    """One alarm as operators see it.

    at_s : machine time since the run began
    explains : names of alarms that this is the cause of, though they may have come before it
    """

    name: str
    what: str
    where: tuple[str, ...]
    hint: str
    at_s: float
    explains: frozenset[str] = frozenset()
    cleared_s: float | None = None


def _ignore(line: str) -> None:
    pass


class RunAlarms:
    """The alarms of a run since it was last resumed, and the active warnings.

    Iterating gives the cause, then what came with it in the order in which it was found.
    notify : called with a line of text when an alarm or warning appears, and when a warning is over
    warnings : oldest first
    """

    def __init__(self) -> None:
        self.notify: Callable[[str], None] = _ignore
        self.warnings: list[FeederWarning] = []
        self._alarms: dict[str, RunAlarm] = {}

    def __iter__(self) -> Iterator[RunAlarm]:
        cause = self.cause
        if cause is not None:
            yield cause
            yield from [one for one in self._alarms.values() if one is not cause]

    def __len__(self) -> int:
        return len(self._alarms)

    @property
    def cause(self) -> RunAlarm | None:
        """The first alarm, or the one that explains it: the others may follow from it."""
        cause: RunAlarm | None = None
        for alarm in self._alarms.values():
            if cause is None or cause.name in alarm.explains:
                cause = alarm
        return cause

    def add(self, error: LmctlError, at_s: float) -> RunAlarm | None:
        """Add an alarm; None where it is active, or ends one that is active ("… is lost: …")."""
        name = alarm_name_of(error)
        if name in self._alarms or any(
            one.what == error.what or one.what.endswith(f": {error.what}")
            for one in self._alarms.values()
        ):
            return None
        explains = error.explains if isinstance(error, RunTripError) else frozenset()
        before = self.cause
        alarm = RunAlarm(name, error.what, error.where, error.hint, at_s, explains)
        self._alarms[name] = alarm
        hint = f"; what to do: {alarm.hint}" if alarm.hint else ""
        if before is None:
            self.notify(f"alarm: {alarm.what}{hint}")
        elif self.cause is alarm:
            self.notify(f"the cause: {alarm.what}{hint}")
        else:
            self.notify(f"then: {alarm.what}{hint}")
        return alarm

    def set_warning(self, warning: FeederWarning, *, is_active: bool) -> None:
        """A warning has appeared, or is over."""
        if is_active:
            self.warnings.append(warning)
            self.notify(f"warning: {warning.text}; what to do: {warning.remedy}")
        else:
            self.warnings.remove(warning)
            self.notify(f"no longer: {warning.text}")

    def clear(self, name: str, at_s: float) -> RunAlarm | None:
        """An alarm has cleared; it stays in the list. None where none of that name is active."""
        alarm = self._alarms.get(name)
        if alarm is None or alarm.cleared_s is not None:
            return None
        self._alarms[name] = replace(alarm, cleared_s=at_s)
        return self._alarms[name]

    def acknowledge(self) -> None:
        """The operator has acknowledged the alarms and the run resumes."""
        self._alarms.clear()


def alarm_name_of(error: LmctlError) -> str:
    """The name of the alarm that an error is."""
    return error.name if isinstance(error, RunTripError) else error.what
