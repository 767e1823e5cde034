"""Random surfaces of triangles, and scans of them, with libigl's distance as the truth."""

from __future__ import annotations

from pathlib import Path

import igl
import numpy as np
import trimesh

from lmctl.array_types import FloatArray
from tests.soak.solids import MATERIALS, Bound, random_composition, random_process

_NOISE_MM = (0.0, 0.01, 0.03)
#: Fewer samples than this far apart are another question [share of the pitch].
_SPACING_PITCHES = (0.3, 1.2)


def random_mesh_part(rng: np.random.Generator, folder: Path) -> tuple[str, Bound, float]:
    """A part file of a mesh, right or spoilt in a way that can be mended; how far off it may be."""
    mesh = _random_surface(rng)
    vertices, triangles = np.array(mesh.vertices), np.array(mesh.faces)
    harm = rng.choice(["none", "inside out", "doubled", "in inches"])
    units = "mm"
    if harm == "inside out":
        triangles = triangles[:, ::-1]
    elif harm == "doubled":
        triangles = np.vstack([triangles, triangles[: max(1, len(triangles) // 10)]])
    elif harm == "in inches":
        vertices, units = vertices / 25.4, "inch"
    name = f"surface.{rng.choice(['stl', 'obj', 'ply'])}"
    trimesh.Trimesh(vertices, triangles, process=False).export(folder / name)
    pitch_mm = round(float(rng.uniform(0.4, 0.7)), 2)
    return _part("mesh", name, units, pitch_mm, rng), _distance(mesh), 0.05 * pitch_mm


def random_cloud_part(rng: np.random.Generator, folder: Path) -> tuple[str, Bound, float]:
    """A part file of a scan, with normals or without; how far off it may be."""
    mesh = _random_surface(rng)
    pitch_mm = round(float(rng.uniform(0.4, 0.7)), 2)
    spacing_mm = pitch_mm * rng.uniform(*_SPACING_PITCHES)
    points, faces = trimesh.sample.sample_surface(
        mesh, int(mesh.area / spacing_mm**2), seed=int(rng.integers(2**31)))
    columns = [points + rng.normal(size=points.shape) * rng.choice(_NOISE_MM)]
    if rng.random() < 0.5:
        columns.append(mesh.face_normals[faces])
    np.savetxt(folder / "scan.xyz", np.hstack(columns), fmt="%.5f")
    text = _part("cloud", "scan.xyz", "mm", pitch_mm, rng)
    return text, _distance(mesh), 1.5 * max(spacing_mm, pitch_mm)


def _part(kind: str, name: str, units: str, pitch_mm: float, rng: np.random.Generator) -> str:
    return (
        f'name = "random {kind}"\npitch_mm = {pitch_mm}\n{MATERIALS}'
        f'[[body]]\nkind = "{kind}"\nfile = "{name}"\nunits = "{units}"\n'
        + random_composition(rng) + random_process(rng)
    )


def _distance(mesh: trimesh.Trimesh) -> Bound:
    vertices, triangles = np.array(mesh.vertices), np.array(mesh.faces)

    def distance(points: FloatArray) -> FloatArray:
        outside = igl.signed_distance(
            np.ascontiguousarray(points), vertices, triangles,
            igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL)[0]
        return -np.asarray(outside)

    return distance


def _random_surface(rng: np.random.Generator) -> trimesh.Trimesh:
    """One closed surface of some 10 mm, turned any way."""
    create = trimesh.creation
    kind = rng.choice(["blob", "box", "annulus", "capsule", "cone", "torus"])
    if kind == "blob":
        mesh = create.icosphere(subdivisions=int(rng.integers(2, 5)), radius=rng.uniform(4, 8))
        phases, heights = 4 * rng.normal(size=(4, 3)), rng.uniform(0, 0.12, 4)
        ways = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1)[:, None]
        mesh.vertices = mesh.vertices * (1 + np.sin(ways @ phases.T) @ heights)[:, None]
    elif kind == "box":
        mesh = create.box(rng.uniform(4, 14, 3))
    elif kind == "annulus":
        inner = rng.uniform(2, 4)
        mesh = create.annulus(inner, inner + rng.uniform(2.5, 4), rng.uniform(4, 10),
                              sections=int(rng.integers(16, 80)))
    elif kind == "capsule":
        mesh = create.capsule(rng.uniform(3, 8), rng.uniform(2, 5))
    elif kind == "cone":
        mesh = create.cone(rng.uniform(3, 7), rng.uniform(5, 10))
    else:
        mesh = create.torus(rng.uniform(4, 7), rng.uniform(1.5, 3))
    mesh.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
    return mesh
