"""Solvers of large systems: right, and gone when nothing needs them."""

import gc
import weakref

import numpy as np
import pytest
from scipy.sparse import csr_matrix, diags, eye

from lmctl.design import linear_solver
from lmctl.design.linear_solver import FieldSolver
from lmctl.errors import InputError

N = 400


@pytest.fixture(params=["factors", "multigrid"])
def solver(request, monkeypatch):
    """Of a chain of N springs, held at both ends."""
    limit = 10 * N if request.param == "factors" else 0
    monkeypatch.setattr(linear_solver, "DIRECT_UNKNOWNS", {2: limit})
    held = np.zeros((N, 1), dtype=bool)
    held[[0, -1]] = True
    springs = diags([-np.ones(N - 1), 2 * np.ones(N), -np.ones(N - 1)], [-1, 0, 1])
    return FieldSolver(csr_matrix(springs), held, 2, csr_matrix(eye(N)), np.ones((N, 1, 1)))


def test_a_chain_under_even_load_hangs_in_a_parabola(solver):
    x = np.arange(N)[:, None]
    assert np.allclose(solver.solve(np.ones((N, 1))), x * (N - 1 - x) / 2, rtol=1e-6)


def test_equations_that_do_not_converge_are_told(solver, monkeypatch):
    monkeypatch.setattr(linear_solver, "MAX_ITERATIONS", 0)
    if linear_solver.DIRECT_UNKNOWNS == {2: 0}:
        with pytest.raises(InputError, match="did not converge in 0 iterations") as refused:
            solver.solve(np.ones((N, 1)))
        assert "mesh_mm" in refused.value.hint


def test_its_memory_is_free_as_soon_as_it_is_dropped(solver):
    """One is made for each design: the blade took 4.2 GB while they waited to be collected."""
    solver.solve(np.ones((N, 1)))
    gc.disable()
    try:
        freed = weakref.ref(FieldSolver(
            solver._matrix, ~solver._free[:, None], 2, csr_matrix(eye(N)), np.ones((N, 1, 1))))
        assert freed() is None
    finally:
        gc.enable()
