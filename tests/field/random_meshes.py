"""Random closed meshes of many kinds, each one solid whose triangles face out."""

from __future__ import annotations

import numpy as np
import trimesh
from manifold3d import Manifold, Mesh64
from scipy.spatial import ConvexHull

Mesh = tuple[np.ndarray, np.ndarray]

#: Sizes of whole meshes [mm].
SIZES_MM = (6.0, 25.0)


def random_mesh(rng: np.random.Generator) -> Mesh:
    """vertices (n, 3) float64 [mm], triangles (m, 3) int64."""
    kind = KINDS[int(rng.integers(len(KINDS)))]
    vertices, triangles = kind(rng)
    turn = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
    if rng.random() < 0.8:  # else along the grid's own axes
        vertices = vertices @ turn.T
    vertices = vertices - vertices.min(axis=0)
    vertices *= rng.uniform(*SIZES_MM) / vertices.max()
    return vertices + rng.uniform(-1.0, 1.0, 3), triangles


def _of(solid: Manifold) -> Mesh:
    mesh = solid.to_mesh64()
    return np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts, dtype=np.int64)


def _solid(mesh: trimesh.Trimesh) -> Manifold:
    return Manifold(Mesh64(np.asarray(mesh.vertices, dtype=np.float64),
                           np.asarray(mesh.faces, dtype=np.uint64)))


def _hull(rng: np.random.Generator) -> Mesh:
    points = rng.normal(size=(int(rng.integers(6, 60)), 3)) * rng.uniform(0.2, 1.0, 3)
    hull = trimesh.Trimesh(points, ConvexHull(points).simplices)
    hull.fix_normals()
    return np.asarray(hull.vertices), np.asarray(hull.faces)


def _bumpy(rng: np.random.Generator) -> Mesh:
    ball = trimesh.creation.icosphere(subdivisions=int(rng.integers(2, 5)))
    wave = np.sin(ball.vertices @ rng.normal(size=(3, 3)) * rng.uniform(1.0, 3.0))
    reach = 1.0 + rng.uniform(0.05, 0.4) * wave.prod(axis=1)
    return ball.vertices * reach[:, None] * rng.uniform(0.2, 1.0, 3), np.asarray(ball.faces)


def _blocks(rng: np.random.Generator) -> Mesh:
    """Boxes and bars united or taken away, some far thinner than they are long."""
    whole = Manifold.cube((10.0, 8.0, 6.0), True)
    for _ in range(int(rng.integers(1, 6))):
        size = rng.uniform(0.3, 8.0, 3)
        block = Manifold.cube(tuple(size), True) if rng.random() < 0.6 else (
            Manifold.cylinder(size[0], size[1] / 2, size[2] / 3, int(rng.integers(3, 40)), True))
        block = block.rotate(tuple(rng.uniform(0, 360, 3) * (rng.random() < 0.5)))
        block = block.translate(tuple(rng.uniform(-5, 5, 3)))
        whole = whole + block if rng.random() < 0.6 else whole - block
    pieces = sorted(whole.decompose(), key=lambda piece: piece.volume())
    return _of(pieces[-1])


def _ring(rng: np.random.Generator) -> Mesh:
    minor = rng.uniform(0.05, 0.45)
    ring = trimesh.creation.torus(1.0, minor, int(rng.integers(12, 60)), int(rng.integers(5, 24)))
    return np.asarray(ring.vertices), np.asarray(ring.faces)


def _star(rng: np.random.Generator) -> Mesh:
    """A prism over a star: thin points and deep grooves."""
    count = 2 * int(rng.integers(3, 12))
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    reach = np.where(np.arange(count) % 2, rng.uniform(0.15, 0.8), 1.0)
    outline = np.stack([np.cos(turn), np.sin(turn)], axis=1) * reach[:, None]
    from manifold3d import CrossSection

    return _of(Manifold.extrude(CrossSection([outline]), rng.uniform(0.1, 1.5)))


def _needle(rng: np.random.Generator) -> Mesh:
    return _of(Manifold.cylinder(10.0, rng.uniform(0.2, 3.0), 0.0, int(rng.integers(3, 24)), True))


KINDS = (_hull, _bumpy, _blocks, _ring, _star, _needle)
