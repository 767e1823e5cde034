"""Shells of a mesh made one solid: what overlaps is united, what is flush but for rounding joined.

Each shell that faces out is a solid; one that faces in is a cavity of the solid around it. Shells
that are clear of each other, or lie in each other as solid, cavity, solid, stay as they are to the
last digit. The others go through manifold3d, whose result bounds one solid.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import BoolArray, FloatArray, IntArray
from lmctl.errors import InputError
from lmctl.part.sources.mesh_gaps import OVERLAP_MM, ClosedGap, close_gap
from lmctl.part.sources.mesh_shells import (
    MeshShell,
    containment_matrix,
    nearby_pairs,
    split_into_shells,
)
from lmctl.part.sources.mesh_topology import connected_components

if TYPE_CHECKING:
    from manifold3d import Manifold

#: Solids nearer to each other than this were meant to be flush: no nozzle leaves such a gap [mm].
FLUSH_GAP_MM = 0.01

#: A gap narrower than this share of a bead is most likely not meant.
NARROW_GAP_BEADS = 0.1

#: Volumes and areas that differ by no more than this share are the same.
SAME_SIZE_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class _Union:
    """Shells that were made one; those of them that lay in another as solids; gaps closed."""

    shells: tuple[MeshShell, ...]
    nested: tuple[MeshShell, ...]
    gaps: tuple[ClosedGap, ...]


def unite_shells(
    vertices: FloatArray, triangles: IntArray, turned: BoolArray, name: str, bead_mm: float,
    remarks: list[str],
) -> tuple[FloatArray, IntArray]:
    """A closed mesh as the boundary of one solid, facing out.

    triangles : (m, 3), neighbours facing alike
    turned : (m,) those that had to be turned for that
    bead_mm : gaps far narrower than a bead, that are too wide to be closed here, are remarks
    remarks : what was done is appended to it
    raises : InputError, with the place, where shells cannot be united, or where one whose triangles
        faced both ways lies in another: a cavity or not would be a guess
    """
    shells = split_into_shells(vertices, triangles, turned, name, bead_mm)
    done: list[MeshShell] = []
    unions: list[_Union] = []
    for group in _near_groups(shells, FLUSH_GAP_MM):
        some = _facing_by_nesting([shells[n] for n in group], name, remarks)
        found, union = (some, None) if len(some) == 1 else _united(some, name)
        done += found
        unions += [] if union is None else [union]
    remarks += _in_words(unions)
    remarks += _narrow_gaps(done, NARROW_GAP_BEADS * bead_mm)
    starts = np.cumsum([0] + [len(shell.vertices) for shell in done])
    return np.vstack([shell.vertices for shell in done]), np.vstack(
        [shell.triangles + start for shell, start in zip(done, starts[:-1], strict=True)])


def _near_groups(shells: list[MeshShell], gap_mm: float) -> list[list[int]]:
    """Numbers of shells whose boxes come nearer to each other than a gap, together."""
    group = connected_components(nearby_pairs(shells, gap_mm), len(shells))
    return [np.flatnonzero(group == which).tolist() for which in np.unique(group)]


def _narrow_gaps(shells: list[MeshShell], narrow_mm: float) -> list[str]:
    """Remark on the narrowest gap between solids that no bead can leave open."""
    solids = [shell for shell in shells if shell.volume_mm3 > 0.0]
    width, place = narrow_mm, None
    for one, other in nearby_pairs(solids, narrow_mm).tolist():
        for shell, beside in ((solids[one], solids[other]), (solids[other], solids[one])):
            low, high = beside.box_mm[0] - narrow_mm, beside.box_mm[1] + narrow_mm
            near = np.all((shell.vertices >= low) & (shell.vertices <= high), axis=1)
            away = np.abs(beside.tree.signed_distance(shell.vertices[near]))
            away[away <= FLUSH_GAP_MM] = np.inf  # they touch there: no gap
            if len(away) and away.min() < width:
                width, place = float(away.min()), shell.vertices[near][int(np.argmin(away))]
    if place is None:
        return []
    at = ", ".join(f"{v:.2f}" for v in place)
    return [f"two solids lie {width:.2g} mm apart near ({at}) mm, far less than a bead: they are "
            "planned as two, and what is deposited will not keep them apart"]


def _facing_by_nesting(shells: list[MeshShell], name: str, remarks: list[str]) -> list[MeshShell]:
    """Outermost shells facing out; what lies in one that was turned is turned with it."""
    holds = containment_matrix(shells)
    result = list(shells)
    for number, shell in enumerate(shells):
        if holds[:, number].any():
            if not shell.is_consistently_oriented:
                raise InputError(
                    f"the mesh {name} has a shell inside another whose triangles face both ways",
                    where=f"{len(shell.triangles):,} triangles around {shell.location_text}: "
                          "a cavity or a solid?",
                    hint="make its triangles face one way: inwards for a cavity",
                )
        elif shell.volume_mm3 < 0.0:
            inner = np.flatnonzero(holds[number]).tolist()
            within = [number, *(n for n in inner if shells[n].is_consistently_oriented)]
            for n in within:
                result[n] = result[n].flipped()
            if shell.is_consistently_oriented:
                count = sum(len(shells[n].triangles) for n in within)
                remarks.append(f"a shell of {count:,} triangles is inside out; it was turned")
    return result


def _united(shells: list[MeshShell], name: str) -> tuple[list[MeshShell], _Union | None]:
    """Shells that come near each other: as they are where they bound one solid, else united."""
    shells, gaps = _without_gaps(shells)
    solids = [shell for shell in shells if shell.volume_mm3 > 0.0]
    cavities = [shell for shell in shells if shell.volume_mm3 <= 0.0]
    made = [_manifold(shell) for shell in solids]
    taken = [_manifold(shell.flipped()) for shell in cavities]
    if any(one is None for one in (*made, *taken)):
        return shells, None  # edges of more than two triangles: what overlaps is looked for later
    from manifold3d import Manifold, OpType

    parts = []
    for number, outer in enumerate(made):
        own = [taken[n] for n, cavity in enumerate(cavities)
               if _owner(cavity, solids) == number]
        parts.append(Manifold.batch_boolean([outer, *own], OpType.Subtract) if own else outer)
    united = Manifold.batch_boolean(parts, OpType.Add)
    volume = sum(shell.volume_mm3 for shell in shells)
    area = sum(_area(shell) for shell in shells)
    same = abs(united.volume() - volume) <= SAME_SIZE_TOLERANCE * volume and (
        abs(united.surface_area() - area) <= SAME_SIZE_TOLERANCE * area)
    if same and not gaps:
        return shells, None
    # Steps as deep as faces were moved into each other, and cuts across flat faces, are no shape.
    mesh = united.as_original().simplify(2.0 * OVERLAP_MM).to_mesh64()
    found = MeshShell(np.array(mesh.vert_properties, dtype=np.float64)[:, :3],
                      np.array(mesh.tri_verts, dtype=np.int64))
    if len(found.triangles) == 0:
        raise InputError(f"the solids of the mesh {name} cannot be united",
                         where=f"{len(shells)} shells around {shells[0].location_text}",
                         hint="unite them in the program they came from")
    nested = [solids[n] for n in np.flatnonzero(containment_matrix(solids).any(axis=0))]
    return [found], _Union(tuple(shells), tuple(nested), tuple(gaps))


def _in_words(unions: list[_Union]) -> list[str]:
    """Remark on shells that were united, in one line however many there are."""
    if not unions:
        return []
    gaps = [gap for union in unions for gap in union.gaps]
    nested = [shell for union in unions for shell in union.nested]
    made = "one solid" if len(unions) == 1 else f"{len(unions)} solids"
    count = sum(len(union.shells) for union in unions)
    text = f"{count} shells made {made}, "
    if gaps:
        widest = max(gaps, key=lambda gap: gap.width_mm)
        at = ", ".join(f"{v:.2f}" for v in widest.place_mm)
        text += (f"with gaps up to {max(widest.width_mm, 0.0):.2g} mm between flat faces closed, "
                 f"near ({at}) mm")
    else:
        text += f"as they overlap or touch around {unions[0].shells[0].location_text}"
    if nested:
        text += (f"; {len(nested)} of them lie in another and face out, which is no cavity: turn "
                 f"the triangles around {nested[0].location_text} inwards if one is meant")
    return [text]


def _without_gaps(shells: list[MeshShell]) -> tuple[list[MeshShell], list[ClosedGap]]:
    """Shells with flat faces moved onto those of others that they nearly touch, and the gaps."""
    moved = [shell.vertices.copy() for shell in shells]
    gaps: list[ClosedGap] = []
    for one, other in np.sort(nearby_pairs(shells, FLUSH_GAP_MM), axis=1).tolist():
        gaps += close_gap(moved[other], shells[other].triangles, moved[one],
                          shells[one].triangles, FLUSH_GAP_MM)
    if not gaps:
        return shells, []
    return [
        replace(shell, vertices=corners) for shell, corners in zip(shells, moved, strict=True)
    ], gaps


def _owner(cavity: MeshShell, solids: list[MeshShell]) -> int:
    """The smallest solid that a cavity lies in; −1 where none holds all of it."""
    holding = [n for n, solid in enumerate(solids) if solid.contains(cavity)]
    return min(holding, key=lambda n: solids[n].volume_mm3, default=-1)


def _manifold(shell: MeshShell) -> Manifold | None:
    """None where its edges do not have two triangles each."""
    from manifold3d import Error, Manifold, Mesh64  # only few meshes need it

    made = Manifold(Mesh64(
        vert_properties=np.ascontiguousarray(shell.vertices),
        tri_verts=np.ascontiguousarray(shell.triangles.astype(np.uint64))))
    return made if made.status() == Error.NoError else None


def _area(shell: MeshShell) -> float:
    a, b, c = (shell.vertices[shell.triangles[:, k]] for k in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
