"""Solve symmetric positive definite systems: by factors where small, by multigrid where large.

Large systems are solved by conjugate gradients. Their preconditioner takes quadratic elements to
linear ones of the same nodes, and these by smoothed aggregation (pyamg). A solver is kept for all
loads of one matrix, adjoint ones too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, bsr_matrix, csr_array, csr_matrix, diags, kron
from scipy.sparse.linalg import splu

from lmctl.array_types import BoolArray, FloatArray, IntArray
from lmctl.errors import InputError
from lmctl.field.kernel import kernel

#: Unknowns up to which factors are faster and fit: factors fill in far more in 3D.
DIRECT_UNKNOWNS = {2: 150_000, 3: 12_000}

#: Relative residual at which iterations end, and how many there may be.
TOLERANCE = 1e-8
MAX_ITERATIONS = 500

#: Bytes of memory an unknown takes: of the matrix in 2D and 3D, with solver and element arrays.
BYTES_PER_UNKNOWN = {2: 4_000, 3: 6_000}


class FieldSolver:
    """Solver of one matrix with some values held.

    matrix : (n · block, n · block), symmetric
    held : (n, block), which values are given
    coarse : (n, vertices) interpolation from the linear elements' nodes; rows sum to 1
    near_null : (n, block, k), motions that cost almost nothing
    """

    def __init__(
        self, matrix: csr_array | bsr_array, held: BoolArray, dim: int, coarse: csr_matrix,
        near_null: FloatArray,
    ) -> None:
        self._free = ~held.ravel()
        self._matrix = matrix
        self._block = held.shape[1]
        self.n_unknowns = int(self._free.sum())
        self.iterations = 0
        # No bound method is kept in its own object: that circle would hold the memory of a solver
        # until cycles are collected, and there is one a design.
        self._factors: Any = None
        if self.n_unknowns <= DIRECT_UNKNOWNS[dim]:
            inner = matrix.tocsc()[self._free][:, self._free]
            self._factors = splu(inner, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
                                 options={"SymmetricMode": True})
        else:
            self._prepare_multigrid(coarse, near_null)

    def solve(
        self, load: FloatArray, given: FloatArray | None = None, guess: FloatArray | None = None
    ) -> FloatArray:
        """Values (n, block) under a load (n, block).

        given : held values (n, block), None is 0; guess : (n, block) where iterations begin

        Raises InputError where iterations do not converge.
        """
        values = np.zeros(self._free.size) if given is None else given.ravel().copy()
        values[self._free] = 0.0
        right = load.ravel() if given is None else load.ravel() - self._matrix @ values
        if self._factors is not None:
            values[self._free] = self._factors.solve(right[self._free])
        else:
            begin = np.zeros(self.n_unknowns) if guess is None else guess.ravel()[self._free]
            values[self._free] = self._by_multigrid(right[self._free], begin)
        return values.reshape(-1, self._block)

    def _prepare_multigrid(self, coarse: csr_matrix, near_null: FloatArray) -> None:
        import pyamg

        size = (self._block, self._block)
        mask = self._free.astype(float)
        top = self._masked(mask)
        # A linear node moves freely where its own values are free.
        owner = np.asarray(coarse.argmax(axis=1)).ravel()
        vertex_row = np.zeros(coarse.shape[1], dtype=np.int64)
        single = np.asarray(np.diff(coarse.indptr) == 1)
        vertex_row[owner[single]] = np.flatnonzero(single)
        vertex_mask = mask.reshape(-1, self._block)[vertex_row].ravel()
        by_block = kron(coarse, np.eye(self._block)).tocsr()
        down = (diags(mask) @ by_block @ diags(vertex_mask)).tocsr()
        linear = (down.T @ top.tocsr() @ down).tocsr()
        empty = linear.diagonal() == 0.0
        linear = linear + diags(np.where(empty, linear.diagonal().max(), 0.0))
        motions = (near_null.reshape(self._free.size, -1) * mask[:, None]).reshape(
            -1, self._block, near_null.shape[2])
        coarse_motions = motions[vertex_row].reshape(-1, near_null.shape[2])
        smoother = ("block_gauss_seidel", {"sweep": "symmetric"})
        lower = pyamg.smoothed_aggregation_solver(
            bsr_matrix(linear, blocksize=size), B=coarse_motions,
            strength=("symmetric", {"theta": 0.0}), max_coarse=300, improve_candidates=None,
            presmoother=smoother, postsmoother=smoother)
        self._top, self._inverse = top, _inverse_blocks(top)
        self._down, self._up = down, down.T.tocsr()
        self._coarse_cycle = lower.aspreconditioner()

    def _precondition(self, residual: FloatArray) -> FloatArray:
        """One sweep down, a coarse correction, one sweep up: symmetric, for conjugate gradients.

        residual : (n · block,)
        """
        top, block = self._top, self._block
        right = residual.reshape(-1, block)
        swept = np.zeros_like(right)
        sweep_blocks(top.indptr, top.indices, top.data, self._inverse, right, swept, False)
        x = swept.ravel()
        x += self._down @ (self._coarse_cycle @ (self._up @ (residual - top @ x)))
        sweep_blocks(top.indptr, top.indices, top.data, self._inverse, right,
                     x.reshape(-1, block), True)
        return x

    def _masked(self, mask: FloatArray) -> bsr_matrix:
        """The matrix with held rows and columns cleared, ones of its own size on the diagonal."""
        found = bsr_matrix(self._matrix, blocksize=(self._block, self._block), copy=True)
        rows = np.repeat(np.arange(len(found.indptr) - 1), np.diff(found.indptr))
        of = mask.reshape(-1, self._block)
        found.data *= of[rows][:, :, None] * of[found.indices][:, None, :]
        scale = float(np.abs(found.data).max())
        on_diagonal = np.flatnonzero(rows == found.indices)
        found.data[on_diagonal] += scale * (1.0 - of)[:, :, None] * np.eye(self._block)
        return found

    def _by_multigrid(self, load: FloatArray, begin: FloatArray) -> FloatArray:
        """Preconditioned conjugate gradients on the free values."""
        whole = np.zeros(self._free.size)
        whole[self._free] = load
        x = np.zeros_like(whole)
        x[self._free] = begin
        residual = whole - self._top @ x
        target = TOLERANCE * float(np.linalg.norm(whole))
        if target == 0.0:
            return x[self._free]
        z = self._precondition(residual)
        way, product = z.copy(), _dot(residual, z)
        for self.iterations in range(1, MAX_ITERATIONS + 1):
            image = self._top @ way
            step = product / _dot(way, image)
            x += step * way
            residual -= step * image
            if _dot(residual, residual) <= target**2:
                return x[self._free]
            z = self._precondition(residual)
            product, before = _dot(residual, z), product
            way = z + product / before * way
        raise InputError(
            f"the equations did not converge in {MAX_ITERATIONS} iterations",
            where=f"{self.n_unknowns:,} unknowns",
            hint="materials may differ too much, or the part hangs on next to nothing; try another "
            "mesh_mm")


def _dot(a: FloatArray, b: FloatArray) -> float:
    """A sum of products without a library's threads, which cost more than it here."""
    return float(np.einsum("i,i", a, b))


