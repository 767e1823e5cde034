"""The shells of a closed mesh: connected surfaces, and how they are nested."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lmctl.array_types import BoolArray, FloatArray, IntArray
from lmctl.errors import InputError
from lmctl.field.mesh.triangle_tree import TriangleTree
from lmctl.part.sources.mesh_orientation import (
    orient_by_parity,
    shell_numbers,
    signed_tetrahedron_volumes,
)
from lmctl.part.sources.mesh_topology import edge_numbers

#: Corners of a shell that are tested for lying in another.
MAX_CORNERS_TESTED = 50

#: More shells than this are no part but dust of a scan or of a lattice; each may lie in each other.
MAX_SHELLS = 10_000


@dataclass(frozen=True, eq=False)
class MeshShell:
    """A closed surface by corners of its own: vertices (n, 3), triangles (m, 3).

    is_consistently_oriented : whether its triangles all faced outwards or all inwards, so that they
        show whether it is a cavity
    """

    vertices: FloatArray
    triangles: IntArray
    is_consistently_oriented: bool = True

    @cached_property
    def volume_mm3(self) -> float:
        """Negative where it faces in."""
        return float(signed_tetrahedron_volumes(self.vertices, self.triangles).sum())

    @cached_property
    def tree(self) -> TriangleTree:
        return TriangleTree.of(self.vertices[self.triangles])

    @cached_property
    def box_mm(self) -> FloatArray:
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @property
    def location_text(self) -> str:
        """Where it is, for messages."""
        return "(" + ", ".join(f"{v:.2f}" for v in self.box_mm.mean(axis=0)) + ") mm"

    def flipped(self) -> MeshShell:
        return replace(self, triangles=self.triangles[:, ::-1])

    def contains(self, other: MeshShell) -> bool:
        """Whether another lies in it, by the one of its corners that is clearest of it."""
        if (other.box_mm[0] < self.box_mm[0]).any() or (other.box_mm[1] > self.box_mm[1]).any():
            return False
        step = -(-len(other.vertices) // MAX_CORNERS_TESTED)
        depth = self.tree.signed_distance(other.vertices[::step])
        return bool(depth[int(np.argmax(np.abs(depth)))] > 0.0)


def split_into_shells(
    vertices: FloatArray, triangles: IntArray, turned: BoolArray, name: str, bead_mm: float
) -> list[MeshShell]:
    """The shells of a mesh.

    turned : (m,) triangles that had to be turned to face as others do
    raises : InputError where there are more than `MAX_SHELLS`; it says how many of them are smaller
        than half a bead
    """
    number = shell_numbers(vertices, triangles)
    if len(number) and number.max() >= MAX_SHELLS:
        raise _too_many_shells(vertices, triangles, number, name, bead_mm)
    order = np.argsort(number, kind="stable")
    found = []
    for rows in np.split(order, np.flatnonzero(np.diff(number[order])) + 1):
        used, own = np.unique(triangles[rows], return_inverse=True)
        shell = MeshShell(vertices[used], own.reshape(-1, 3), not turned[rows].any())
        if (edge_numbers(shell.triangles)[1] > 2).any():
            faces_in = shell.volume_mm3 < 0.0 and shell.is_consistently_oriented
            shell = replace(
                shell, triangles=orient_by_parity(shell.vertices, shell.triangles))
            shell = shell.flipped() if faces_in else shell
        found.append(shell)
    return found


def _too_many_shells(
    vertices: FloatArray, triangles: IntArray, number: IntArray, name: str, bead_mm: float
) -> InputError:
    order = np.argsort(number, kind="stable")
    starts = np.searchsorted(number[order], np.arange(number.max() + 1))
    corners = vertices[triangles[order]]
    low = np.minimum.reduceat(corners.min(axis=1), starts)
    high = np.maximum.reduceat(corners.max(axis=1), starts)
    small = int(np.count_nonzero((high - low).max(axis=1) < bead_mm / 2))
    return InputError(
        f"the mesh {name} falls into {len(starts):,} separate pieces",
        where=f"{small:,} of them are smaller than half a bead of {bead_mm:g} mm and cannot be "
        f"deposited; at most {MAX_SHELLS:,} pieces are read",
        hint="delete loose pieces in the program that exported it, and export it again")


def nearby_pairs(shells: list[MeshShell], gap_mm: float) -> IntArray:
    """Pairs (k, 2) of numbers of shells whose boxes come nearer to each other than a gap."""
    if len(shells) < 2:
        return np.empty((0, 2), dtype=np.int64)
    low = np.array([shell.box_mm[0] for shell in shells]) - gap_mm
    high = np.array([shell.box_mm[1] for shell in shells])
    order = np.argsort(low[:, 0], kind="stable")
    links = [np.empty((0, 2), dtype=np.int64)]
    for place, number in enumerate(order.tolist()):
        last = int(np.searchsorted(low[order, 0], high[number, 0], side="right"))
        others = order[place + 1 : last]
        near = np.all((low[others] <= high[number]) & (high[others] >= low[number]), axis=1)
        links.append(np.stack([np.full(int(near.sum()), number), others[near]], axis=1))
    return np.vstack(links)


def containment_matrix(shells: list[MeshShell]) -> BoolArray:
    """(n, n): whether each shell holds each other one."""
    low = np.array([shell.box_mm[0] for shell in shells])
    high = np.array([shell.box_mm[1] for shell in shells])
    holds: BoolArray = np.all(low[:, None] <= low, axis=2)
    holds &= np.all(high[:, None] >= high, axis=2)
    np.fill_diagonal(holds, False)
    for one, other in np.argwhere(holds).tolist():
        holds[one, other] = shells[one].contains(shells[other])
    return holds
