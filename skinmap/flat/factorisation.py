"""Sparse factorisations of Laplacians, by scipy's SuperLU in an order that suits meshes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import csc_array, csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

from skinmap.arrays import FloatArray

Solve = Callable[[FloatArray], FloatArray]


def factorise(matrix: csc_array) -> Solve:
    """Factorise a symmetric positive definite matrix.

    Parameters
    ----------
    matrix : (n, n) sparse array

    Returns
    -------
    function
        From right-hand sides (n,) or (n, k) to solutions of the same shape.

    Raises
    ------
    ArithmeticError
        The matrix is singular.
    """
    matrix = csc_array(matrix)
    # SuperLU's minimum degree breaks ties by number: on a mesh numbered by subdivision that takes
    # minutes. Numbered along a sweep (Cuthill and McKee 1969) it is quick on every mesh, and on a
    # grid leaves a fifth fewer entries. Without pivoting and with a symmetric order, time and
    # memory are half of the defaults, which are for matrices without symmetry.
    order = reverse_cuthill_mckee(csr_array(matrix), symmetric_mode=True)
    try:
        factor = splu(
            matrix[:, order][order],
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:
        raise ArithmeticError(f"the matrix of {matrix.shape[0]} unknowns is singular") from error

    def solve(right: FloatArray) -> FloatArray:
        solution = np.empty_like(right)
        solution[order] = factor.solve(right[order])
        return solution

    return solve
