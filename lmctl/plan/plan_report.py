"""Report, as text, the findings that only geometry and the powder model can give."""

from __future__ import annotations

from collections.abc import Iterator

from lmctl.plan.plan_statistics import MIN_CORRECT_MIXTURE_FRACTION, PlanStatistics
from lmctl.preflight.placement import Placement

Finding = dict[str, str]


def plan_report(plan: PlanStatistics, placement: Placement, mode: str) -> list[Finding]:
    """Findings for the job: each {"level": "ok" | "warning", "text": …}."""
    return [
        *_left_out(plan, placement), *_mixture(plan, mode), *_hoppers(plan), *_idle(plan),
        *_powder_findings(plan),
    ]


def report_finding(fine: bool, text: str) -> Finding:
    """One finding: whether it is fine, and its text."""
    return {"level": "ok" if fine else "warning", "text": text}


def _left_out(plan: PlanStatistics, placement: Placement) -> list[Finding]:
    found = []
    if placement.skipped:
        found.append(report_finding(
            False, f"the lowest {placement.skipped * placement.layer_height_mm:.3g} mm of the part "
            "have nothing to deposit and are left out"))
    if plan.empty_layers:
        found.append(report_finding(
            False, f"{len(plan.empty_layers)} layers have no tracks, the first is layer "
            f"{plan.empty_layers[0] + 1}"))
    return found


def _mixture(plan: PlanStatistics, mode: str) -> list[Finding]:
    text = (f"{plan.correct_mixture_fraction:.1%} of the path within ±0.02 of the part file's "
            f"mixture at the nozzle, by the powder model (mode {mode}); "
            f"worst {plan.worst_mixture:.3f}")
    fine = plan.correct_mixture_fraction >= MIN_CORRECT_MIXTURE_FRACTION
    if not fine:
        text += "".join(_why_off(plan, mode))
    found = [report_finding(fine, text)]
    if plan.cuts:
        found.append(report_finding(
            True, f"tracks are cut in {plan.cuts} places where powder could not follow their "
            "mixture at the least speed: it changes there with the beam off"))
    if plan.uncut and not fine:
        found.append(report_finding(
            False, f"in {plan.uncut} places powder comes late, and a cut would leave a piece "
            "shorter than two beads: such pieces stay joined"))
    if plan.slowed_mm:
        found.append(report_finding(
            True, f"{plan.slowed_mm:.0f} mm of path slowed to as little as "
            f"{plan.least_speed_factor:.0%}: powder could not follow its mixture else, or the axes "
            "its speed"))
    return found


def _why_off(plan: PlanStatistics, mode: str) -> Iterator[str]:
    least_reported_mm = plan.asked_mm * (1 - MIN_CORRECT_MIXTURE_FRACTION) / 2
    if plan.unfollowed_mm > least_reported_mm:
        what = ("the mixture changes faster than powder can follow" if mode == "lead"
                else "powder comes too late")
        yield f"; along {plan.unfollowed_mm:.0f} mm {what}"
    if plan.unplanned_mm > least_reported_mm:
        rules = ", alloy rules" if plan.has_alloy_rules else ""
        yield (f"; along {plan.unplanned_mm:.0f} mm the plan differs from the part file by its "
               f"steps (process.fraction_step, strategy, least flows of hoppers{rules})")


def _hoppers(plan: PlanStatistics) -> list[Finding]:
    found = []
    if plan.mm_above_recipe_speed:
        found.append(report_finding(
            True, f"{plan.mm_above_recipe_speed:.0f} mm of path deposited up to "
            f"{plan.greatest_speed_factor:g} times as fast, with powder and power in proportion: "
            "a hopper meters no less"))
    if plan.rounded_mixture_mm:
        found.append(report_finding(
            False,
            f"{plan.rounded_mixture_mm:.0f} mm of path "
            f"({plan.rounded_mixture_mm / plan.path_mm:.1%}) want less of a powder than its "
            f"hopper meters: set to none or the least, off by up to {plan.rounded_by:.3f}"))
    return found


def _idle(plan: PlanStatistics) -> list[Finding]:
    return [
        report_finding(True, f"hopper {hopper.name} holds {hopper.material} too, and is not used: "
                 "a material is fed from one hopper")
        for hopper in plan.recipe.idle
    ]


def _powder_findings(plan: PlanStatistics) -> list[Finding]:
    fed, wasted = float(plan.fed_g.sum()), float(plan.wasted_g.sum())
    if fed <= 0:
        return []
    return [report_finding(True,
                           f"{wasted:.1f} of {fed:.1f} g powder are fed while the beam is off")]
