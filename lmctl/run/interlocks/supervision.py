"""Evaluation of the interlock table: which rules hold now, and for how long they have."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from lmctl.errors import MachineError
from lmctl.run.interlocks.alarms import EmergencyStopError, InterlockError
from lmctl.run.interlocks.board import NOT_FITTED, InterlockRow, interlock_row
from lmctl.run.interlocks.inputs import FeederReading, InterlockInputs
from lmctl.run.interlocks.rule import InterlockFinding, InterlockRule, Reaction
from lmctl.run.interlocks.rules import INTERLOCK_RULES

#: Readings may be this much closer together than requested: answers are not exactly periodic [s].
_PUNCTUAL_S = 0.05

#: An interlock that waits for the end of a path waits no longer than this [s].
_PATH_END_S = 60.0


def _ignore(name: str) -> None:
    pass


class InterlockSupervision:
    """Evaluates the rules repeatedly. Pure: the caller passes facts and the time.

    raised : called once for each rule and subject, when it has held for long enough; again only
        after it has not held in between, or after `forget`
    cleared : called with the name of an alarm that was raised, once its rule no longer holds
    has_unconfirmed_findings : a reading has a finding that the next reading must confirm
    """

    def __init__(
        self, raised: Callable[[MachineError], None], rules: Sequence[InterlockRule],
        cleared: Callable[[str], None] = _ignore,
    ) -> None:
        self.has_unconfirmed_findings = False
        self._raised = raised
        self._cleared = cleared
        self._rules = rules
        self._others = tuple(rule for rule in rules if not rule.uses_feeder_readings)
        self._sound: Sequence[FeederReading] | None = None  # answers in which nothing was found
        self._since: dict[tuple[str, str], float] = {}
        self._reported: set[tuple[str, str]] = set()

    def evaluate(self, facts: InterlockInputs, t: float, *, beam_off: bool) -> None:
        """Evaluate all rules at t [s]. beam_off : whether the program has the beam off now."""
        holding: set[tuple[str, str]] = set()
        self.has_unconfirmed_findings = False
        # Most looks come between two answers of a feeder.
        sound = facts.feeder_readings is self._sound
        self._sound = facts.feeder_readings
        for rule in self._others if sound else self._rules:
            for finding in rule.find(facts):
                if rule.uses_feeder_readings:
                    self._sound = None
                key = rule.name, finding.source_name
                holding.add(key)
                at_s, due_s = t, rule.min_duration_s
                if finding.reading_time_s is not None:
                    at_s, due_s = finding.reading_time_s, due_s - _PUNCTUAL_S
                    self.has_unconfirmed_findings = True
                lasted_s = at_s - self._since.setdefault(key, at_s)
                if rule.reaction is Reaction.PATH_END and not beam_off:
                    due_s = _PATH_END_S
                if lasted_s >= due_s and key not in self._reported:
                    self._reported.add(key)
                    self._raised(alarm_of_finding(rule, finding))
        for key in self._since.keys() - holding:
            del self._since[key]
            if key in self._reported:
                self._reported.discard(key)
                self._cleared(_alarm_name(*key))

    def acknowledge(self) -> None:
        """Alarms have been acknowledged: report again what still holds."""
        self._reported.clear()

    def active_alarms(self, facts: InterlockInputs) -> list[MachineError]:
        """Rules that hold now, for however short a time, and that acknowledging would not clear."""
        return [
            alarm_of_finding(rule, finding)
            for rule in self._rules if not rule.is_latched
            for finding in rule.find(facts)
        ]


    def board(self, facts: InterlockInputs) -> list[InterlockRow]:
        """Every row of the table as it is now, also of rules that this cell has no device for."""
        return [
            interlock_row(rule, facts, self._reported) if rule in self._rules
            else InterlockRow(rule.name, NOT_FITTED)
            for rule in INTERLOCK_RULES
        ]


def _alarm_name(rule: str, subject: str) -> str:
    return f"{rule} {subject}".strip()


def alarm_of_finding(rule: InterlockRule, finding: InterlockFinding) -> MachineError:
    """A finding in the form that the run acts on."""
    kind = EmergencyStopError if rule.reaction is Reaction.RESET else InterlockError
    name = _alarm_name(rule.name, finding.source_name)
    return kind(name, finding.text, where=f"interlock: {rule.name}", hint=finding.remedy)
