"""What an operator types in: masses and dilutions with their units, checked for plausibility."""

from __future__ import annotations

import re

from lmctl.errors import UsageError

_GRAMS = {"mg": 0.001, "g": 1.0, "kg": 1000.0}
_MASS = re.compile(r"([0-9]{1,7})(?:[.,]([0-9]{1,6}))?\s*(mg|g|kg)")
_SHARE = re.compile(r"([0-9]{1,3}(?:[.,][0-9]{1,3})?)\s*%")
_AREAS = re.compile(
    r"([0-9]{1,4}(?:[.,][0-9]{1,4})?)\s*mm2?²?\s*/\s*([0-9]{1,4}(?:[.,][0-9]{1,4})?)\s*mm2?²?")

#: A balance that shows less than this is too coarse for a coupon [g].
COARSEST_STEP_G = 0.1
#: Standard error of an analysis or a section, in the share itself: one point.
ANALYSIS_ERROR = 0.01


def parse_mass_g(text: str) -> tuple[float, float]:
    """A mass as typed, and the last digit's worth, both in g.

    Raises UsageError for a mass without a unit or without enough decimals.

    >>> parse_mass_g("412.37 g")
    (412.37, 0.01)
    """
    matched = _MASS.fullmatch(text.strip())
    if matched is None:
        raise UsageError(f"{text[:40]!r} is no mass with its unit", hint="write 412.37 g")
    whole, decimals, unit = matched[1], matched[2] or "", matched[3]
    step_g = _GRAMS[unit] / 10 ** len(decimals)
    if step_g > COARSEST_STEP_G:
        raise UsageError(f"{text[:40]!r} is stated to {step_g:g} g only",
                         hint="weigh on a balance that shows 0.01 g, and type all its digits")
    return round(float(f"{whole}.{decimals or 0}") * _GRAMS[unit], 6), step_g


def parse_dilution(text: str) -> float:
    """A share of the layer below in a bead: "18.3 %", or a section's areas above and below the
    plate's surface, "2.10 mm2 / 0.47 mm2".

    Raises UsageError where it is neither, or no share from 0 to 80 %.
    """
    if (matched := _SHARE.fullmatch(text.strip())) is not None:
        share = float(matched[1].replace(",", ".")) / 100.0
    elif (matched := _AREAS.fullmatch(text.strip())) is not None:
        above, below = (float(value.replace(",", ".")) for value in matched.groups())
        share = below / (above + below) if above + below > 0 else -1.0
    else:
        raise UsageError(f"{text[:40]!r} is no dilution",
                         hint="write 18.3 %, or the areas of a section: 2.10 mm2 / 0.47 mm2")
    if not 0.0 <= share <= 0.8:
        raise UsageError(f"a dilution of {100 * share:.0f} % is not to be believed",
                         hint="it lies between 0 and 80 %: area above the plate / area below it")
    return share
