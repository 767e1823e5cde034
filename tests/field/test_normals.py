"""Clouds with normals: what they make decidable, and that wrong ones are found out."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lmctl.errors import InputError
from lmctl.field.cloud.cloud_field import cloud_field
from lmctl.field.field import Field
from lmctl.field.grid import Grid
from lmctl.field.primitives import box_distance

FloatArray = NDArray[np.float64]

ACROSS = (20.0, 16.0)
SPACING_MM = 0.53
COUNT = 2500


def plate(thick: float, noise: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Points all over a plate, 0.53 mm apart, and the outward normals of its faces."""
    rng = np.random.default_rng(1)
    size = np.array([*ACROSS, thick])
    points = rng.uniform(0, 1, (COUNT, 3)) * size
    faces = np.array([size[1] * size[2], size[0] * size[2], size[0] * size[1]])
    axis, up = rng.choice(3, COUNT, p=faces / faces.sum()), rng.integers(0, 2, COUNT)
    points[np.arange(COUNT), axis] = up * size[axis]
    normals = np.zeros_like(points)
    normals[np.arange(COUNT), axis] = 2.0 * up - 1.0
    return points + rng.normal(0, noise, points.shape), normals


def around(points: FloatArray) -> Grid:
    return Grid.around(points.min(axis=0), points.max(axis=0), 0.25)


def wrong_signs(field: Field, thick: float) -> NDArray[np.bool_]:
    """At nodes farther from the plate's surface than a spacing."""
    true = box_distance(field.grid.window().points(), [0, 0, 0], [*ACROSS, thick])
    values = field.values.reshape(-1)
    wrong: NDArray[np.bool_] = ((values > 0) != (true > 0)) & (np.abs(true) > SPACING_MM)
    return wrong


@pytest.mark.parametrize("thick", [2.0, 1.0])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_plate_too_thin_for_its_spacing_is_told_by_its_normals(thick, noise):
    points, normals = plate(thick, noise)
    grid = around(points)
    with pytest.raises(InputError, match="cannot be told apart"):
        cloud_field(points, grid)
    field = cloud_field(points, grid, normals)
    assert not wrong_signs(field, thick).any()
    true = box_distance(grid.window().points(), [0, 0, 0], [*ACROSS, thick])
    inside = true > 0.2
    assert (field.values.reshape(-1)[inside] > 0).mean() > 0.98
    near = np.abs(true) < 0.25
    assert np.sqrt(np.mean((field.values.reshape(-1) - true)[near] ** 2)) < 0.04
    assert not any("normals" in remark for remark in field.remarks)


def test_normals_that_point_inwards_are_turned_and_that_is_said():
    points, normals = plate(1.0)
    grid = around(points)
    outwards, inwards = cloud_field(points, grid, normals), cloud_field(points, grid, -normals)
    np.testing.assert_array_equal(inwards.values, outwards.values)
    assert "the normals of the cloud point inwards: they were turned round" in inwards.remarks


@pytest.mark.parametrize("harm", ["a few turned", "tilted", "some missing", "some nan"])
def test_normals_that_are_mostly_right_do(harm):
    points, normals = plate(1.0)
    rng = np.random.default_rng(2)
    if harm == "a few turned":
        normals = normals * np.where(rng.random(COUNT) < 0.05, -1.0, 1.0)[:, None]
    elif harm == "tilted":
        normals = normals + 0.3 * rng.normal(size=normals.shape)
    else:
        normals[rng.random(COUNT) < 0.2] = 0.0 if harm == "some missing" else np.nan
    assert not wrong_signs(cloud_field(points, around(points), normals), 1.0).any()


@pytest.mark.parametrize("nonsense", ["random", "half turned", "all zero", "along the face"])
def test_nonsense_is_not_used_and_that_is_said(nonsense, gear):
    """The thick gear is told without them, as well as ever; the plate is refused as ever."""
    rng = np.random.default_rng(3)

    def spoilt(normals: FloatArray) -> FloatArray:
        if nonsense == "random":
            return rng.normal(size=normals.shape)
        if nonsense == "half turned":
            return normals * rng.choice([-1.0, 1.0], len(normals))[:, None]
        return 0.0 * normals if nonsense == "all zero" else np.roll(normals, 1, axis=1)

    points, normals = plate(1.0)
    with pytest.raises(InputError):
        cloud_field(points, around(points), spoilt(normals))
    points = gear.cloud(6000, 0.0, rng)
    grid = Grid.around(points.min(axis=0), points.max(axis=0), 0.7)
    plain = cloud_field(points, grid)
    field = cloud_field(points, grid, spoilt(np.tile([0.0, 0.0, 1.0], (len(points), 1))))
    np.testing.assert_array_equal(field.values, plain.values)
    assert sum("normals" in remark and "not used" in remark for remark in field.remarks) == 1
