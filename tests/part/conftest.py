"""Shared makings: files beside a part file, and six meshes of very different kinds."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]

MATERIALS = '[[material]]\nname = "316L"\n[[material]]\nname = "WC-12Co"\n'
STEEL = 'name = "p"\n[[material]]\nname = "316L"\n'


def stl_bytes(mesh: Mesh) -> bytes:
    """A binary STL, written here so that reading is not tested with the reader's own library."""
    vertices, triangles = mesh
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
    data = np.zeros(len(triangles), dtype=record)
    data["corners"] = vertices[triangles]
    return b"made for a test".ljust(80) + struct.pack("<I", len(triangles)) + data.tobytes()


def box_mesh(low: tuple[float, ...], high: tuple[float, ...]) -> Mesh:
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    vertices = np.array(low) + corners * (np.array(high) - np.array(low))
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return vertices, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def ball_mesh(radius: float, rows: int, columns: int, bumps: float = 0.0) -> Mesh:
    """A UV sphere, its radius waved by `bumps`; 2·columns·(rows − 1) triangles, facing out."""
    theta = np.linspace(0, np.pi, rows + 1)[1:-1]
    phi = 2 * np.pi * np.arange(columns) / columns
    t, p = (a.ravel() for a in np.meshgrid(theta, phi, indexing="ij"))
    r = radius * (1 + bumps * np.sin(5 * t) * np.sin(4 * p) * np.sin(t) ** 2)
    ring = r[:, None] * np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=1)
    vertices = np.vstack([ring, [(0, 0, radius), (0, 0, -radius)]])
    north, south, n = len(ring), len(ring) + 1, rows - 1
    faces = []
    j, k = np.arange(columns), (np.arange(columns) + 1) % columns
    faces.append(np.stack([np.full(columns, north), j, k], axis=1))
    for row in range(n - 1):
        a, b = row * columns + j, row * columns + k
        c, d = a + columns, b + columns
        faces += [np.stack([a, c, d], axis=1), np.stack([a, d, b], axis=1)]
    last = (n - 1) * columns
    faces.append(np.stack([last + k, last + j, np.full(columns, south)], axis=1))
    return vertices, np.vstack(faces)


def joined(meshes: list[Mesh]) -> Mesh:
    starts = np.cumsum([0] + [len(v) for v, _ in meshes[:-1]])
    return (
        np.vstack([v for v, _ in meshes]),
        np.vstack([t + start for (_, t), start in zip(meshes, starts, strict=True)]),
    )


def frame_mesh(cells: int, bar: float, height: float) -> Mesh:
    """A grate: cells × cells square holes right through a plate, one closed surface."""
    n = 2 * cells + 1
    solid = np.array([[i % 2 == 0 or j % 2 == 0 for i in range(n)] for j in range(n)])
    index: dict[tuple[int, int, int], int] = {}
    triangles = []

    def corner(i: int, j: int, k: int) -> int:
        return index.setdefault((i, j, k), len(index))

    def quad(a: int, b: int, c: int, d: int) -> None:
        triangles.extend([(a, b, c), (a, c, d)])

    for j, i in zip(*np.nonzero(solid), strict=True):
        floor = [corner(i, j, 0), corner(i + 1, j, 0), corner(i + 1, j + 1, 0), corner(i, j + 1, 0)]
        roof = [corner(i, j, 1), corner(i + 1, j, 1), corner(i + 1, j + 1, 1), corner(i, j + 1, 1)]
        quad(*floor[::-1])
        quad(*roof)
        for side, (dj, di) in enumerate([(-1, 0), (0, 1), (1, 0), (0, -1)]):
            y, x = j + dj, i + di
            if not (0 <= y < n and 0 <= x < n and solid[y, x]):
                nxt = (side + 1) % 4
                quad(floor[side], floor[nxt], roof[nxt], roof[side])
    vertices = np.array(list(index), dtype=float) * [bar, bar, height]
    return vertices, np.array(triangles)


def six_meshes() -> dict[str, tuple[Mesh, float]]:
    """Name → (mesh, its volume in mm³)."""
    posts = [
        box_mesh((8.0 * i, 8.0 * j, 0), (8.0 * i + 4, 8.0 * j + 4, 6))
        for i in range(8) for j in range(8)
    ]
    ball = ball_mesh(10.0, 24, 48)
    stray = np.vstack([ball[1], ball[1][:2], [[0, 400, 800]]])
    return {
        "thin": (box_mesh((0, 0, 0), (60, 1.2, 20)), 60 * 1.2 * 20),
        "tall": (box_mesh((0, 0, 0), (8, 6, 180)), 8 * 6 * 180.0),
        "islands": (joined(posts), 64 * 4 * 4 * 6.0),
        "holes": (frame_mesh(6, 4.0, 5.0), (13 * 13 - 36) * 16 * 5.0),
        "200k": (ball_mesh(30.0, 224, 448, bumps=0.04), float("nan")),
        "three too many": ((ball[0], stray), float("nan")),
    }


@pytest.fixture
def folder(tmp_path: Path) -> Callable[..., Path]:
    """Write files, given by name, and return their folder."""

    def write(**files: str | bytes) -> Path:
        for name, data in files.items():
            path = tmp_path / name.replace("__", ".")
            path.write_bytes(data.encode() if isinstance(data, str) else data)
        return tmp_path

    return write


@pytest.fixture(scope="session")
def making() -> type:
    """The makers above, for tests that cannot import a conftest."""

    class Making:
        stl = staticmethod(stl_bytes)
        box = staticmethod(box_mesh)
        ball = staticmethod(ball_mesh)
        join = staticmethod(joined)
        grate = staticmethod(frame_mesh)
        six = staticmethod(six_meshes)

    return Making
