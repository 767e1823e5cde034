"""The simulation against answers that are known: patches, tubes, strips, plates."""

from __future__ import annotations

from itertools import product
from math import factorial

import numpy as np
import pytest

from lmctl.design.discretisation import QUADRATURE
from tests.design.closed_forms import (
    BETA,
    bilayer_error,
    heated_plate_error,
    patch_error,
    ring_errors,
    thick_tube_error,
)


def test_the_rule_of_tetrahedra_is_exact_for_cubics_and_positive() -> None:
    """∫ x^a y^b z^c over the unit tetrahedron is a! b! c! / (a + b + c + 3)!."""
    places, weights = QUADRATURE[3]
    assert (weights > 0).all()
    for powers in product(range(4), repeat=3):
        if sum(powers) <= 3:
            exact = np.prod([factorial(n) for n in powers]) / factorial(sum(powers) + 3)
            found = weights @ np.prod(places ** np.array(powers)[:, None], axis=0)
            assert found == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("kind", ["plane-stress", "plane-strain", "solid"])
def test_a_linear_displacement_is_met_exactly(kind: str) -> None:
    assert patch_error(kind, 1.5) < 1e-9


def test_displacement_and_stress_of_a_graded_ring_converge() -> None:
    coarse, fine = ring_errors(16.0, BETA), ring_errors(8.0, BETA)
    assert np.log2(coarse[0] / fine[0]) >= 1.9
    assert np.log2(coarse[1] / fine[1]) >= 0.9
    assert fine[2] < 0.02


def test_lames_tube() -> None:
    assert thick_tube_error(4.0) < 0.005


def test_a_strip_of_two_metals_bends_as_timoshenko_found() -> None:
    assert bilayer_error(0.8) < 0.005


@pytest.mark.parametrize("exponent", [0.2, 1.0, 5.0])
def test_a_graded_plate_in_heat(exponent: float) -> None:
    assert heated_plate_error(0.05, exponent) < 0.02
