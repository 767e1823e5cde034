"""Check whether the copies of a part can stand and be deposited beside each other."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.machine import MachineProfile
from lmctl.errors import PlanError
from lmctl.preflight.placement import Placement

if TYPE_CHECKING:
    from lmctl.part.part import Part

#: Sections whose hull stands for the part seen from above.
_SECTIONS = 15
#: Pairs that a message names; the others are counted.
_MOST_NAMED = 10


def copies_findings(
    part: Part, placement: Placement, profile: MachineProfile
) -> Iterator[PlanError]:
    """What keeps copies from being deposited beside each other; each with the names of pairs."""
    gaps = dict(_gaps_mm(part, placement))
    bead = part.process.bead_width_mm
    overlapping = [f"{a!r} and {b!r} overlap by {-gap:.1f} mm" if gap < 0 else
                   f"{a!r} and {b!r} are {gap:.1f} mm apart" for (a, b), gap in gaps.items()
                   if gap < bead]
    if overlapping:
        yield PlanError(
            f"copies stand in each other's way: they must be a bead of {bead:g} mm apart",
            where=_named(overlapping), hint="move them apart in [[copy]]")
    elif part.process.copy_order == "part-by-part":
        yield from _part_by_part(part, placement, profile, gaps)


def _part_by_part(
    part: Part, placement: Placement, profile: MachineProfile,
    gaps: dict[tuple[str, str], float],
) -> Iterator[PlanError]:
    """Whether finished copies are cleared, by travel and by the nozzle beside them."""
    where = 'process.copy_order = "part-by-part"'
    first, top = placement.nozzle_height_mm(0), placement.nozzle_height_mm(placement.n_layers - 1)
    motion = profile.motion
    crossing = max(motion.purge_mm[2], first + motion.clearance_mm)
    if crossing < top:
        yield PlanError(
            f"in a hold the nozzle would cross finished copies at {crossing:.1f} mm; they are "
            f"{top:.1f} mm tall",
            where=[where, f"motion.clearance_mm = {motion.clearance_mm:g}, motion.purge_mm z = "
                          f"{motion.purge_mm[2]:g}"],
            hint=f"raise one of them in the machine profile to {np.ceil(top):g} or more, or "
                 "deposit layer by layer")
    if profile.nozzle is None:
        yield PlanError("whether the nozzle clears finished copies is not known", where=where,
                        hint="state [nozzle] in the machine profile, or deposit layer by layer")
        return
    needed = profile.nozzle.reach_mm(top - first)
    meets = [f"{a!r} stands {gap:.1f} mm beside {b!r}" for (a, b), gap in gaps.items()
             if gap < needed]
    if meets:
        yield PlanError(
            "the nozzle would run into finished copies: at their height it reaches "
            f"{needed:.1f} mm beside its axis", where=[*_named(meets), where],
            hint="move them apart in [[copy]], or deposit layer by layer")


def _gaps_mm(part: Part, placement: Placement) -> Iterator[tuple[tuple[str, str], float]]:
    """Names of each pair and the gap between their hulls, negative where they overlap."""
    hull = _hull(part, placement)
    if len(hull) < 3:
        return
    grown = 2 * part.process.allowance_mm
    hulls = [copy.places_mm(hull) for copy in part.copies]
    centre = [places.mean(axis=0) for places in hulls]
    radius = float(np.linalg.norm(hulls[0] - centre[0], axis=1).max())
    for i, j in combinations(range(len(hulls)), 2):
        apart = float(np.linalg.norm(centre[i] - centre[j])) - 2 * radius
        gap = apart if apart > radius else hull_gap_mm(hulls[i], hulls[j])
        yield (part.copies[i].name, part.copies[j].name), gap - grown


def _hull(part: Part, placement: Placement) -> FloatArray:
    """The convex hull of the part seen from above, (k, 2), counter-clockwise."""
    layers = np.unique(np.linspace(0, placement.n_layers - 1, _SECTIONS).round().astype(int))
    loops = [loop for layer in layers for loop in part.section(
        placement.cut_height_mm(int(layer))).loops]
    return convex_hull(np.vstack(loops)) if loops else np.empty((0, 2))


def convex_hull(points: FloatArray) -> FloatArray:
    """Corners (k, 2) of the convex hull of points (n, 2), counter-clockwise.

    A. M. Andrew, Another efficient algorithm for convex hulls in two dimensions (1979),
    DOI 10.1016/0020-0190(79)90072-3
    """
    points = np.unique(points, axis=0)  # sorted by x, then y
    chains = []
    for ordered in (points, points[::-1]):
        chain: list[FloatArray] = []
        for point in ordered:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0:
                chain.pop()
            chain.append(point)
        chains.append(chain[:-1])
    return np.array([*chains[0], *chains[1]])


def hull_gap_mm(one: FloatArray, other: FloatArray) -> float:
    """Distance between convex polygons (k, 2), counter-clockwise; negative: how far they overlap.

    The overlap is the shortest way along the normal of an edge that parts them.
    """
    separation = max(_separation(one, other), _separation(other, one))
    if separation <= 0:
        return separation
    return min(_nearest_mm(one, other), _nearest_mm(other, one))


def _separation(one: FloatArray, other: FloatArray) -> float:
    """The greatest gap along the normals of one's edges."""
    edge = np.roll(one, -1, axis=0) - one
    outward = np.column_stack([edge[:, 1], -edge[:, 0]])
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    return float(((outward @ other.T).min(axis=1) - (outward * one).sum(axis=1)).max())


def _nearest_mm(corners: FloatArray, polygon: FloatArray) -> float:
    """Least distance of corners from the edges of a polygon."""
    edge = np.roll(polygon, -1, axis=0) - polygon
    away = corners[:, None] - polygon
    share = np.clip((away * edge).sum(axis=2) / (edge**2).sum(axis=1), 0, 1)
    return float(np.linalg.norm(away - share[:, :, None] * edge, axis=2).min())


def _turn(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _named(texts: list[str]) -> list[str]:
    more = len(texts) - _MOST_NAMED
    return [*texts[:_MOST_NAMED], *([f"and {more} more pairs"] if more > 0 else [])]
