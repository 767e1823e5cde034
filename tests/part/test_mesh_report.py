"""Defects of meshes: what is mended and said, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lmctl.errors import InputError
from lmctl.part.sources.mesh_files import Mesh
from lmctl.part.sources.mesh_repair import repair_mesh

BEAD_MM = 2.0


def mended(mesh: tuple[Any, Any]) -> tuple[Mesh, tuple[str, ...]]:
    given = Mesh(np.asarray(mesh[0], float), np.asarray(mesh[1], np.int64))
    whole, said = repair_mesh(given, "m", BEAD_MM)
    edges = np.sort(whole.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0).all()
    return whole, said


def volume(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.fixture
def ball(making: Any) -> Any:
    return making.ball(10.0, 24, 48)


def test_a_sound_mesh_is_left_alone(making: Any) -> None:
    for mesh, _ in making.six().values():
        if len(mesh[1]) < 10_000 and len(mesh[1]) != 2 * 48 * 23 + 3:
            whole, said = mended(mesh)
            assert said == ()
            assert len(whole.triangles) == len(mesh[1])


def test_a_soup_is_joined(ball: Any) -> None:
    soup = ball[0][ball[1]].reshape(-1, 3)
    whole, said = mended((soup, np.arange(len(soup)).reshape(-1, 3)))
    assert said == ()
    assert len(whole.vertices) == len(ball[0])


def test_rounded_seams_are_joined(ball: Any) -> None:
    soup = ball[0][ball[1]].reshape(-1, 3)
    soup = soup + np.random.default_rng(0).uniform(-2e-4, 2e-4, soup.shape)
    _, said = mended((soup, np.arange(len(soup)).reshape(-1, 3)))
    assert "seams up to 0.001 mm wide joined" in said[0]


def test_inside_out_is_turned(ball: Any) -> None:
    whole, said = mended((ball[0], ball[1][:, ::-1]))
    assert "inside out" in said[0]
    assert volume(whole) > 4000


def test_an_island_inside_out_is_turned_a_cavity_is_not(making: Any) -> None:
    outer, inner = making.box((0, 0, 0), (20, 20, 20)), making.box((5, 5, 5), (15, 15, 15))
    away = making.box((30, 0, 0), (40, 20, 20))
    whole, said = mended(making.join([outer, (inner[0], inner[1][:, ::-1])]))
    assert said == ()
    assert volume(whole) == pytest.approx(7000)
    whole, said = mended(making.join([outer, (away[0], away[1][:, ::-1])]))
    assert "12 triangles is inside out" in said[0]
    assert volume(whole) == pytest.approx(12000)


def test_copies_are_left_out(ball: Any) -> None:
    for extra in (ball[1][:3], ball[1], ball[1][:, ::-1], ball[1][:, [1, 2, 0]]):
        whole, said = mended((ball[0], np.vstack([ball[1], extra])))
        assert f"{len(extra):,} triangles there more than once" in said[0]
        assert len(whole.triangles) == len(ball[1])


def test_a_common_wall_is_left_out(making: Any) -> None:
    left, right = making.box((0, 0, 0), (10, 10, 10)), making.box((10, 0, 0), (20, 10, 10))
    wall = np.where((left[0][left[1]][:, :, 0] == 10).all(axis=1))[0]
    facing = np.where((right[0][right[1]][:, :, 0] == 10).all(axis=1))[0]
    both = making.join([left, right])
    # give the two walls the same diagonal, as one program would
    both[1][facing + 12] = both[1][wall][:, ::-1]
    whole, said = mended(both)
    assert "more than once" in said[0]
    assert len(whole.triangles) == 20
    assert volume(whole) == pytest.approx(2000)


def test_collapsed_triangles_are_left_out(ball: Any) -> None:
    whole, said = mended((ball[0], np.vstack([ball[1], [[3, 3, 9], [5, 5, 5]]])))
    assert "2 triangles without area" in said[0]
    assert len(whole.triangles) == len(ball[1])


@pytest.mark.parametrize(
    "extra",
    [
        [[0, 400, 800]],  # through the inside, on no edge
        [[0, 1, -1]],  # a fin on the edge 0–1
        [[0, 1, -1], [1, 9, -1], [300, 500, 700]],
        [[0, 30, -1], [30, 60, -1]],  # a sheet that floats
    ],
)
def test_triangles_too_many_are_left_out(ball: Any, extra: list[list[int]]) -> None:
    vertices = np.vstack([ball[0], [(0, 0, 20)]])
    stray = np.array(extra)
    stray[stray < 0] = len(ball[0])
    whole, said = mended((vertices, np.vstack([ball[1], stray])))
    assert f"{len(extra)} triangle" in said[0]
    assert "too many" in said[0]
    assert len(whole.triangles) == len(ball[1])


def test_small_holes_are_closed_and_their_size_is_said(ball: Any) -> None:
    whole, said = mended((ball[0], np.delete(ball[1], [100, 700], axis=0)))
    assert "2 holes closed" in said[0]
    assert volume(whole) == pytest.approx(volume(Mesh(*ball)), rel=1e-3)


def test_an_open_mesh_is_refused_with_the_place(making: Any) -> None:
    vertices, triangles = making.box((0, 0, 0), (10, 20, 30))
    lid = (vertices[triangles][:, :, 2] == 30).all(axis=1)
    with pytest.raises(InputError, match="the mesh m is open") as caught:
        mended((vertices, triangles[~lid]))
    assert "1 hole, 4 open edges of 10 triangles" in caught.value.where[0]
    assert "22.4 mm across, near (5.00, 10.00, 30.00) mm" in caught.value.where[1]
    assert caught.value.hint


def test_turned_triangles_are_turned_back_and_said(ball: Any) -> None:
    triangles = ball[1].copy()
    triangles[50] = triangles[50, ::-1]
    whole, said = mended((ball[0], triangles))
    assert "1 triangle faced the other way" in said[0]
    assert volume(whole) == pytest.approx(volume(Mesh(*ball)))


def test_nothing_left_is_refused() -> None:
    with pytest.raises(InputError, match="encloses nothing"):
        mended(([(0, 0, 0), (1, 0, 0), (0, 1, 1)], [[0, 0, 1], [2, 1, 1]]))
