"""Whether a part's alloy rules can be kept at all, before any geometry is made."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmctl.errors import PlanError
from lmctl.part.materials.laid_mixtures import BlendCrossing, LaidMixtures


def alloy_problems(mixtures: LaidMixtures, dilution: float) -> list[PlanError]:
    """Everything that alloy rules make impossible in a part, each with the rule's reason.

    dilution : least share of what lies beneath or beside it that a bead melts; 0 where it is not
        known

    Mixtures that the part names and a rule forbids, blends that have to go round a region and
    cannot, jumps whose first bead would be a forbidden mixture with what it melts beneath it, and
    rules that leave no mixture.
    """
    rules = mixtures.rules
    if len(mixtures.grid) == 0:
        return [PlanError(
            "the alloy rules of the part forbid every mixture of its materials",
            where=[rule.as_text() for rule in rules.rules],
            hint="narrow their regions, or lower their margins")]
    return [*_forbidden_names(mixtures), *_without_way(mixtures),
            *_diluted_jumps(mixtures, dilution)]


def _forbidden_names(mixtures: LaidMixtures) -> Iterator[PlanError]:
    rules = mixtures.rules
    for mixture, number in zip(rules.named, rules.regions.rule_at(rules.named), strict=True):
        if number < 0:
            continue
        nearest = mixtures.nearest_allowed(mixture)
        yield PlanError(
            f"the part wants {rules.mixture_text(mixture)}, which an alloy rule forbids",
            where=rules.rules[number].as_text(),
            hint="" if nearest is None else
            f"the nearest allowed mixture is {rules.mixture_text(nearest)}")


def _without_way(mixtures: LaidMixtures) -> Iterator[PlanError]:
    rules = mixtures.rules
    for crossing in mixtures.crossings:
        stays = [rules.rules[number] for number in crossing.rules
                 if rules.rules[number].way == "around"]
        at_end = any(edge is None for edge in crossing.edges)  # reported as a mixture
        if not stays or crossing.way is not None or at_end:
            continue
        powders = [name for name, through in zip(
            rules.materials, np.all([rule.through for rule in stays], axis=0), strict=True)
            if through]
        yield PlanError(
            f"no way leads round from {_ends(mixtures, crossing)}",
            where=(stays[0].as_text(), f"through {', '.join(powders)}"),
            hint='allow other powders in `through`, lower `margin`, or say way = "jump"')


def _diluted_jumps(mixtures: LaidMixtures, share: float) -> Iterator[PlanError]:
    rules = mixtures.rules
    for crossing in mixtures.crossings:
        first, last = crossing.edges
        if crossing.way is not None or first is None or last is None:
            continue
        beads = np.array([(1 - share) * last + share * first, (1 - share) * first + share * last])
        number = rules.regions.rule_at(beads)
        if share and (number >= 0).any():
            worst = int(np.argmax(number >= 0))
            yield PlanError(
                f"a jump from {_ends(mixtures, crossing)} is an impossible pair: with "
                f"{share:.0%} dilution, the least of the profile, its first bead is "
                f"{rules.mixture_text(beads[worst])}",
                where=rules.rules[number[worst]].as_text(),
                hint='lead the blend round through another powder (way = "around"), or plan with '
                     'process.dilution = "ignore"')


def _ends(mixtures: LaidMixtures, crossing: BlendCrossing) -> str:
    text = mixtures.rules.mixture_text
    return " to ".join(text(edge) for edge in crossing.edges if edge is not None)
