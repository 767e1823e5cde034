"""The interlock table as a board for people: one row a rule, with what is found now."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import NamedTuple

from lmctl.config.machine import SafetySettings
from lmctl.run.interlocks.inputs import InterlockInputs
from lmctl.run.interlocks.rule import InterlockRule

OK, FOUND, TRIPPED, NOT_FITTED = "ok", "found", "tripped", "not fitted"

#: What a cell needs for a rule to look at anything; rules that are not listed always do.
_IS_FITTED: dict[str, Callable[[SafetySettings], bool]] = {
    "emergency stop": lambda safety: "estop" in safety.fitted,
    "door": lambda safety: "door" in safety.fitted,
    "laser": lambda safety: bool(
        {"laser_ready", "laser_fault", "back_reflection", "key"} & set(safety.fitted)),
    "chiller": lambda safety: "chiller" in safety.fitted or not (
        safety.chiller_min_L_min is safety.chiller_max_C is None),
    "shield gas": lambda safety: (
        "shield_gas" in safety.fitted or safety.shield_gas_min_L_min is not None),
    "oxygen": lambda safety: "oxygen" in safety.fitted,
    "watchdog relay": lambda safety: safety.relay_timeout_s is not None,
    "extraction": lambda safety: "extraction" in safety.fitted,
}


class InterlockRow(NamedTuple):
    """One rule now.

    state : "ok"; "found": its condition holds, but the run has not reacted (not yet for long
        enough, or the run is held already); "tripped": the run has reacted; "not fitted": the cell
        has no device for it
    what, hint : the finding and what to do about it, "" where there is none
    """

    name: str
    state: str
    what: str = ""
    hint: str = ""


def interlock_row(
    rule: InterlockRule, facts: InterlockInputs, reported: Collection[tuple[str, str]]
) -> InterlockRow:
    """A rule's row. reported : (rule, source) of the findings that the run has reacted to"""
    is_fitted = _IS_FITTED.get(rule.name)
    if is_fitted is not None and facts.limits is not None and not is_fitted(facts.limits):
        return InterlockRow(rule.name, NOT_FITTED)
    found = list(rule.find(facts))
    if not found:
        return InterlockRow(rule.name, OK)
    tripped = [one for one in found if (rule.name, one.source_name) in reported]
    first = (tripped or found)[0]
    return InterlockRow(
        rule.name, TRIPPED if tripped else FOUND, "; ".join(one.text for one in found),
        first.remedy)