def _inverse_blocks(matrix: bsr_matrix) -> FloatArray:
    """(n, block, block), inverse of each block on the diagonal."""
    rows = np.repeat(np.arange(len(matrix.indptr) - 1), np.diff(matrix.indptr))
    return np.ascontiguousarray(np.linalg.inv(matrix.data[rows == matrix.indices]))


@kernel
def sweep_blocks(
    starts: NDArray[np.int32], columns: NDArray[np.int32], blocks: FloatArray, inverse: FloatArray,
    right: FloatArray, x: FloatArray, backwards: bool,
) -> None:
    """One sweep of block Gauss-Seidel over a block matrix, in place of x (n, block)."""
    n, size = x.shape
    rest = np.empty(size)
    for step in range(n):
        i = n - 1 - step if backwards else step
        for k in range(size):
            rest[k] = right[i, k]
        for entry in range(starts[i], starts[i + 1]):
            j = columns[entry]
            if j == i:
                continue
            for k in range(size):
                total = 0.0
                for m in range(size):
                    total += blocks[entry, k, m] * x[j, m]
                rest[k] -= total
        for k in range(size):
            total = 0.0
            for m in range(size):
                total += inverse[i, k, m] * rest[m]
            x[i, k] = total


def linear_interpolation(element_nodes: IntArray, n_nodes: int, dim: int) -> csr_matrix:
    """(n_nodes, vertices): quadratic nodes from the corners of their elements.

    element_nodes : (n_elements, 6 or 10), corners first, then middles in scikit-fem's order
    """
    pairs = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))[: 3 if dim == 2 else 6]
    vertices = np.unique(element_nodes[:, : dim + 1])
    number = np.full(n_nodes, -1)
    number[vertices] = np.arange(len(vertices))
    edges = np.concatenate([element_nodes[:, [dim + 1 + k, a, b]]
                            for k, (a, b) in enumerate(pairs)])
    _, first = np.unique(edges[:, 0], return_index=True)
    middle, a, b = edges[first].T
    rows = np.concatenate([vertices, middle, middle])
    columns = number[np.concatenate([vertices, a, b])]
    share = np.concatenate([np.ones(len(vertices)), np.full(2 * len(middle), 0.5)])
    return csr_matrix((share, (rows, columns)), shape=(n_nodes, len(vertices)))
