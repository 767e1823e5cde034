"""Shells of a mesh made one solid: what overlaps is united, what is flush but for rounding joined.

Each shell that faces out is a solid; one that faces in is a cavity of the solid around it. Shells
that are clear of each other, or lie in each other as solid, cavity, solid, stay as they are to the
last digit. The others go through manifold3d, whose result bounds one solid.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lmctl.errors import InputError
from lmctl.field.mesh.triangle_tree import TriangleTree
from lmctl.part.sources.mesh_gaps import INTO_MM, Gap, close_gap
from lmctl.part.sources.mesh_orientation import facing_out_by_parity, shells_of, signed_volumes
from lmctl.part.sources.mesh_topology import connected_components, edge_numbers

if TYPE_CHECKING:
    from manifold3d import Manifold

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

#: Solids nearer to each other than this were meant to be flush: no nozzle leaves such a gap [mm].
GAP_MM = 0.01

#: Volumes and areas that differ by no more than this share are the same.
SAME_SHARE = 1e-9

#: Corners of a shell that are asked whether they lie in another.
CORNERS_ASKED = 50


@dataclass(frozen=True, eq=False)
class Shell:
    """A closed surface by corners of its own: vertices (n, 3), triangles (m, 3).

    is_told : whether its triangles faced one way, so that they say whether it is a cavity
    """

    vertices: FloatArray
    triangles: IntArray
    is_told: bool = True

    @cached_property
    def volume_mm3(self) -> float:
        """Negative where it faces in."""
        return float(signed_volumes(self.vertices, self.triangles).sum())

    @cached_property
    def tree(self) -> TriangleTree:
        return TriangleTree.of(self.vertices[self.triangles])

    @cached_property
    def box_mm(self) -> FloatArray:
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @property
    def place(self) -> str:
        """Where it is, for messages."""
        return "(" + ", ".join(f"{v:.2f}" for v in self.box_mm.mean(axis=0)) + ") mm"

    def turned(self) -> Shell:
        return replace(self, triangles=self.triangles[:, ::-1])

    def holds(self, other: Shell) -> bool:
        """Whether another lies in it, by the one of its corners that is clearest of it."""
        if (other.box_mm[0] < self.box_mm[0]).any() or (other.box_mm[1] > self.box_mm[1]).any():
            return False
        step = -(-len(other.vertices) // CORNERS_ASKED)
        depth = self.tree.signed_distance(other.vertices[::step])
        return bool(depth[int(np.argmax(np.abs(depth)))] > 0.0)


def one_solid(
    vertices: FloatArray, triangles: IntArray, turned: BoolArray, name: str, said: list[str]
) -> tuple[FloatArray, IntArray]:
    """A closed mesh as the boundary of one solid, facing out.

    triangles : (m, 3), neighbours facing alike
    turned : (m,) those that had to be turned for that
    said : what was done is appended to it
    raises : InputError, with the place, where shells cannot be united, or where one whose triangles
        faced both ways lies in another: a cavity or not would be a guess
    """
    shells = _shells(vertices, triangles, turned)
    done: list[Shell] = []
    for group in _near_groups(shells):
        some = _facing_by_nesting([shells[n] for n in group], name, said)
        done += some if len(some) == 1 else _united(some, name, said)
    starts = np.cumsum([0] + [len(shell.vertices) for shell in done])
    return np.vstack([shell.vertices for shell in done]), np.vstack(
        [shell.triangles + start for shell, start in zip(done, starts[:-1], strict=True)])


def _shells(vertices: FloatArray, triangles: IntArray, turned: BoolArray) -> list[Shell]:
    number = shells_of(vertices, triangles)
    order = np.argsort(number, kind="stable")
    found = []
    for rows in np.split(order, np.flatnonzero(np.diff(number[order])) + 1):
        used, own = np.unique(triangles[rows], return_inverse=True)
        shell = Shell(vertices[used], own.reshape(-1, 3), not turned[rows].any())
        if (edge_numbers(shell.triangles)[1] > 2).any():
            faces_in = shell.volume_mm3 < 0.0 and shell.is_told
            shell = replace(
                shell, triangles=facing_out_by_parity(shell.vertices, shell.triangles))
            shell = shell.turned() if faces_in else shell
        found.append(shell)
    return found


def _near_groups(shells: list[Shell]) -> list[list[int]]:
    """Numbers of shells whose boxes come nearer to each other than a gap, together."""
    low = np.array([shell.box_mm[0] for shell in shells]) - GAP_MM
    high = np.array([shell.box_mm[1] for shell in shells])
    order = np.argsort(low[:, 0], kind="stable")
    links = [np.empty((0, 2), dtype=np.int64)]
    for place, number in enumerate(order.tolist()):
        last = int(np.searchsorted(low[order, 0], high[number, 0], side="right"))
        others = order[place + 1 : last]
        near = np.all((low[others] <= high[number]) & (high[others] >= low[number]), axis=1)
        links.append(np.stack([np.full(int(near.sum()), number), others[near]], axis=1))
    group = connected_components(np.vstack(links), len(shells))
    return [np.flatnonzero(group == which).tolist() for which in np.unique(group)]


def _facing_by_nesting(shells: list[Shell], name: str, said: list[str]) -> list[Shell]:
    """Outermost shells facing out; what lies in one that was turned is turned with it."""
    holds = np.array([[a is not b and a.holds(b) for b in shells] for a in shells], dtype=bool)
    result = list(shells)
    for number, shell in enumerate(shells):
        if holds[:, number].any():
            if not shell.is_told:
                raise InputError(
                    f"the mesh {name} has a shell inside another whose triangles face both ways",
                    where=f"{len(shell.triangles):,} triangles around {shell.place}: a cavity or a "
                    "solid?",
                    hint="make its triangles face one way: inwards for a cavity",
                )
        elif shell.volume_mm3 < 0.0:
            inner = np.flatnonzero(holds[number]).tolist()
            within = [number, *(n for n in inner if shells[n].is_told)]
            for n in within:
                result[n] = result[n].turned()
            if shell.is_told:
                count = sum(len(shells[n].triangles) for n in within)
                said.append(f"a shell of {count:,} triangles is inside out; it was turned")
    return result


def _united(shells: list[Shell], name: str, said: list[str]) -> list[Shell]:
    """Shells that come near each other: as they are where they bound one solid, else united."""
    shells, gaps = _without_gaps(shells)
    solids = [shell for shell in shells if shell.volume_mm3 > 0.0]
    cavities = [shell for shell in shells if shell.volume_mm3 <= 0.0]
    made = [_manifold(shell) for shell in solids]
    taken = [_manifold(shell.turned()) for shell in cavities]
    if any(one is None for one in (*made, *taken)):
        return shells  # edges of more than two triangles: what overlaps is looked for by sections
    from manifold3d import Manifold, OpType

    parts = []
    for number, whole in enumerate(made):
        own = [taken[n] for n, cavity in enumerate(cavities)
               if _owner(cavity, solids) == number]
        parts.append(Manifold.batch_boolean([whole, *own], OpType.Subtract) if own else whole)
    united = Manifold.batch_boolean(parts, OpType.Add)
    volume = sum(shell.volume_mm3 for shell in shells)
    area = sum(_area(shell) for shell in shells)
    same = abs(united.volume() - volume) <= SAME_SHARE * volume and (
        abs(united.surface_area() - area) <= SAME_SHARE * area)
    if same and not gaps:
        return shells
    # Steps as deep as faces were moved into each other, and cuts across flat faces, are no shape.
    mesh = united.as_original().simplify(2.0 * INTO_MM).to_mesh64()
    found = Shell(np.array(mesh.vert_properties, dtype=np.float64)[:, :3],
                  np.array(mesh.tri_verts, dtype=np.int64))
    if len(found.triangles) == 0:
        raise InputError(f"the solids of the mesh {name} cannot be united",
                         where=f"{len(shells)} shells around {shells[0].place}",
                         hint="unite them in the program they came from")
    said.append(_in_words(shells, solids, gaps))
    return [found]


def _in_words(shells: list[Shell], solids: list[Shell], gaps: list[Gap]) -> str:
    nested = [s for s in solids if any(other is not s and other.holds(s) for other in solids)]
    if gaps:
        widest = max(gaps, key=lambda gap: gap.width_mm)
        at = ", ".join(f"{v:.2f}" for v in widest.place_mm)
        return (f"{len(shells)} shells made one solid, with gaps up to {widest.width_mm:.2g} mm "
                f"between flat faces closed, near ({at}) mm")
    text = f"{len(shells)} shells that overlap or touch made one solid, around {shells[0].place}"
    if nested:
        text += (f"; {len(nested)} of them lie in another and face out, which is no cavity: turn "
                 f"the triangles around {nested[0].place} inwards if one is meant")
    return text


def _without_gaps(shells: list[Shell]) -> tuple[list[Shell], list[Gap]]:
    """Shells with flat faces moved onto those of others that they nearly touch, and the gaps."""
    moved = [shell.vertices.copy() for shell in shells]
    gaps: list[Gap] = []
    for number, shell in enumerate(shells):
        for before in range(number):
            other = shells[before]
            apart = np.maximum(shell.box_mm[0] - other.box_mm[1], other.box_mm[0] - shell.box_mm[1])
            if apart.max() <= GAP_MM:
                gaps += close_gap(
                    moved[number], shell.triangles, moved[before], other.triangles, GAP_MM)
    if not gaps:
        return shells, []
    return [
        replace(shell, vertices=corners) for shell, corners in zip(shells, moved, strict=True)
    ], gaps


def _owner(cavity: Shell, solids: list[Shell]) -> int:
    """The smallest solid that a cavity lies in; −1 where none holds all of it."""
    holding = [n for n, solid in enumerate(solids) if solid.holds(cavity)]
    return min(holding, key=lambda n: solids[n].volume_mm3, default=-1)


def _manifold(shell: Shell) -> Manifold | None:
    """None where its edges do not have two triangles each."""
    from manifold3d import Error, Manifold, Mesh64  # only few meshes need it

    made = Manifold(Mesh64(
        vert_properties=np.ascontiguousarray(shell.vertices),
        tri_verts=np.ascontiguousarray(shell.triangles.astype(np.uint64))))
    return made if made.status() == Error.NoError else None


def _area(shell: Shell) -> float:
    a, b, c = (shell.vertices[shell.triangles[:, k]] for k in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
