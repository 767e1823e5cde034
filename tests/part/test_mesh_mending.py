"""Meshes as programs export them, not as they should be: mended and said, or refused with a place.

Each defect is made in sound meshes at random places; what comes back is the sound mesh's solid.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from manifold3d import Manifold
from scipy.spatial.transform import Rotation

from lmctl.errors import InputError
from lmctl.part.sources.mesh_files import Mesh
from lmctl.part.sources.mesh_repair import repair_mesh
from tests.part import angle_solid

BEAD_MM = 2.0
Solid = tuple[np.ndarray, np.ndarray]
ANGLE: Solid = (angle_solid.CORNERS, angle_solid.TRIANGLES)


def mended(solid: Any) -> tuple[Mesh, str]:
    """What comes back bounds one solid: each edge in as many triangles one way as the other."""
    whole, said = repair_mesh(Mesh(np.asarray(solid[0], float), np.asarray(solid[1], np.int64)),
                              "m",
                              BEAD_MM)
    edges = whole.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    forward, ahead = np.unique(edges, axis=0, return_counts=True)
    backward, behind = np.unique(edges[:, ::-1], axis=0, return_counts=True)
    assert np.array_equal(forward, backward)
    assert np.array_equal(ahead, behind)
    return whole, " | ".join(said)


def refused(solid: Any) -> InputError:
    with pytest.raises(InputError) as caught:
        mended(solid)
    assert caught.value.hint
    return caught.value


def volume(mesh: Any) -> float:
    vertices, triangles = (mesh.vertices, mesh.triangles) if isinstance(mesh, Mesh) else mesh
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def area(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def of(solid: Manifold) -> Solid:
    mesh = solid.to_mesh64()
    return np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts, dtype=np.int64)


def box(low: Any, size: Any) -> Solid:
    return of(Manifold.cube(tuple(map(float, size))).translate(tuple(map(float, low))))


def joined(*solids: Solid) -> Solid:
    starts = np.cumsum([0] + [len(v) for v, _ in solids])
    return (np.vstack([v for v, _ in solids]),
            np.vstack([t + n for (_, t), n in zip(solids, starts[:-1], strict=True)]))


def turned(solid: Solid, seed: int) -> Solid:
    """Along no axis, in the single precision of an STL."""
    turn = Rotation.random(random_state=seed).as_matrix()
    return (solid[0] @ turn.T).astype(np.float32).astype(np.float64), solid[1]


def inside_out(solid: Solid) -> Solid:
    return solid[0], solid[1][:, ::-1]


def round_bar(sections: int = 64) -> Solid:
    return of(Manifold.cylinder(4.0, 10.0, circular_segments=sections))


HOLED = Manifold.cube((9, 8, 7)) - Manifold.cube((3, 3, 20)).translate((2, 2, -1))
SOUND: list[Solid] = [ANGLE, round_bar(), of(Manifold.sphere(9.0, 24)), of(HOLED)]


@pytest.mark.parametrize("solid", SOUND)
@pytest.mark.parametrize("seed", range(4))
def test_t_junctions_are_cut(solid: Solid, seed: int) -> None:
    """Triangles cut in two, three or four along edges, their neighbours not."""
    rng = np.random.default_rng(seed)
    vertices, triangles = turned(solid, seed) if seed else solid
    true = volume((vertices, triangles))
    points, rows = vertices.tolist(), triangles.tolist()
    for number in rng.choice(len(triangles), 5, replace=False).tolist():
        a, b, c = rows[number]
        count = int(rng.integers(1, 4))
        shares = np.sort(rng.uniform(0.1, 0.9, count))
        first = len(points)
        points += [(1 - s) * vertices[a] + s * vertices[b] for s in shares]
        chain = [a, *range(first, first + count), b]
        rows[number] = [chain[0], chain[1], c]
        rows += [[p, q, c] for p, q in pairwise(chain[1:])]
    whole, said = mended((np.array(points), np.array(rows)))
    assert "T-junctions" in said
    assert volume(whole) == pytest.approx(true, rel=1e-6)
    assert area(whole) == pytest.approx(area(Mesh(vertices, triangles)), rel=1e-6)


def test_collinear_split_edges_of_both_sides_meet() -> None:
    """A face divided in thirds against its neighbour in halves."""
    points = [*angle_solid.CORNERS.tolist()]
    rows = [list(t) for t in angle_solid.TRIANGLES.tolist()]
    owners = [n for n, t in enumerate(rows) if {4, 5} <= set(t)]
    for share_count, number in zip((2, 3), owners, strict=True):
        at = next(k for k in range(3) if {rows[number][k], rows[number][(k + 1) % 3]} == {4, 5})
        a, b, c = (rows[number][(at + k) % 3] for k in range(3))
        shares = np.arange(1, share_count) / share_count
        first = len(points)
        points += [((1 - s) * np.array(points[a]) + s * np.array(points[b])).tolist()
                   for s in shares]
        chain = [a, *range(first, len(points)), b]
        rows[number] = [chain[0], chain[1], c]
        rows += [[p, q, c] for p, q in pairwise(chain[1:])]
    whole, said = mended((np.array(points), np.array(rows)))
    assert "T-junctions: 3 edges cut" in said
    assert volume(whole) == pytest.approx(1920.0)


@pytest.mark.parametrize("solid", SOUND)
@pytest.mark.parametrize("seed", range(4))
def test_facets_missing_from_faces_that_go_on_are_closed(solid: Solid, seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices, triangles = turned(solid, seed) if seed else solid
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    # One of each face only, so that the rest of it shows how it goes on.
    beside = (normal @ normal.T > 0.95).sum(axis=1) > 1
    number = int(rng.choice(np.flatnonzero(beside)))
    whole, said = mended((vertices, np.delete(triangles, number, axis=0)))
    assert "1 hole closed" in said
    assert volume(whole) == pytest.approx(volume((vertices, triangles)), rel=1e-6)


def test_several_facets_missing_that_meet_in_a_corner_are_distinguished() -> None:
    vertices, triangles = of(Manifold.cube((20, 20, 4)).refine(4))
    lid = np.flatnonzero((vertices[triangles][..., 2] == 4.0).all(axis=1))
    corner = triangles[lid[7], 0]
    around = lid[(triangles[lid] == corner).any(axis=1)]
    whole, said = mended((vertices, np.delete(triangles, around[[0, 2]], axis=0)))
    assert "closed" in said
    assert volume(whole) == pytest.approx(1600.0)


def test_a_whole_face_missing_is_refused_with_its_place() -> None:
    """A vessel or a block? Nothing in the mesh tells."""
    vertices, triangles = box((0, 0, 0), (10, 20, 30))
    lid = (vertices[triangles][..., 2] == 30).all(axis=1)
    error = refused((vertices, triangles[~lid]))
    assert "near (5.00, 10.00, 30.00) mm" in error.where[1]
    two_walls = [8, 9, 10, 11]
    assert "hole" in refused((ANGLE[0], np.delete(ANGLE[1], two_walls, axis=0))).where[1]


@pytest.mark.parametrize("solid", SOUND)
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 1.0])
def test_facets_that_face_the_wrong_way_are_turned(solid: Solid, share: float) -> None:
    rng = np.random.default_rng(int(share * 10))
    vertices, triangles = solid
    wrong = rng.permutation(len(triangles))[: round(share * len(triangles))]
    mixed = triangles.copy()
    mixed[wrong] = mixed[wrong, ::-1]
    whole, said = mended((vertices, mixed))
    assert volume(whole) == pytest.approx(volume(solid))
    assert "turned" in said


def test_a_surface_with_one_side_is_refused_with_a_place() -> None:
    """A Klein bottle cut by itself, as a grid of squares joined with a turn."""
    n = 12
    u, v = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.arange(n) * 2 * np.pi / n, indexing="ij")
    r = 8 + np.cos(u / 2) * np.sin(v) * 3 - np.sin(u / 2) * np.sin(2 * v) * 3
    points = np.stack([r * np.cos(u), r * np.sin(u),
                       3 * np.sin(u / 2) * np.sin(v) + 3 * np.cos(u / 2) * np.sin(2 * v)], axis=-1)
    rows = []
    for i in range(n):
        for j in range(n):
            def at(a: int, b: int) -> int:
                return (a % n) * n + ((-b) % n if a >= n else b % n)
            rows += [(at(i, j), at(i + 1, j), at(i + 1, j + 1)),
                     (at(i, j), at(i + 1, j + 1), at(i, j + 1))]
    error = refused((points.reshape(-1, 3), np.array(rows)))
    assert "one side only" in error.what
    assert "near (" in error.where[0]


def pair(kind: str) -> tuple[Manifold, Manifold]:
    cube = Manifold.cube((10, 10, 10))
    return {
        "corner in": (cube, cube.translate((4, 5, 6))),
        "side by side": (cube, cube.translate((10, 0, 0))),
        "shifted along": (cube, Manifold.cube((7, 4, 20)).translate((10, 3, -5))),
        "a ball in a side": (cube, Manifold.sphere(4.0, 32).translate((10, 5, 5))),
        "one in the other": (cube, Manifold.cube((4, 4, 4)).translate((3, 3, 3))),
        "in and flush": (cube, Manifold.cube((4, 4, 4)).translate((3, 3, 6))),
        "the same twice, shifted": (cube, cube.translate((1e-3, 0, 0))),
        "bars across": (Manifold.cube((30, 4, 4)), Manifold.cube((4, 30, 4)).translate((9, -9, 4))),
    }[kind]


KINDS = ("corner in", "side by side", "shifted along", "a ball in a side", "one in the other",
         "in and flush", "the same twice, shifted", "bars across")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_shells_that_overlap_touch_or_nest_are_one_solid(kind: str, seed: int) -> None:
    one, other = pair(kind)
    true = one + other
    solid = joined(of(one), of(other))
    whole, said = mended(turned(solid, seed) if seed else solid)
    assert volume(whole) == pytest.approx(true.volume(), rel=1e-5)
    assert area(whole) == pytest.approx(true.surface_area(), rel=2e-4)
    assert "made one solid" in said
    if kind == "one in the other":
        assert "1 of them" in said
        assert "cavity" in said


@pytest.mark.parametrize("kind", ["side by side", "shifted along", "bars across"])
@pytest.mark.parametrize("gap_mm", [1e-7, 1e-5, 1e-3, 5e-3])
@pytest.mark.parametrize("seed", [0, 1])
def test_gaps_no_nozzle_can_leave_are_closed_and_said(kind: str, gap_mm: float, seed: int) -> None:
    one, other = pair(kind)
    apart = (0.0, 0.0, gap_mm) if kind == "bars across" else (gap_mm, 0.0, 0.0)
    solid = joined(of(one), of(other.translate(apart)))
    turn = Rotation.random(random_state=seed).as_matrix() if seed else np.eye(3)
    whole, said = mended((solid[0] @ turn.T, solid[1]))
    true = one + other
    assert volume(whole) == pytest.approx(true.volume(), rel=1e-3)
    assert area(whole) == pytest.approx(true.surface_area(), rel=2e-3)
    assert "one solid" in said


def test_many_unions_are_said_in_one_line() -> None:
    pairs = [solid for n in range(5) for solid in (
        box((30 * n, 0, 0), (10, 10, 10)), box((30 * n + 5, 3, 3), (10, 4, 4)))]
    whole, said = mended(joined(*pairs))
    assert said.startswith("mesh m: 10 shells made 5 solids")
    assert "|" not in said
    assert volume(whole) == pytest.approx(5 * (1000 + 5 * 16))


def test_a_row_of_blocks_with_gaps_is_one_solid() -> None:
    row = joined(*(box((5.0 * n + 0.002 * n, 0, 0), (5, 5 + n % 2, 5)) for n in range(6)))
    whole, said = mended(row)
    assert "6 shells made one solid" in said
    assert "0.002 mm" in said
    assert Manifold(_mesh64(whole)).decompose().__len__() == 1


def _mesh64(mesh: Mesh) -> Any:
    from manifold3d import Mesh64

    return Mesh64(mesh.vertices, mesh.triangles.astype(np.uint64))


@pytest.mark.parametrize("gap_mm", [0.02, 0.15])
def test_gaps_too_wide_to_close_and_too_narrow_to_build_are_said(gap_mm: float) -> None:
    two = joined(box((0, 0, 0), (10, 10, 10)), box((10 + gap_mm, 2, 0), (10, 5, 10)))
    whole, said = mended(two)
    assert f"two solids lie {gap_mm:.2g} mm apart near (10" in said
    assert volume(whole) == pytest.approx(1500.0)


def test_solids_that_are_clear_of_each_other_stay_to_the_last_digit() -> None:
    near = joined(box((0, 0, 0), (10, 10, 10)), box((10.5, 0, 0), (10, 10, 10)),
                  inside_out(box((2, 2, 2), (6, 6, 6))), box((4, 4, 4), (1, 1, 1)))
    whole, said = mended(near)
    assert said == ""
    assert volume(whole) == pytest.approx(2000.0 - 216.0 + 1.0)
    assert {tuple(v) for v in whole.vertices.tolist()} == {tuple(v) for v in near[0].tolist()}
    assert len(whole.triangles) == len(near[1])


def test_a_part_that_is_inside_out_keeps_its_cavity() -> None:
    hollow = joined(box((0, 0, 0), (10, 10, 10)), inside_out(box((2, 2, 2), (6, 6, 6))))
    whole, said = mended(inside_out(hollow))
    assert "inside out" in said
    assert volume(whole) == pytest.approx(1000.0 - 216.0)


def test_an_overlap_keeps_the_cavities_of_its_solids() -> None:
    hollow = joined(box((0, 0, 0), (10, 10, 10)), inside_out(box((2, 2, 2), (4, 4, 4))))
    whole, _ = mended(joined(hollow, box((8, 1, 1), (10, 5, 5))))
    assert volume(whole) == pytest.approx(1000.0 - 64.0 + 8 * 25.0)
    reaching_in = joined(hollow, box((5, 3, 3), (10, 1, 1)))
    whole, _ = mended(reaching_in)
    assert volume(whole) == pytest.approx(1000.0 - 64.0 + 1.0 + 5.0)


def test_a_cavity_whose_triangles_face_both_ways_is_refused_with_its_place() -> None:
    inner = box((2, 2, 2), (6, 6, 6))
    inner[1][::2] = inner[1][::2, ::-1]
    error = refused(joined(box((0, 0, 0), (10, 10, 10)), inner))
    assert "around (5.00, 5.00, 5.00) mm" in error.where[0]


def test_a_shell_that_cuts_through_itself_is_refused_with_its_place() -> None:
    """A tube bent into itself: which of it is solid is not told."""
    ring = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    path = np.linspace(0, 3.0, 40)
    centre = np.stack([12 * np.cos(2.4 * path), 12 * np.sin(2.4 * path),
                       0.5 * path], axis=1)
    way = np.gradient(centre, axis=0)
    way /= np.linalg.norm(way, axis=1)[:, None]
    side = np.cross(way, (0, 0, 1.0))
    side /= np.linalg.norm(side, axis=1)[:, None]
    up = np.cross(side, way)
    points = centre[:, None] + 3 * (np.cos(ring)[:, None] * side[:, None]
                                    + np.sin(ring)[:, None] * up[:, None])
    rows = []
    for i in range(39):
        for j in range(24):
            a, b = 24 * i + j, 24 * i + (j + 1) % 24
            rows += [(a, b, b + 24), (a, b + 24, a + 24)]
    first, last = 24 * 40, 24 * 40 + 1
    rows += [(first, (j + 1) % 24, j) for j in range(24)]
    rows += [(last, 24 * 39 + j, 24 * 39 + (j + 1) % 24) for j in range(24)]
    corners = np.vstack([points.reshape(-1, 3), centre[[0, -1]]])
    error = refused((corners, np.array(rows)))
    assert "overlaps itself" in error.what
    assert "near (" in error.where[0]


def test_solids_that_touch_along_an_edge_face_out() -> None:
    one, other = box((0, 0, 0), (5, 5, 5)), box((5, 5, 0), (5, 5, 5))
    whole, said = mended(joined(one, inside_out(other)))
    assert "more than two triangles" in said
    assert volume(whole) == pytest.approx(250.0)
