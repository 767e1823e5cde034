"""What alloy rules changed in a plan, summed over its layers, as figures and in words."""

from __future__ import annotations

from typing import Any

import numpy as np

from lmctl.part.materials.laid_mixtures import BlendCrossing, LaidMixtures
from lmctl.part.materials.ways_round import way_length
from lmctl.plan.sequence.bead_pieces import BeadPieces


class AlloyStatistics:
    """Sums over the layers so far."""

    def __init__(self, mixtures: LaidMixtures) -> None:
        self._mixtures = mixtures
        count = len(mixtures.rules.rules)
        self._changed_mm, self._changed_by = np.zeros(count), np.zeros(count)
        self._least_distance = np.inf
        self._cuts, self._joined_mm, self._places = 0, 0.0, 0

    def add_cuts(self, cuts: int, joined_mm: float) -> None:
        """Cuts of one layer, and length that took the mixture of a neighbouring piece."""
        self._cuts += cuts
        self._joined_mm += joined_mm

    def add_deposit(self, deposit: BeadPieces) -> None:
        """What a layer is predicted to deposit, nothing of it forbidden."""
        self._places += len(deposit.length_mm)
        m = self._mixtures.rules.regions.n_powders
        rule = self._mixtures.allowed.rule_at(deposit.designed[:, :m])
        off = np.abs(deposit.planned - deposit.designed).max(axis=1)
        for number in np.unique(rule[rule >= 0]).tolist():
            own = rule == number
            self._changed_mm[number] += float(deposit.length_mm[own].sum())
            self._changed_by[number] = max(self._changed_by[number], float(off[own].max()))

    def totals(self) -> dict[str, Any]:
        """For `lmctl plan --json`.

        forbidden_places : of the places checked, none, or there is no plan
        alloy_rules : of each rule its reason and source; path whose mixture it changes [mm], and
            the largest change of a fraction; blends that cross it, and how
        """
        rules = self._mixtures.rules.rules
        return {
            "alloy_cuts": self._cuts,
            "alloy_joined_mm": round(self._joined_mm, 3),
            "alloy_checked_places": self._places,
            "forbidden_places": 0,
            "alloy_rules": [
                {"name": rule.name, "reason": rule.reason, "source": rule.source,
                 "margin": rule.margin, "changed_mm": round(float(self._changed_mm[number]), 3),
                 "changed_by": round(float(self._changed_by[number]), 4),
                 "blends": [self._blend(crossing) for crossing in self._crossings(number)]}
                for number, rule in enumerate(rules)],
        }

    def findings(self) -> list[dict[str, str]]:
        """One finding a rule, for the job's verdict."""
        found = []
        for number, rule in enumerate(self._mixtures.rules.rules):
            if not self._changed_mm[number]:
                text = "no mixture of the part is changed"
            else:
                text = (f"{self._changed_mm[number]:.0f} mm of path are made of other mixtures, by "
                        f"up to {self._changed_by[number]:.3f}; ")
                text += "; ".join(map(self._way_text, self._crossings(number))) or (
                    "what was inside is made of the nearest allowed mixture")
            found.append({"level": "ok", "text": f"alloy rule {rule.as_text()}: {text}"})
        if self._cuts:
            joined = (f"; {self._joined_mm:.0f} mm in pieces shorter than half a bead take the "
                      "mixture beside them" if self._joined_mm else "")
            found.append({"level": "ok", "text":
                          f"tracks are cut in {self._cuts} places so that no forbidden mixture is "
                          f"deposited between two others{joined}"})
        return found

    def _crossings(self, number: int) -> list[BlendCrossing]:
        return [one for one in self._mixtures.crossings if number in one.rules]

    def _blend(self, crossing: BlendCrossing) -> dict[str, Any]:
        way = crossing.way
        low, high = (crossing.begin + share * (crossing.end - crossing.begin)
                     for share in crossing.span)
        return {
            "way": "jump" if way is None else "around",
            "from": np.round(low, 4).tolist(), "to": np.round(high, 4).tolist(),
            "mixtures": [] if way is None else np.round(way, 4).tolist(),
            "length": None if way is None else round(way_length(way), 4),
        }

    def _way_text(self, crossing: BlendCrossing) -> str:
        text = self._mixtures.rules.mixture_text
        ends = [edge for edge in crossing.edges if edge is not None]
        if crossing.way is None:
            return "the blend jumps between " + " and ".join(map(text, ends)) if len(
                ends) == 2 else f"the blend ends at {text(ends[0])}"
        middle = crossing.way[len(crossing.way) // 2]
        return f"the blend from {text(ends[0])} to {text(ends[1])} goes round by {text(middle)}"
