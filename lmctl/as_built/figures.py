"""The figures of an as-built comparison, as frozen values and as JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from lmctl.as_built.built_volume import BuiltBy

#: Tolerances on volume fractions for which shares are reported.
TOLERANCES = (0.02, 0.03, 0.05)


@dataclass(frozen=True)
class CompositionError:
    """Greatest difference of a volume fraction, weighted by volume or by length; NaN-free.

    mean .. p99 : of the difference; within : {tolerance: share}
    """

    mean: float
    rms: float
    p95: float
    p99: float
    within: dict[float, float]


@dataclass(frozen=True)
class BuiltLayer:
    """One layer: planned and built height of its top above the plate, None where unknown.

    deposited_mm : length of its path with the beam on
    """

    number: int
    planned_mm: float
    built_mm: float | None
    deposited_mm: float


@dataclass(frozen=True)
class MaterialBalance:
    """Where the powder of one material went [g].

    deposited_g : in the part, by its voxels; overspray_g : left the nozzle with the beam on and is
        not in the part; beam_off_g : left the nozzle with the beam off
    unaccounted_g : the rest of fed_g; closure : its share of fed_g
    """

    material: str
    fed_g: float
    deposited_g: float
    overspray_g: float
    beam_off_g: float
    unaccounted_g: float
    closure: float


@dataclass(frozen=True)
class AsBuiltSummary:
    """What a part became.

    built_by : "simulated": the bench's own process; "predicted": by the profile's own model
    design_mm3, built_mm3 : volumes; missing_mm3 : designed and not there; surplus_mm3 : there and
        not designed
    core_mm3, core_void : volume deeper than a bead, and the share of it that is empty; None where
        that is not known
    height_mm, planned_height_mm : mean surface over that core; None where there is none, or it is
        not known
    by_volume : of what lies inside the design; by_path : along the path with the beam on
    """

    built_by: BuiltBy
    design_mm3: float
    built_mm3: float
    missing_mm3: float
    surplus_mm3: float
    core_mm3: float
    core_void: float | None
    height_mm: float | None
    planned_height_mm: float | None
    by_volume: CompositionError | None
    by_path: CompositionError | None
    layers: tuple[BuiltLayer, ...] = ()
    balance: tuple[MaterialBalance, ...] = ()
    notes: tuple[str, ...] = field(default=())

    @property
    def built_over_design(self) -> float:
        return self.built_mm3 / self.design_mm3

    def as_json(self) -> dict[str, Any]:
        """The keys that scripts may rely on; tolerances are texts."""
        found = asdict(self)
        found["built_over_design"] = self.built_over_design
        for by in ("by_volume", "by_path"):
            if found[by] is not None:
                found[by]["within"] = {f"{t:g}": share for t, share in found[by]["within"].items()}
        return found
