"""Bodies and their sections against analytic truths."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from lmctl.errors import InputError
from lmctl.field.field import DistanceField
from lmctl.field.grid import Grid
from lmctl.field.outline_distance import plane_distance
from lmctl.field.plane import PlaneGrid, loop_area_mm2
from lmctl.part.bodies.body import Body, plane_points
from lmctl.part.bodies.formulas import Box, Cone, Cylinder, Sphere, Torus
from lmctl.part.bodies.mesh_solid import MeshSolid
from lmctl.part.bodies.prism import Prism
from lmctl.part.bodies.stored import FieldSolid
from lmctl.part.bodies.transformed import TransformedBody, similarity_transform
from lmctl.part.booleans.combined import CombinedBody, Operation
from lmctl.part.booleans.offset import OffsetBody
from lmctl.part.sources.mesh_files import Mesh
from lmctl.part.sources.mesh_topology import remove_slivers
from tests.field.stored_field import stored_field

PLANE = PlaneGrid((-25.0, -25.0), 0.25, (201, 201))
#: What a traced outline cuts off a right corner at most: half a cell.
CORNER_MM2 = 0.5 * 0.25**2 + 1e-6


def mesh_solid(mesh: tuple[Any, Any], pitch: float) -> MeshSolid:
    return MeshSolid(Mesh(*mesh), Grid.enclosing(mesh[0].min(axis=0), mesh[0].max(axis=0), pitch))


def section_area(body: Body, z: float) -> float:
    return sum(loop_area_mm2(loop) for loop in body.outline_loops(z, PLANE))


@pytest.mark.parametrize("z", [-9.9, -6.0, 0.0, 3.3, 8.0, 9.9])
def test_section_of_a_ball(z: float) -> None:
    ball = Sphere((1, 2, 0), 10)
    radius = np.sqrt(100 - z * z)
    (loop,) = ball.outline_loops(z, PLANE)
    assert np.abs(np.hypot(*(loop - [1, 2]).T) - radius).max() < 0.25**2 / (7 * radius)
    distance = plane_distance([loop], PLANE)
    x, y = np.meshgrid(PLANE.x_mm - 1, PLANE.y_mm - 2)
    true = radius - np.hypot(x, y)
    assert np.abs(distance - true).max() < 0.01
    assert ball.outline_loops(10.0, PLANE) == ball.outline_loops(-10.0, PLANE) == []


def test_in_plane_and_volume_distance_differ_as_they_should() -> None:
    """Sphere R 10 at z = 8: levels 0, 1, 2 of the 3D distance lie 1.88, 4.12 apart in plane."""
    ball = Sphere((0, 0, 0), 10)
    x = np.array([6.0, np.sqrt(81 - 64), 0.0])
    depth = ball.distance_at(np.column_stack([x, 0 * x, 0 * x + 8]))
    assert depth == pytest.approx([0, 1, 2])
    assert x[0] - x[1] == pytest.approx(1.88, abs=0.005)
    assert x[1] - x[2] == pytest.approx(4.12, abs=0.005)


def test_section_of_a_box_is_its_rectangle_half_open() -> None:
    box = Box((-10, -5, 1), (10, 15, 4))
    assert section_area(box, 1.0) == 400
    assert section_area(box, 3.9) == 400
    assert box.outline_loops(4.0, PLANE) == box.outline_loops(0.999, PLANE) == []
    assert (box.section_values(5.0, PLANE) < 0).all()


@pytest.mark.parametrize(
    ("cylinder", "z", "area"),
    [
        (Cylinder((0, 0, 0), (0, 0, 10), 8), 0.0, np.pi * 64),
        (Cylinder((0, 0, 10), (0, 0, 0), 8), 9.0, np.pi * 64),
        (Cylinder((0, 0, 0), (0, 0, 10), 8), 10.0, 0.0),
        (Cylinder((-10, 0, 0), (10, 0, 0), 8), 4.0, 20 * 2 * np.sqrt(64 - 16)),
        (Cylinder((-10, 0, -10), (10, 0, 10), 5), 0.0, np.pi * 25 * np.sqrt(2)),
    ],
)
def test_section_of_a_cylinder(cylinder: Cylinder, z: float, area: float) -> None:
    assert section_area(cylinder, z) == pytest.approx(area, rel=1e-3, abs=1e-9)


def test_bounds_and_depths_of_formulas() -> None:
    tilted = Cylinder((0, 0, 0), (10, 10, 0), 3)
    low, high = tilted.tight_bounds_mm
    reach = 3 / np.sqrt(2)
    assert low == pytest.approx([-reach, -reach, -3])
    assert high == pytest.approx([10 + reach, 10 + reach, 3])
    assert tilted.maximum_depth_mm == 3
    assert Cylinder((0, 0, 0), (0, 0, 2), 3).maximum_depth_mm == 1
    assert Box((0, 0, 0), (3, 4, 5)).maximum_depth_mm == 1.5
    assert Sphere((0, 0, 0), 7).tight_bounds_mm[1] == pytest.approx([7, 7, 7])


def test_a_mesh_answers_like_the_box_it_is(making: Any) -> None:
    exact = Box((-8, -6, 0), (8, 6, 5))
    mesh = mesh_solid(making.box(exact.low_mm, exact.high_mm), 0.5)
    window = mesh.grid.window(4, 9)
    assert mesh.distance(window).shape == window.shape
    assert np.abs(mesh.distance(window) - exact.distance(window)).max() < 0.02
    for z in (0.0, 2.2, 4.999):
        assert section_area(mesh, z) == pytest.approx(192, abs=1e-9)
        true = plane_distance(exact.outline_loops(z, PLANE), PLANE)
        assert np.abs(mesh.section_values(z, PLANE) - true).max() < 1e-6
    assert mesh.outline_loops(5.0, PLANE) == []
    assert mesh.maximum_depth_mm == pytest.approx(2.5, abs=0.26)


def test_slabs_add_up_to_the_whole(making: Any) -> None:
    mesh = mesh_solid(making.ball(6.0, 20, 40), 0.5)
    whole = mesh.distance(mesh.grid.window())
    slabs = [mesh.distance(window) for window in mesh.grid.slabs(5)]
    np.testing.assert_array_equal(np.concatenate(slabs), whole)


def test_a_leaf_of_another_pitch_is_interpolated(making: Any) -> None:
    mesh = mesh_solid(making.box((-4, -4, 0), (4, 4, 4)), 0.5)
    other = Grid((-3.1, -3.1, 1.0), 0.3, (5, 21, 21)).window()
    expected = Box((-4, -4, 0), (4, 4, 4)).distance(other)
    assert np.abs(mesh.distance(other) - expected).max() < 0.25  # half a pitch, at the medial axis


def ball_field(pitch: float = 0.5) -> DistanceField:
    grid = Grid.enclosing(np.full(3, -5.0), np.full(3, 5.0), pitch)
    return DistanceField(grid, Sphere((0, 0, 0), 5).distance(grid.window()), None, np.empty((0, 3)))


def test_a_stored_field_finds_its_bounds_and_sections() -> None:
    field = ball_field()
    solid = FieldSolid(field)
    low, high = solid.tight_bounds_mm
    assert low == pytest.approx([-5, -5, -5], abs=1e-5)
    assert high == pytest.approx([5, 5, 5], abs=1e-5)
    assert section_area(solid, 3.1) == pytest.approx(np.pi * (25 - 3.1**2), rel=0.01)


A, B = Cylinder((0, 0, -30), (0, 0, 30), 10), Cylinder((12, 0, -30), (12, 0, 30), 10)


def discs(operation: Operation, bodies: tuple[Body, ...] = (A, B)) -> CombinedBody:
    grid = Grid((-12.0, -12.0, -1.0), 0.25, (9, 97, 145))
    return CombinedBody(operation, bodies, grid)


@pytest.mark.parametrize(
    ("operation", "bodies", "place", "distance"),
    [
        ("union", (A, B), (6, 0), 8),
        ("intersection", (A, B), (6, 0), 4),
        ("difference", (A, B), (6, 0), -4),
        ("union", (A, B), (6, 6), 2),
        ("intersection", (A, B), (6, 12), -4),
        ("difference", (A, B), (20, 0), -16.1245),
        ("union", (A, A), (6, 0), 4),
    ],
)
def test_combined_distances_are_distances(
    operation: Operation, bodies: tuple[Body, ...], place: tuple[float, float], distance: float
) -> None:
    """The table of two discs R 10, 12 mm apart: min and max alone would give 4 for the first."""
    at = discs(operation, bodies).distance_at(np.array([[*place, 0.0]]))
    assert at == pytest.approx([distance], abs=1e-4)


@pytest.mark.parametrize("operation", ["union", "difference", "intersection"])
def test_combined_outlines(operation: Operation) -> None:
    lens = 2 * 100 * np.arccos(0.6) - 6 * np.sqrt(400 - 144)
    area = {"union": 200 * np.pi - lens, "difference": 100 * np.pi - lens, "intersection": lens}
    assert section_area(discs(operation), 0.0) == pytest.approx(area[operation], rel=1e-3)


def test_combined_bounds_and_order() -> None:
    body = CombinedBody(
        "difference", (Box((0, 0, 0), (10, 10, 10)), Box((5, -1, -1), (11, 11, 11))),
        Grid.enclosing(np.zeros(3), np.full(3, 10.0), 0.5),
    )
    low, high = body.tight_bounds_mm
    assert low == pytest.approx([0, 0, 0], abs=1e-5)
    assert high == pytest.approx([5, 10, 10], abs=1e-5)
    assert section_area(body, 5.0) == pytest.approx(50, abs=4 * CORNER_MM2)
    three = CombinedBody("difference", (A, B, Sphere((0, 0, 0), 3)), discs("union").grid)
    assert three.distance_at(np.zeros((1, 3)))[0] == pytest.approx(-3, abs=1e-6)


def test_combination_with_a_mesh(making: Any) -> None:
    block = mesh_solid(making.box((-10, -10, 0), (10, 10, 6)), 0.5)
    holed = CombinedBody("difference", (block, Cylinder((0, 0, -1), (0, 0, 7), 4)), block.grid)
    assert section_area(holed, 3.0) == pytest.approx(400 - np.pi * 16, abs=4 * CORNER_MM2)
    assert len(holed.outline_loops(3.0, PLANE)) == 2
    assert holed.distance_at(np.array([[7.0, 0, 3.0]]))[0] == pytest.approx(3, abs=0.05)


def test_nothing_left_is_refused() -> None:
    inside = CombinedBody("difference", (Sphere((0, 0, 0), 3), Sphere((0, 0, 0), 5)),
                          Grid.enclosing(np.full(3, -3.0), np.full(3, 3.0), 0.5))
    with pytest.raises(InputError, match="difference of the bodies leaves nothing"):
        _ = inside.tight_bounds_mm


TURNED_LOOP = np.array([(0, 0), (6, 1), (3, 2), (2, 7), (0, 0)], dtype=float)
TURNED: dict[str, Body] = {
    "ball": Sphere((3, 1, 2), 4),
    "box": Box((0, 1, 2), (5, 8, 4)),
    "cone": Cone((1, 2, 3), (4, 0, 9), 3, 1),
    "needle": Cone((0, 0, 0), (0, 0, 9), 2, 0),
    "ring": Torus((1, 2, 3), (1, 0, 2), 5, 2),
    "prism": Prism(TURNED_LOOP, -1, 5),
    "thicker box": OffsetBody(Box((0, 0, 0), (4, 5, 6)), -1, Grid.enclosing(
        np.full(3, -1.0), np.array([5.0, 6, 7]), 0.25)),
    "inside of a bar": OffsetBody(Cylinder((0, 0, 0), (0, 0, 9), 4), 1, Grid.enclosing(
        np.full(3, -4.0), np.array([4.0, 4, 9]), 0.25)),
    "field of a ball": FieldSolid(stored_field(
        Sphere((0, 0, 0), 4).distance_at, Grid.enclosing(np.full(3, -4.0), np.full(3, 4.0), 0.5))),
    "turned twice": TransformedBody(Sphere((3, 1, 2), 4),
                                    similarity_transform(1, (1, 2, 3), 30, (0, 0, 0), (0, 0, 0))),
}


@pytest.mark.parametrize("name", TURNED)
def test_a_turned_body_ends_where_its_bounds_say(name: str) -> None:
    """A ball is no wider when it is turned; what is set down would hang in the air."""
    turned = TransformedBody(TURNED[name],
                             similarity_transform(1.5, (1, 1, 0), 40, (1, 0, 2), (3, 0, -1)))
    low, high = turned.tight_bounds_mm
    rng = np.random.default_rng(0)
    points = rng.uniform(low - 3, high + 3, (20_000, 3))
    for _ in range(3):
        points -= turned.distance_at(points)[:, None] * turned.inward_directions(points)
    points = points[np.abs(turned.distance_at(points)) < 1e-3]
    assert (points.min(axis=0) > low - 0.02).all()
    assert (points.max(axis=0) < high + 0.02).all()
    assert (points.min(axis=0) < low + 0.2).all()
    assert (points.max(axis=0) > high - 0.2).all()


def test_slivers_are_left_out() -> None:
    good = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    bad = [[[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[1, 1, 1]] * 3, [[0, 0, 0], [9, 0, 0], [4, 1e-7, 0]]]
    corners: NDArray[np.float64] = np.array([good, *bad], dtype=float)
    np.testing.assert_array_equal(remove_slivers(corners), corners[:1])


def test_plane_points_match_the_array() -> None:
    plane = PlaneGrid((1.0, 2.0), 0.5, (2, 3))
    points = plane_points(plane, 7.0).reshape(2, 3, 3)
    assert points[1, 2].tolist() == [2.0, 2.5, 7.0]


def test_nothing_of_a_body_lies_deeper_than_its_deepest_place() -> None:
    box = OffsetBody(Box((0, 0, 0), (4, 5, 6)), 2.5, Grid.enclosing(
        np.zeros(3), np.array([4.0, 5, 6]), 0.25))
    with pytest.raises(InputError, match=r"nothing lies deeper than 2\.5 mm") as refused:
        _ = box.tight_bounds_mm
    assert "the deepest place is at 2 mm" in refused.value.where[0]
    assert "lower from_mm" in refused.value.hint
