from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import spsolve

from skinmap.flat.disc import Disc, factorise
from skinmap.geometry.topology import boundary_loops


@pytest.fixture
def matrix(half_cylinder) -> csc_array:
    """A Laplacian with one vertex held."""
    vertices, faces = half_cylinder
    return Disc(vertices, faces, boundary_loops(faces)[0]).laplacian[1:, 1:]


@pytest.mark.parametrize("columns", [None, 2])
def test_it_solves(matrix, rng, columns):
    right = rng.normal(size=matrix.shape[0] if columns is None else (matrix.shape[0], columns))
    expected = spsolve(matrix, right)
    before = right.copy()
    # The condition of this Laplacian is below 1e4.
    assert_allclose(factorise(matrix)(right), expected, rtol=1e-9, atol=1e-11)
    assert (right == before).all()


def test_a_singular_matrix_is_named():
    with pytest.raises(ArithmeticError, match="the matrix of 3 unknowns is singular"):
        factorise(csc_array(np.diag([1.0, 0.0, 2.0])))


def test_numbering_of_a_subdivided_ball_costs_no_fill(sphere):
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=4)
    matrix = Disc(ball.vertices, np.asarray(ball.faces), np.array([0])).laplacian
    matrix = (matrix + diags_array(np.full(len(ball.vertices), 1e-3))).tocsc()
    right = np.ones(len(ball.vertices))
    # A Laplacian's rows sum to zero: what is left of the ones is the shift.
    assert_allclose(factorise(matrix)(right), 1e3, rtol=1e-6)
