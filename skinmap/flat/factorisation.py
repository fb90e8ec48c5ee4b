"""Sparse factorisations of Laplacians: one interface over the solvers that are installed.

scipy's SuperLU is always there; CHOLMOD (through cholespy or scikit-sparse) is used where it is
installed and the factor is used often enough. They agree to rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from skinmap.arrays import FloatArray

Solve = Callable[[FloatArray], FloatArray]
# Factorising with cholespy costs about 0.3 C more than with SuperLU, each solve of two columns
# 0.02 C less (100,000 vertices, `make bench-geometry`): it pays from here on.
MANY_SOLVES = 15


def factorise(matrix: csc_array, *, solves: int = 1, solver: str | None = None) -> Solve:
    """Factorise a symmetric positive definite matrix.

    Parameters
    ----------
    matrix : (n, n) sparse array
    solves : int
        About how many times the factor will be used; chooses the solver.
    solver : str, optional
        One of `solvers()`, to have that one.

    Returns
    -------
    function
        From right-hand sides (n,) or (n, k) to solutions of the same shape.

    Raises
    ------
    ArithmeticError
        The matrix is singular.
    """
    have = solvers()
    if solver is None:
        solver = _fastest(have, solves)
    return _FACTORISERS[solver](csc_array(matrix))


def solvers() -> tuple[str, ...]:
    """Names of the solvers installed here."""
    optional = {"cholespy": "cholespy", "scikit-sparse": "sksparse"}
    return ("scipy", *(name for name, module in optional.items() if find_spec(module)))


def _fastest(have: tuple[str, ...], solves: int) -> str:
    if "scikit-sparse" in have:
        return "scikit-sparse"
    return "cholespy" if "cholespy" in have and solves >= MANY_SOLVES else "scipy"


def _scipy(matrix: csc_array) -> Solve:
    # Without pivoting and with a symmetric order of elimination: half the time and two thirds
    # of the memory of the defaults, which are for matrices without symmetry.
    try:
        factor = splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:
        raise ArithmeticError(f"the matrix of {matrix.shape[0]} unknowns is singular") from error
    return lambda right: np.asarray(factor.solve(right))


def _cholespy(matrix: csc_array) -> Solve:
    import cholespy

    try:
        factor = cholespy.CholeskySolverD(
            matrix.shape[0],
            matrix.indptr.astype(np.int32),
            matrix.indices.astype(np.int32),
            matrix.data,
            cholespy.MatrixType.CSC,
        )
    except ValueError:  # rounding made a tiny pivot negative; LU goes on where Cholesky stops
        return _scipy(matrix)

    def solve(right: FloatArray) -> FloatArray:
        columns = np.array(right.reshape(len(right), -1), np.float64, order="C")
        solution = np.zeros_like(columns)
        factor.solve(columns, solution)
        return solution.reshape(right.shape)

    return solve


def _scikit_sparse(matrix: csc_array) -> Solve:
    from scipy.sparse import csc_matrix
    from sksparse.cholmod import cholesky  # the interface up to 0.4; later ones keep it

    factor = cholesky(csc_matrix(matrix))
    return lambda right: np.asarray(factor(right))


_FACTORISERS: dict[str, Callable[[csc_array], Solve]] = {
    "scipy": _scipy,
    "cholespy": _cholespy,
    "scikit-sparse": _scikit_sparse,
}
