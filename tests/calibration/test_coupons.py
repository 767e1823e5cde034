"""Coupons: what is typed in, what it means, and what is refused."""

from __future__ import annotations

import math

import pytest

from lmctl.calibration.coupons import catch_estimate, check_weights, weighing_coupon
from lmctl.calibration.entered_values import parse_dilution, parse_mass_g
from lmctl.config.part_rules import parse_part_file
from lmctl.errors import UsageError
from tests.calibration.test_calibration_file import hopper, value


@pytest.mark.parametrize(("text", "mass_g", "step_g"), [
    ("412.37 g", 412.37, 0.01), ("412,37 g", 412.37, 0.01), ("0.41237 kg", 412.37, 0.01),
    ("412370 mg", 412.37, 0.001), (" 12.3g ", 12.3, 0.1),
])
def test_masses_carry_their_unit_and_their_step(text: str, mass_g: float, step_g: float) -> None:
    assert parse_mass_g(text) == pytest.approx((mass_g, step_g))


@pytest.mark.parametrize("text", ["412.37", "412 g", "0.412 kg", "12 lb", "-3.00 g", "", "1e3 g"])
def test_masses_without_unit_or_too_coarse_are_refused(text: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse_mass_g(text)
    assert caught.value.hint


def test_dilutions_are_shares_or_sections() -> None:
    assert parse_dilution("18.3 %") == pytest.approx(0.183)
    assert parse_dilution("2.10 mm2 / 0.70 mm2") == pytest.approx(0.25)
    for text in ("18.3", "0.183", "95 %", "0 mm2 / 0 mm2", "a lot"):
        with pytest.raises(UsageError):
            parse_dilution(text)


@pytest.mark.parametrize(("before_g", "after_g", "words"), [
    (412.0, 411.0, "no more than the empty plate"),
    (412.0, 430.0, "catch efficiency of 1.2"),
    (412.0, 412.01, "catch efficiency of 0.0"),
])
def test_weights_of_another_unit_or_plate_are_refused(
    before_g: float, after_g: float, words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        check_weights(before_g, after_g, 15.0)


def test_the_interval_of_a_catch_holds_slope_noise_and_weighing() -> None:
    tested = hopper(slope=value(1.0, 0.0098), noise_rsd=0.0)
    one = catch_estimate(14.0, 0.01, {"316L": 20.0}, 200.0, {"316L": tested})
    assert one.value == pytest.approx(0.7)
    assert one.standard_error == pytest.approx(0.7 * 0.005, rel=0.05)
    noisy = hopper(slope=value(1.0, 0.0098), noise_rsd=0.1, noise_correlation_s=1.0)
    two = catch_estimate(14.0, 0.01, {"316L": 20.0}, 200.0, {"316L": noisy})
    assert two.standard_error == pytest.approx(0.7 * math.hypot(0.005, 0.01), rel=0.05)
    assert catch_estimate(14.0, 0.01, {"316L": 20.0}, 200.0, {"316L": None}).half_width > 0.04


def test_coupons_are_part_files() -> None:
    for fractions in ({"316L": 1.0}, {"316L": 0.5, "WC-12Co": 0.5}):
        part = parse_part_file(weighing_coupon(fractions).text, name="coupon")
        assert [material.name for material in part.material] == list(fractions)
