"""The margins of a plan in words, for its report."""

from __future__ import annotations

from collections.abc import Iterator

from lmctl.plan.margins.mixture_margins import BeadResolution, MixtureMargins
from lmctl.plan.margins.other_strategy import StrategyMargins
from lmctl.plan.margins.worst_case import WorstCase

#: The least share, reached by 95 of 100 cells, that is worth no warning.
_GOOD_SHARE = 0.99
#: Of a volume that beads cannot carry this share is worth a word.
_UNRESOLVED_SHARE = 0.01
#: Shares that differ by less are the same in print.
_NO_CHANGE = 5e-4
#: A remedy is named where it gains so much.
_WORTH_A_WORD = 0.01


def is_enough(margins: MixtureMargins) -> bool:
    """Whether nearly all cells within the intervals reach a good share, or what is predicted."""
    return margins.usual is None or margins.usual >= min(_GOOD_SHARE, margins.path.predicted)


def margin_findings(
    margins: MixtureMargins, other: StrategyMargins | None
) -> Iterator[tuple[bool, str]]:
    """Whether each finding is fine, and its text. other : what another strategy would hold"""
    text = "".join(_mixture(margins))
    if other is not None and margins.usual is not None and (
        other.usual > margins.usual + _WORTH_A_WORD
    ):
        text += (f"; strategy {other.strategy} would hold {other.usual:.1%} in 95 of 100 cells and "
                 f"{other.worst:.1%} at worst (tried on layer {other.layer})")
    yield is_enough(margins), text
    if 1.0 - margins.resolution.volume_share > _UNRESOLVED_SHARE:
        yield False, _unresolved(margins.resolution)


def _mixture(margins: MixtureMargins) -> Iterator[str]:
    yield (f"mixture as predicted: {margins.path.predicted:.1%} of the path within ±0.02, "
           f"{margins.volume.predicted:.1%} of the volume within ±0.03")
    if margins.case is not None:
        yield from _within_intervals(margins, margins.case)
    if margins.unmeasured:
        names = ", ".join(margins.unmeasured)
        yield (f"; intervals not measured of hopper{'s' * (len(margins.unmeasured) > 1)} {names}: "
               "`lmctl machine feeder-test` and `catch-test` measure them")
    if margins.layers < margins.of_layers:
        yield f"; from {margins.layers} of {margins.of_layers} layers"


def _within_intervals(margins: MixtureMargins, case: WorstCase) -> Iterator[str]:
    path = margins.path
    assert margins.usual is not None, "there are intervals"
    assert path.worst is not None, "there are intervals"
    if min(path.worst, margins.usual) > path.predicted - _NO_CHANGE:
        yield "; as much of the path anywhere within the intervals that are known"
        return
    yield (f"; within the intervals that are known {margins.usual:.1%} of the path in 95 of 100 "
           f"cells, {path.worst:.1%} (volume {margins.volume.worst:.1%}) at worst")
    first = case.alone[0]
    if first.share < case.planned - _NO_CHANGE:
        yield f"; most sensitive to {first.text}: alone {first.share:.1%} of the path"
    if len(case.without) > 1:
        text = " and ".join(one.text for one in case.without[:2])
        yield (f"; at worst {len(case.without)} values are at an end of their interval, and what "
               f"counts most is {text}")
    if margins.known_better is not None and margins.known_better > path.worst + _WORTH_A_WORD:
        yield f"; with all intervals half as wide {margins.known_better:.1%} at worst"


def _unresolved(found: BeadResolution) -> str:
    x, y, z = found.worst.place_mm.round(1).tolist()
    text = (f"{1.0 - found.volume_share:.1%} of the volume is off by more than ±0.03 however well "
            f"powder is timed, most in layer {found.worst.layer + 1} at x {x:g}, y {y:g}, z {z:g} "
            f"mm of the part: the mixture changes by {found.gradient_per_mm:.2f} per mm there, and "
            f"a strip of {found.strip_mm:.2f} mm has one mixture across")
    if found.limit_per_mm < 10.0:
        text += f" (such beads carry {found.limit_per_mm:.2f} per mm at most)"
    return text + "; a finer bead, more overlap or lower layers would help"
