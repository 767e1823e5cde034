"""Clouds with normals: what they make decidable, and that wrong ones are found out."""

from __future__ import annotations

import re

import numpy as np
import pytest
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.field.cloud.cloud_field import cloud_field
from lmctl.field.field import DistanceField
from lmctl.field.grid import Grid
from lmctl.field.primitives import box_distance, cone_distance

ACROSS = (20.0, 16.0)
SPACING_MM = 0.53
COUNT = 2500


def plate(thick: float, noise: float = 0.0, seed: int = 1) -> tuple[FloatArray, FloatArray]:
    """Points all over a plate, 0.53 mm apart, and the outward normals of its faces."""
    rng = np.random.default_rng(seed)
    size = np.array([*ACROSS, thick])
    points = rng.uniform(0, 1, (COUNT, 3)) * size
    faces = np.array([size[1] * size[2], size[0] * size[2], size[0] * size[1]])
    axis, up = rng.choice(3, COUNT, p=faces / faces.sum()), rng.integers(0, 2, COUNT)
    points[np.arange(COUNT), axis] = up * size[axis]
    normals = np.zeros_like(points)
    normals[np.arange(COUNT), axis] = 2.0 * up - 1.0
    return points + rng.normal(0, noise, points.shape), normals


def around(points: FloatArray) -> Grid:
    return Grid.enclosing(points.min(axis=0), points.max(axis=0), 0.25)


def wrong_signs(field: DistanceField, thick: float) -> NDArray[np.bool_]:
    """At nodes farther from the plate's surface than a spacing."""
    true = box_distance(field.grid.window().node_points(), [0, 0, 0], [*ACROSS, thick])
    values = field.values.reshape(-1)
    wrong: NDArray[np.bool_] = ((values > 0) != (true > 0)) & (np.abs(true) > SPACING_MM)
    return wrong


@pytest.mark.parametrize("thick", [2.0, 1.0])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_plate_too_thin_for_its_spacing_is_reported_by_its_normals(thick, noise):
    points, normals = plate(thick, noise)
    grid = around(points)
    with pytest.raises(InputError, match="cannot be distinguished"):
        cloud_field(points, grid)
    field = cloud_field(points, grid, normals)
    assert not wrong_signs(field, thick).any()
    true = box_distance(grid.window().node_points(), [0, 0, 0], [*ACROSS, thick])
    inside = true > 0.2
    assert (field.values.reshape(-1)[inside] > 0).mean() > (0.995 if thick < 2.0 else 0.9999)
    assert (field.values.reshape(-1)[true < -0.1] < 0).mean() > 0.998
    near = np.abs(true) < 0.25
    assert np.sqrt(np.mean((field.values.reshape(-1) - true)[near] ** 2)) < 0.04
    assert not any("normals" in remark for remark in field.remarks)
    said = [remark for remark in field.remarks if "than the samples" in remark]
    assert len(said) == (1 if thick < 2.0 else 0)


@pytest.mark.parametrize("thick", [0.5, 0.3, 0.05])
@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_plate_thinner_than_its_spacing_is_refused(thick, noise, seed):
    points, normals = plate(thick, noise, seed)
    with pytest.raises(InputError, match="thinner than the samples are apart") as refused:
        cloud_field(points, around(points), normals)
    said = re.search(r"walls ([\d.]+) mm thick are .* apart \(([\d.]+) mm\)", refused.value.what)
    assert said is not None
    assert abs(float(said[1]) - thick) < 3.0 * noise + 1e-6
    assert abs(float(said[2]) - SPACING_MM) < 0.05
    assert "mesh" in refused.value.hint


@pytest.mark.parametrize("thick", [0.6, 0.7, 0.8, 0.9])
@pytest.mark.parametrize("seed", [1, 2])
def test_what_is_hardly_thicker_is_right_or_refused(thick, seed):
    points, normals = plate(thick, 0.01, seed)
    try:
        field = cloud_field(points, around(points), normals)
    except InputError as refused:
        assert "the samples are apart" in refused.what  # noqa: PT017 (it may be right as well)
        return
    true = box_distance(field.grid.window().node_points(), [0, 0, 0], [*ACROSS, thick])
    assert (field.values.reshape(-1)[true > 0.2] > 0).mean() > 0.99
    assert any("than the samples are apart" in remark for remark in field.remarks)


def test_a_gap_narrower_than_the_spacing_is_refused():
    """Two thick plates, one 0.3 mm above the other."""
    points, normals = plate(3.0)
    above = points + np.array([0.0, 0.0, 3.3])
    points, normals = np.vstack([points, above]), np.vstack([normals, normals])
    with pytest.raises(InputError, match=r"gaps 0\.3 mm wide are thinner"):
        cloud_field(points, around(points), normals)


