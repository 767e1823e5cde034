"""What planning found out that only geometry and the powder model can tell, in words."""

from __future__ import annotations

from collections.abc import Iterator

from lmctl.plan.tally import (
    ENOUGH_COVERAGE,
    ENOUGH_FILLING,
    ENOUGH_MIXTURE,
    OVERHANG_DEG,
    Tally,
)
from lmctl.preflight.placement import Placement

Finding = dict[str, str]


def verdict(tally: Tally, placement: Placement, mode: str) -> list[Finding]:
    """Findings for the job: each {"level": "ok" | "warning", "text": …}."""
    return [
        *_coverage(tally), *_filling(tally), *_overhang(tally), *_height(placement),
        *_mixture(tally, mode), *_hoppers(tally), *_idle(tally), *_waste(tally),
    ]


def _finding(fine: bool, text: str) -> Finding:
    return {"level": "ok" if fine else "warning", "text": text}


def _coverage(tally: Tally) -> list[Finding]:
    share, layer = tally.worst_coverage
    found = [_finding(
        tally.coverage >= ENOUGH_COVERAGE,
        f"tracks cover {tally.coverage:.2%} of the slices"
        + (f", {share:.2%} of layer {layer + 1}" if share < ENOUGH_COVERAGE else "")
        + ("; what is thinner than a bead is left out"
           if tally.coverage < ENOUGH_COVERAGE else ""),
    )]
    if tally.empty_layers:
        first = tally.empty_layers[0] + 1
        found.append(_finding(
            False, f"{len(tally.empty_layers)} layers have no tracks, the first is layer {first}: "
            "nothing there is as wide as a bead"))
    return found


def _filling(tally: Tally) -> list[Finding]:
    if tally.path_mm == 0:
        return []
    share, layer = tally.worst_filling
    text = f"beads hold {tally.filling:.0%} of the slices' volume"
    if share >= ENOUGH_FILLING:
        return [_finding(True, text)]
    return [_finding(
        False, f"{text}, {share:.0%} of layer {layer + 1}: beads are round, and a wall of one or "
        "two comes out thinner or lower than drawn")]


def _overhang(tally: Tally) -> list[Finding]:
    share, layer = tally.worst_overhang
    if share <= 1e-3:
        return [_finding(True, f"no wall leans out by more than {OVERHANG_DEG:g}°")]
    return [_finding(
        False,
        f"{tally.overhang_mm2:.1f} mm² of slices lean out by more than {OVERHANG_DEG:g}° over the "
        f"slice below; worst in layer {layer + 1}, {share:.1%} of it")]


def _height(placement: Placement) -> list[Finding]:
    left, height = placement.height_left_mm(), placement.layer_height_mm
    found = []
    if placement.skipped:
        found.append(_finding(
            False, f"the lowest {placement.skipped * height:.3g} mm of the part have nothing as "
            "wide as a bead and are left out"))
    if left > 0.51 * height:  # more than half a layer: layers without tracks at the top
        built = (placement.skipped + placement.n_layers) * height
        found.append(_finding(
            False, f"layers reach {built:.4g} mm, the part {built + left:.4g} mm: what is above "
            "has nothing as wide as a bead"))
    return found


def _mixture(tally: Tally, mode: str) -> list[Finding]:
    text = (f"{tally.mixture_share:.1%} of the path within ±0.02 of the part file's mixture at the "
            f"nozzle, by the powder model (mode {mode}); worst {tally.worst_mixture:.3f}")
    fine = tally.mixture_share >= ENOUGH_MIXTURE
    if not fine:
        text += "".join(_why_off(tally, mode))
    found = [_finding(fine, text)]
    if tally.slowed_mm:
        found.append(_finding(
            True, f"{tally.slowed_mm:.0f} mm of path slowed to as little as "
            f"{tally.slowest_pace:.0%}: powder could not follow its mixture else, or the axes its "
            "speed"))
    return found


def _why_off(tally: Tally, mode: str) -> Iterator[str]:
    worth_telling_mm = tally.asked_mm * (1 - ENOUGH_MIXTURE) / 2
    if tally.unfollowed_mm > worth_telling_mm:
        what = ("the mixture changes faster than powder can follow" if mode == "lead"
                else "powder comes too late")
        yield f"; along {tally.unfollowed_mm:.0f} mm {what}"
    if tally.unplanned_mm > worth_telling_mm:
        yield (f"; along {tally.unplanned_mm:.0f} mm the plan differs from the part file by its "
               "steps (process.fraction_step, strategy, least flows of hoppers)")


def _hoppers(tally: Tally) -> list[Finding]:
    if not tally.snapped_mm:
        return []
    return [_finding(
        False,
        f"{tally.snapped_mm:.0f} mm of path ({tally.snapped_mm / tally.path_mm:.1%}) want less of "
        f"a powder than its hopper meters: set to none or the least, off by up to "
        f"{tally.snapped_by:.3f}")]


def _idle(tally: Tally) -> list[Finding]:
    return [
        _finding(True, f"hopper {hopper.name} holds {hopper.material} too, and is not used: "
                 "a material is fed from one hopper")
        for hopper in tally.recipe.idle
    ]


def _waste(tally: Tally) -> list[Finding]:
    fed, wasted = float(tally.fed_g.sum()), float(tally.wasted_g.sum())
    if fed <= 0:
        return []
    return [_finding(True, f"{wasted:.1f} of {fed:.1f} g powder are fed while the beam is off")]
