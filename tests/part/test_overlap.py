"""Shares of bodies that overlap: whole, continuous, and fair to each.

Source: docs/explanation/multi-colour-distance-field.md, Booleans.
"""

from __future__ import annotations

import numpy as np
import pytest

from lmctl.field.grid import Grid
from lmctl.part.bodies.body import Body
from lmctl.part.bodies.formulas import Box, Sphere
from lmctl.part.booleans.overlap import OverlapWeights

BALLS = (Sphere((0, 0, 0), 5), Sphere((6, 0, 0), 5), Sphere((3, 5, 0), 5))


def overlap(*bodies: Body) -> OverlapWeights:
    low = np.min([body.tight_bounds_mm[0] for body in bodies], axis=0)
    high = np.max([body.tight_bounds_mm[1] for body in bodies], axis=0)
    return OverlapWeights(bodies, Grid.enclosing(low, high, 0.5))


@pytest.fixture(scope="module")
def three() -> OverlapWeights:
    return overlap(*BALLS)


def test_shares_are_whole_and_a_body_alone_has_all(three: OverlapWeights) -> None:
    points = np.random.default_rng(0).uniform([-6, -6, -6], [12, 11, 6], (3000, 3))
    shares = three.weights(points)
    assert shares.min() >= 0
    assert np.abs(shares.sum(axis=0) - 1).max() < 1e-12
    inside = np.array([ball.distance_at(points) > 0 for ball in BALLS])
    for number in range(3):
        alone = inside[number] & (inside.sum(axis=0) == 1)
        assert (shares[number, alone] == 1).all()
        assert (shares[number, inside.any(axis=0) & ~inside[number]] == 0).all()


@pytest.mark.parametrize("number", range(3))
def test_nothing_jumps_where_one_of_three_begins(three: OverlapWeights, number: int) -> None:
    """On a body's surface inside others its share is 0, so the others' are what they are beyond."""
    ways = np.random.default_rng(number).normal(size=(3000, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    ball = BALLS[number]
    centre, others = np.array(ball.centre_mm), [b for b in BALLS if b is not ball]
    within = np.max([b.distance_at(centre + 5 * ways) for b in others], axis=0) > 0.02
    inner, outer = (
        three.weights(centre + radius * ways[within]) for radius in (5 - 1e-4, 5 + 1e-4)
    )
    assert within.sum() > 500
    assert np.abs(inner - outer).max() < 0.02


def test_where_all_three_are_the_shares_are_by_distance_to_the_pieces(
    three: OverlapWeights) -> None:
    """By symmetry each has a third in the middle of three balls that turn into each other."""
    turned = [np.array([5 * np.cos(a), 5 * np.sin(a), 0]) for a in np.deg2rad([90, 210, 330])]
    around = overlap(*(Sphere(tuple(centre), 7) for centre in turned))
    assert around.weights(np.zeros((1, 3)))[:, 0] == pytest.approx([1 / 3] * 3, abs=1e-3)


def test_a_lid_that_all_share_counts_for_none() -> None:
    """Three bars of one height that cross: at their common lid nothing begins."""
    bars = (Box((-5, -2, 0), (5, 2, 4)), Box((-2, -5, 0), (2, 5, 4)), Box((-3, -3, 0), (3, 3, 4)))
    shares = overlap(*bars)
    low, high = (shares.weights(np.array([[0.5, 1.0, z]]))[:, 0] for z in (2.0, 3.9999))
    assert low == pytest.approx(high, abs=1e-6)