def test_a_sharp_trailing_edge_alone_does_not_refuse():
    """A wedge of 19 degrees: thinner than the spacing over the last 1.6 of its 40 mm."""
    rng = np.random.default_rng(5)
    long, thick, wide, slope = 40.0, 14.0, 16.0, 14.0 / 40.0
    u, v = rng.uniform(0, 1, (2, 8000))
    slant = np.array([-slope, 0.0, 1.0]) / np.hypot(slope, 1.0)
    x = u * long
    bottom = np.stack([x, v * wide, 0 * x], axis=1)[:2500]
    top = np.stack([x, v * wide, x * slope], axis=1)[2500:5000]
    back = np.stack([0 * x + long, v * wide, u * thick], axis=1)[5000:5800]
    side = np.stack([np.sqrt(u) * long, np.where(v < 0.5, 0.0, wide), 0 * x], axis=1)[5800:]
    side[:, 2] = rng.uniform(0, 1, len(side)) * side[:, 0] * slope
    points = np.vstack([bottom, top, back, side])
    normals = np.vstack([
        np.tile([0.0, 0.0, -1.0], (len(bottom), 1)), np.tile(slant, (len(top), 1)),
        np.tile([1.0, 0.0, 0.0], (len(back), 1)),
        np.stack([0 * side[:, 0], np.where(side[:, 1] > 0, 1.0, -1.0), 0 * side[:, 0]], axis=1),
    ])
    field = cloud_field(points, around(points), normals)
    assert any("than the samples are apart" in remark for remark in field.remarks)
    x, y, z = field.grid.window().node_points().T
    inside = (x < long - 0.3) & (y > 0.3) & (y < wide - 0.3) & (z > 0.3) & (z < x * slope - 0.3)
    assert (field.values.reshape(-1)[inside] > 0).mean() > 0.99


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
    grid = Grid.enclosing(points.min(axis=0), points.max(axis=0), 0.7)
    plain = cloud_field(points, grid)
    field = cloud_field(points, grid, spoilt(np.tile([0.0, 0.0, 1.0], (len(points), 1))))
    np.testing.assert_array_equal(field.values, plain.values)
    assert sum("normals" in remark and "not used" in remark for remark in field.remarks) == 1


def test_normals_that_were_never_oriented_do_not_make_a_thick_part_thin():
    """As fitted to each point's neighbours, on a sphere with a little noise."""
    rng = np.random.default_rng(4)
    normals = rng.normal(size=(4000, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    points = 10.0 * normals + rng.normal(0, 0.02, normals.shape)
    grid = around(points)
    plain = cloud_field(points, grid)
    field = cloud_field(points, grid, normals * rng.choice([-1.0, 1.0], len(normals))[:, None])
    np.testing.assert_array_equal(field.values, plain.values)
    assert any("not used" in remark for remark in field.remarks)


@pytest.mark.parametrize("seed", range(4))
def test_right_normals_of_samples_denser_than_the_grid_are_believed(seed):
    """A block turned in its grid: both sides of its faces lie near samples at most nodes."""
    points, normals = plate(14.0, seed=seed)
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    points, normals = points @ turn.T, normals @ turn.T
    grid = Grid.enclosing(points.min(axis=0), points.max(axis=0), 1.9)
    field = cloud_field(points, grid, normals)
    assert field.remarks == ()
    true = box_distance(grid.window().node_points() @ turn, [0, 0, 0], [*ACROSS, 14.0])
    assert not (((field.values.reshape(-1) > 0) != (true > 0)) & (np.abs(true) > 0.8)).any()


@pytest.mark.parametrize(("radius", "high", "pitch"), [(4.5, 6.2, 0.45), (6.0, 5.4, 0.58)])
def test_a_pointed_cone_is_not_thin_for_its_rim(radius, high, pitch):
    """Of 54 and 42 degrees: a tenth of the samples have the other face within a spacing.

    And beyond the rim the open air lies behind both faces.
    """
    rng = np.random.default_rng(6)
    u, turn = np.sqrt(rng.random(5000)), rng.uniform(0, 2 * np.pi, 5000)
    round_ = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points = np.column_stack([radius * u[:, None] * round_, high * (1 - u)])
    normals = np.column_stack([high * round_, np.full(5000, radius)]) / np.hypot(radius, high)
    flat = slice(0, int(5000 * radius / (radius + np.hypot(radius, high))))
    points[flat, 2] = 0.0
    normals[flat] = (0.0, 0.0, -1.0)
    field = cloud_field(points, Grid.enclosing(points.min(axis=0), points.max(axis=0), pitch),
                        normals)
    assert not any("thin" in remark for remark in field.remarks)
    true = cone_distance(field.grid.window().node_points(), [0, 0, 0], [0, 0, high], radius, 0.0)
    assert not (((field.values.reshape(-1) > 0) != (true > 0)) & (np.abs(true) > 0.3)).any()
