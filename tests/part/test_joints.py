"""Bodies that lie flush are one solid: no slit, notch or false depth where they join."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmctl.array_types import FloatArray
from lmctl.field.grid import Grid
from lmctl.field.plane import PlaneGrid, loop_area_mm2
from lmctl.part.bodies.body import Body
from lmctl.part.bodies.formulas import Box, Cylinder
from lmctl.part.bodies.mesh_solid import MeshSolid
from lmctl.part.bodies.prism import Prism
from lmctl.part.bodies.transformed import TransformedBody, similarity_transform
from lmctl.part.booleans.combined import CombinedBody
from lmctl.part.booleans.offset import OffsetBody
from lmctl.part.sources.mesh_files import Mesh

Corner = tuple[float, float, float]
WHOLE = Box((0.0, 0.0, 0.0), (6.0, 4.0, 3.0))
PLANE = PlaneGrid((-2.0, -2.0), 0.25, (56, 56))
TURN = similarity_transform(1.0, (0, 0, 1), 30.0, (0, 0, 0), (3.0, 1.2, 0.1))
TILT = similarity_transform(1.0, (1, 2, 1), 40.0, (0, 0, 0), (3.0, 3.0, 0.1))


def prism(low: Corner, high: Corner) -> Prism:
    (x0, y0, z0), (x1, y1, z1) = low, high
    return Prism(np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]), z0, z1)


def union(bodies: Sequence[Body], pitch: float = 0.5) -> CombinedBody:
    low = np.min([body.enclosing_box_mm[0] for body in bodies], axis=0)
    high = np.max([body.enclosing_box_mm[1] for body in bodies], axis=0)
    return CombinedBody("union", tuple(bodies), Grid.enclosing(low, high, pitch, 3))


def parted(make: Callable[[Corner, Corner], Body], *cuts: Sequence[float]) -> list[Body]:
    """The whole box in pieces, cut at x, y, z."""
    ends = [
        pairwise([low, *sorted(set(own)), high])
        for low, own, high in zip(WHOLE.low_mm, cuts, WHOLE.high_mm, strict=True)
    ]
    return [
        make((x0, y0, z0), (x1, y1, z1)) for (x0, x1), (y0, y1), (z0, z1) in product(*ends)
    ]


def check(body: CombinedBody, truth: Callable[[FloatArray], FloatArray], z: float) -> None:
    """Depths at the nodes, and an outline in one piece that lies where the surface is."""
    points = body.grid.window().node_points()
    true = truth(points)
    assert np.abs(body.distance_at(points) - true).max() < 1e-6
    assert np.abs(body.distance(body.grid.window()).ravel() - true).max() < 1e-5
    away = np.linalg.norm(body.closest_points(points) - points, axis=1)
    assert np.abs(away - np.abs(true)).max() < 1e-6
    inside = np.abs(true) > 1e-6
    assert np.array_equal(body.distance_bound(points)[inside] > 0, true[inside] > 0)
    (loop,) = body.outline_loops(z, PLANE)
    on_it = np.column_stack([loop, np.full(len(loop), z)])
    assert np.abs(truth(on_it)).max() < 1e-6


# On nodes, halfway between them, just beside them, and anywhere.
cut = st.sampled_from([0.25, 0.5, 0.125, 0.26, 0.013]) | st.floats(0.05, 0.95)


@settings(max_examples=5, deadline=None)
@given(
    st.lists(cut, min_size=1, max_size=2), st.lists(cut, max_size=1), st.lists(cut, max_size=1),
    st.sampled_from([Box, prism]), st.sampled_from([0.37, 1.5, 2.6]),
)
def test_a_box_in_pieces_is_the_box(
    x: list[float], y: list[float], z: list[float], make: Callable[[Corner, Corner], Body],
    height: float,
) -> None:
    shares = (np.round(own, 3) for own in (x, y, z))
    cuts = [high * share for high, share in zip(WHOLE.high_mm, shares, strict=True)]
    bodies = parted(make, *(list(map(float, own)) for own in cuts))
    check(union(bodies, 1.0), WHOLE.distance_at, height)


@pytest.mark.parametrize("make", [Box, prism])
def test_pieces_that_were_turned_still_join(make: Callable[[Corner, Corner], Body]) -> None:
    pieces = parted(make, [2.5, 4.0], [1.5], [])
    turned, whole = union([TransformedBody(piece, TURN) for piece in pieces],
                          1.0), TransformedBody(WHOLE, TURN)
    points = turned.grid.window().node_points()
    assert np.abs(turned.distance_at(points) - whole.distance_at(points)).max() < 1e-6
    (loop,) = turned.outline_loops(1.3, PLANE)
    (true,) = whole.outline_loops(1.3, PLANE)
    assert loop_area_mm2(loop) == pytest.approx(loop_area_mm2(true), rel=1e-6)
    on_it = np.column_stack([loop, np.full(len(loop), 1.3)])
    assert np.abs(whole.distance_at(on_it)).max() < 1e-6


def test_pieces_that_were_tilted_still_join() -> None:
    tilted = union([TransformedBody(piece, TILT) for piece in parted(Box, [2.5], [1.5], [])], 1.0)
    whole = TransformedBody(WHOLE, TILT)
    points = tilted.grid.window().node_points()
    assert np.abs(tilted.distance_at(points) - whole.distance_at(points)).max() < 1e-6
    z = float(np.mean(whole.tight_bounds_mm, axis=0)[2])
    plane = PlaneGrid((-12.0, -12.0), 0.25, (120, 120))
    (loop,), (true,) = tilted.outline_loops(z, plane), whole.outline_loops(z, plane)
    assert loop_area_mm2(loop) == pytest.approx(loop_area_mm2(true), rel=1e-6)


def test_meshes_that_lie_flush_are_one(making: Any) -> None:
    def mesh(low: Corner, high: Corner) -> MeshSolid:
        shift = np.full(3, 0.13)
        vertices, triangles = making.box(np.array(low) + shift, np.array(high) + shift)
        grid = Grid.enclosing(vertices.min(axis=0), vertices.max(axis=0), 0.5, 3)
        return MeshSolid(Mesh(vertices, triangles), grid)

    body = union(parted(mesh, [3.0], [], []))
    whole = Box((0.13, 0.13, 0.13), (6.13, 4.13, 3.13))
    on_joint = np.array([(3.13, y, z) for y in (1.0, 2.0, 3.2) for z in (1.0, 1.7, 2.4)])
    # a tenth of their pitch
    assert np.abs(body.distance_at(on_joint) - whole.distance_at(on_joint)).max() < 0.05
    (loop,) = body.outline_loops(1.4, PLANE)
    assert loop_area_mm2(loop) == pytest.approx(24.0, rel=5e-3)


@pytest.mark.parametrize(
    "corners", [[(0, 0), (6, 0), (2, 6)], [(0, 0), (3, 0), (6, 0), (6, 6), (0, 6)]])
def test_wedges_that_meet_at_one_edge_are_one(corners: list[tuple[float, float]]) -> None:
    """Three and five at an edge that lies on nodes."""
    middle = (3.0, 3.0)
    rim = np.array(corners, dtype=float)
    wedges = [
        Prism(np.array([middle, a, b, middle]), 0.0, 3.0)
        for a, b in zip(rim, np.roll(rim, -1, axis=0), strict=True)
    ]
    whole, body = Prism(np.vstack([rim, rim[:1]]), 0.0, 3.0), union(wedges, 1.0)
    points = body.grid.window().node_points()
    assert np.abs(body.distance_at(points) - whole.distance_at(points)).max() < 1e-6
    (loop,) = body.outline_loops(1.3, PLANE)
    assert loop_area_mm2(loop) == pytest.approx(loop_area_mm2(whole.loop_mm), rel=5e-3)


def test_a_plug_in_its_own_hole_fills_it() -> None:
    disc = Cylinder((3, 3, 0), (3, 3, 3), 3.5)
    for plug in (Cylinder((3, 3, 0), (3, 3, 3), 1.5), Box((2.0, 2.0, 0.0), (4.0, 4.0, 3.0))):
        ring = CombinedBody("difference", (disc, plug), union((disc,)).grid)
        body = union((ring, plug))
        points = body.grid.window().node_points()
        assert np.abs(body.distance_at(points) - disc.distance_at(points)).max() < 1e-6
        (loop,) = body.outline_loops(1.3, PLANE)
        assert loop_area_mm2(loop) == pytest.approx(np.pi * 3.5**2, rel=2e-3)


def test_a_bar_on_a_plate_is_deep_where_it_stands() -> None:
    body = union((Box((0.0, 0.0, 0.0), (10.0, 10.0, 4.0)), Cylinder((5, 5, 4), (5, 5, 9), 3.0)))
    on_joint = np.array([(5.0, 5, 4), (6.0, 5, 4), (5.0, 3, 4), (9.0, 5, 4)])
    assert body.distance_at(on_joint) == pytest.approx([3, 2, 1, 0], abs=1e-9)
    assert body.distance_bound(on_joint[:3]).min() > 0
    # From the middle of the foot the nearest surface is the rim of the foot, all around.
    assert body.inward_directions(on_joint[1:3]) == pytest.approx(np.array([(-1.0, 0, 0),
                                                                            (0, 1, 0)]))


def test_shells_of_flush_bodies_are_one() -> None:
    body = union(parted(Box, [3.0], [], []), 1.0)
    core = OffsetBody(body, 1.0, body.grid)
    (loop,) = core.outline_loops(1.5, PLANE)
    assert loop_area_mm2(loop) == pytest.approx(4.0 * 2.0, rel=0.02)
    assert core.distance_at(np.array([(3.0, 2.0, 1.5)])) == pytest.approx([0.5])
