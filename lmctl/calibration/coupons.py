"""Coupons: small parts that are deposited to be weighed or cut, and what they show.

A coupon is an ordinary part file. Its powder is fed by the calibrated hoppers, so that its catch
efficiency is what the balance finds over what left the nozzle while the beam was on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from lmctl.calibration.calibration_file import HopperCalibration
from lmctl.calibration.estimate import Estimate
from lmctl.errors import UsageError

#: A coupon for weighing: 10 to 30 g, deposited in some minutes.
_WEIGHED_MM = (30.0, 20.0, 3.2)
#: A single track for a section [mm], one bead wide.
_TRACK_MM = (30.0, 1.33, 0.8)
#: Catch efficiencies beyond these are rather a wrong weight or unit.
_PLAUSIBLE_CATCH = (0.15, 1.0)
_UNKNOWN_SLOPE = 0.03  # standard error of a flow that was not measured


@dataclass(frozen=True)
class Coupon:
    """name : for files and messages
    fractions : volume fractions by material; text : the part file
    """

    name: str
    fractions: Mapping[str, float]
    text: str


def weighing_coupon(fractions: Mapping[str, float]) -> Coupon:
    """A block of one powder, or of a constant mixture."""
    return Coupon(_name("catch", fractions), dict(fractions),
                  _part_text(_name("catch", fractions), fractions, _WEIGHED_MM, None))


def dilution_coupon(material: str, speed_mm_s: float) -> Coupon:
    """A single track of one powder at a speed."""
    name = f"dilution-{material}-{speed_mm_s:g}"
    return Coupon(name, {material: 1.0}, _part_text(name, {material: 1.0}, _TRACK_MM, speed_mm_s))


def _name(kind: str, fractions: Mapping[str, float]) -> str:
    return "-".join([kind, *fractions])


def _part_text(
    name: str, fractions: Mapping[str, float], size_mm: tuple[float, float, float],
    speed_mm_s: float | None,
) -> str:
    lines = [f'name = "{name}"']
    for material in fractions:
        lines += ["[[material]]", f'name = "{material}"']
        if speed_mm_s is not None:
            lines.append(f"speed_mm_s = {speed_mm_s:g}")
    x, y, z = size_mm
    lines += ["[[body]]", 'kind = "box"', "low_mm = [0, 0, 0]", f"high_mm = [{x}, {y}, {z}]"]
    if len(fractions) > 1:
        mixture = ", ".join(f'"{material}" = {share}' for material, share in fractions.items())
        lines += ["[composition]", 'feature = { kind = "point", at_mm = [0, 0, 0] }',
                  f'profile = {{ kind = "constant", of = {{ {mixture} }} }}']
    lines += ["[process]", "min_built_fraction = 0.5"]
    return "\n".join(lines) + "\n"


def check_weights(before_g: float, after_g: float, fed_g: float) -> None:
    """Raise UsageError for weights that cannot be those of a coupon.

    fed_g : powder that left the nozzle with the beam on
    """
    deposited_g = after_g - before_g
    weights_text = f"{before_g:g} g before, {after_g:g} g after, {fed_g:.2f} g fed with the beam on"
    if deposited_g <= 0:
        raise UsageError("the coupon weighs no more than the empty plate", where=weights_text,
                         hint="are the two weights exchanged, or in different units?")
    if not _PLAUSIBLE_CATCH[0] <= deposited_g / fed_g <= _PLAUSIBLE_CATCH[1]:
        raise UsageError(
            f"{deposited_g:.4g} g of {fed_g:.4g} g fed would be a catch efficiency of "
            f"{deposited_g / fed_g:.3g}", where=weights_text,
            hint="is the unit right, was loose powder brushed off, was it this plate?")


def catch_estimate(
    deposited_g: float, weighing_step_g: float, fed_g: Mapping[str, float], beam_on_s: float,
    hoppers: Mapping[str, HopperCalibration | None],
) -> Estimate:
    """Catch efficiency with its error: weighing, slope of the feeders, noise of their flow.

    fed_g : with the beam on, by material; hoppers : their calibrations, None where there is none
    """
    total_g = sum(fed_g.values())
    weighing_g = weighing_step_g * math.sqrt(2.0 / 12.0) + weighing_step_g
    variance_g2 = 0.0
    for material, mass_g in fed_g.items():
        measured = hoppers.get(material)
        if measured is None:
            slope, noise = _UNKNOWN_SLOPE, 0.0
        else:
            slope = measured.slope.half_width / 1.96 / measured.slope.value
            noise = measured.noise_rsd * math.sqrt(
                2.0 * measured.noise_correlation_s / max(beam_on_s, 1.0))
        variance_g2 += mass_g**2 * (slope**2 + noise**2)
    catch = deposited_g / total_g
    return Estimate(catch, math.hypot(weighing_g / total_g,
                                      catch * math.sqrt(variance_g2) / total_g))
