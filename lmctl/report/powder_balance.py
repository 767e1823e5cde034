"""Where the powder of a part went, hopper by hopper, as far as anybody reported or weighed it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lmctl.report.part_record import PartRecord


@dataclass(frozen=True)
class PowderBalance:
    """One hopper, over all runs [g].

    planned_g : in the layers of the record; fed_g : in them, as the feeder reported its disc
    purged_g : into no layer, reported; weighed_g : weight lost in the layers, None where the hopper
        did not weigh throughout; refilled_g : as operators stated it
    caught_g : of what was fed in layers, in the part by the catch efficiency of the plan: it is
        predicted; None where the job does not say
    """

    hopper: str
    material: str
    planned_g: float
    fed_g: float
    purged_g: float
    weighed_g: float | None
    refilled_g: float
    caught_g: float | None

    @property
    def used_g(self) -> float:
        """All that left the hopper, as reported."""
        return self.fed_g + self.purged_g

    @property
    def lost_g(self) -> float | None:
        """Used and not in the part, None where that is not known."""
        return None if self.caught_g is None else self.used_g - self.caught_g


def powder_balances(
    record: PartRecord, caught_fractions: Mapping[str, float]
) -> tuple[PowderBalance, ...]:
    """One a hopper, in the job's order.

    caught_fractions : {material: share of the powder fed in layers that the plan has in the part}
    """
    planned, executed = record.planned.powder_g, record.executed.powder_g
    weighed_g, purged_g, refilled_g = record.weighed_g, record.purged_g, record.refilled_g
    found = []
    for hopper in record.runs[0].header.get("hoppers", []):
        name, material = str(hopper["name"]), str(hopper["material"])
        fed_g = executed.get(name, 0.0)
        share = caught_fractions.get(material)
        found.append(PowderBalance(
            name, material, planned.get(name, 0.0), fed_g, purged_g.get(name, 0.0),
            weighed_g.get(name), refilled_g.get(name, 0.0),
            None if share is None else share * fed_g))
    return tuple(found)
