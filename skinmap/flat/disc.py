"""What all flattening methods of one disc share: operators, factors, the conformal start."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array, diags_array
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.topology import edges
from skinmap.geometry.triangles import cross_2d, signed_areas

OVERLAP = 1e-6  # of a map's area: more lies over itself than rounding where two sides touch


class Disc:
    """A disc to flatten; whatever is computed once serves every method that runs on it.

    Parameters
    ----------
    vertices : (n, 3) array of float
        [m]; every vertex belongs to a face.
    faces : (m, 3) array of int
    loop : (b,) array of int
        The boundary, in the direction of the faces.
    """

    def __init__(self, vertices: FloatArray, faces: IntArray, loop: IntArray) -> None:
        self.vertices, self.faces, self.loop = vertices, faces, loop

    @cached_property
    def inner(self) -> IntArray:
        """(k,) vertices that are not on the border."""
        return np.setdiff1d(np.arange(len(self.vertices)), self.loop)

    @cached_property
    def _corners(self) -> tuple[FloatArray, FloatArray]:
        """(m, 3) dot product and length of the cross product of the edges at each corner [m2]."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        sides = b - a, c - b, a - c
        dot = [-np.einsum("ij,ij->i", sides[k], sides[k - 1]) for k in range(3)]
        double = np.linalg.norm(np.cross(sides[0], sides[1]), axis=1)
        return np.column_stack(dot), double

    @cached_property
    def areas(self) -> FloatArray:
        """(m,) areas of the triangles [m2]."""
        return np.asarray(0.5 * self._corners[1])

    @property
    def smallest_altitudes(self) -> FloatArray:
        """(m,) twice the area over the longest side [m]."""
        dot, double = self._corners
        # The square of the side opposite a corner is the sum of the other two dot products.
        square = dot.sum(axis=1, keepdims=True) - dot
        longest = np.sqrt(np.maximum(square.max(axis=1), 0.0))
        return np.divide(double, longest, out=np.zeros_like(longest), where=longest > 0)

    @cached_property
    def angle_sums(self) -> FloatArray:
        """(n,) sum of the angles round each vertex [rad]."""
        dot, double = self._corners
        angle = np.arctan2(double[:, None], dot).ravel()
        sums = np.bincount(self.faces.ravel(), angle, minlength=len(self.vertices))
        return np.asarray(sums, np.float64)

    @cached_property
    def laplacian(self) -> csc_array:
        """(n, n) cotangent Laplacian, positive semidefinite (Pinkall and Polthier 1993)."""
        dot, double = self._corners
        weight = (0.5 * dot / double[:, None]).ravel()  # of the edge opposite each corner
        i, j = self.faces[:, [1, 2, 0]].ravel(), self.faces[:, [2, 0, 1]].ravel()
        n = len(self.vertices)
        diagonal = np.bincount(i, weight, minlength=n) + np.bincount(j, weight, minlength=n)
        every = np.arange(n)
        values = np.concatenate([-weight, -weight, diagonal])
        places = np.concatenate([i, j, every]), np.concatenate([j, i, every])
        return coo_array((values, places), shape=(n, n)).tocsc()

    @cached_property
    def gradient(self) -> csr_array:
        """(2 m, n) derivatives along x and y of each triangle's own plane, x along edge 0-1.

        Rows 2 f and 2 f + 1 belong to face f: `gradient @ uv` reshaped to (m, 2, 2) holds the
        transposed Jacobians.
        """
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        width = np.linalg.norm(b - a, axis=1)
        height = self._corners[1] / width
        foot = np.einsum("ij,ij->i", c - a, b - a) / width
        along = np.column_stack([-1.0 / width, 1.0 / width, np.zeros(len(width))])
        across = np.column_stack([(foot / width - 1.0), -foot / width, np.ones(len(width))])
        values = np.stack([along, across / height[:, None]], axis=1)
        columns = np.repeat(self.faces[:, None, :], 2, axis=1)
        rows = np.arange(0, values.size + 1, 3)
        shape = (2 * len(self.faces), len(self.vertices))
        return csr_array((values.ravel(), columns.ravel(), rows), shape=shape)

    @cached_property
    def divergence(self) -> csr_array:
        """(n, 2 m) transpose of `gradient`."""
        return self.gradient.T.tocsr()

    @cached_property
    def solve_free(self) -> Solve:
        """Solver of the Laplacian with a free border and vertex 0 kept in place."""
        solve = factorise(self.laplacian[1:, 1:])

        def solve_from_zero(right: FloatArray) -> FloatArray:
            return np.concatenate([np.zeros_like(right[:1]), solve(right[1:])])

        return solve_from_zero

    @cached_property
    def solve_inner(self) -> Solve | None:
        """Solver of the Laplacian with the border held; None where nothing is inside."""
        if not len(self.inner):
            return None
        return factorise(self.laplacian[:, self.inner][self.inner])

    @cached_property
    def scale(self) -> FloatArray:
        """(n,) logarithm of the conformal scale factor, 0 along the border, that flattens it."""
        scale = np.zeros(len(self.vertices))
        if self.solve_inner:
            scale[self.inner] = self.solve_inner(self.angle_sums[self.inner] - 2.0 * np.pi)
        return scale

    @cached_property
    def conformal(self) -> FloatArray:
        """(n, 2) the map of boundary first flattening [m]."""
        return boundary_first(self)

    def overlaps(self, uv: FloatArray) -> bool:
        """Whether a map (n, 2) that keeps the side of every triangle lies over itself.

        It does where its border winds twice round some place. Both sides of a seam may touch.
        """
        return not self.is_border_simple(uv) and _covered_twice(uv[self.loop]) > OVERLAP

    def is_border_simple(self, uv: FloatArray) -> bool:
        """Whether the border of a map (n, 2) neither touches nor crosses itself."""
        import shapely

        return bool(shapely.is_simple(shapely.linearrings(uv[self.loop])))

    def is_injective(self, uv: FloatArray) -> bool:
        """Whether a map (n, 2) is finite and keeps the side of every triangle: locally so."""
        if uv.shape != (len(self.vertices), 2) or not np.isfinite(uv).all():
            return False
        return bool((signed_areas(uv, self.faces) > 0.0).all())


def boundary_first(disc: Disc) -> FloatArray:
    """Flatten a disc with scale factor 1 along its border.

    Returns
    -------
    (n, 2) array of float
        Flat coordinates [m].
    """
    laplacian, loop, inner = disc.laplacian, disc.loop, disc.inner
    rows = laplacian[:, inner]
    coupling = rows[loop].T.tocsc()
    solve = disc.solve_inner
    # Cherrier: the curvature that leaves the inside appears along the border.
    turning = np.pi - disc.angle_sums[loop] + coupling.T @ disc.scale[inner]
    border = _closed_curve(disc.vertices[loop], turning)
    uv = np.zeros((len(disc.vertices), 2))
    uv[loop] = border
    if solve:
        uv[inner] = solve(-(coupling @ border))
    return uv


def _closed_curve(points: FloatArray, turning: FloatArray) -> FloatArray:
    """Plane curve (b, 2) with given exterior angles and nearly the lengths of a space loop."""
    length = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    # The angles sum to 2 pi but for rounding; spread what is missing.
    heading = np.cumsum(turning * (2.0 * np.pi / turning.sum()))
    heading -= heading[0]
    tangent = np.stack([np.cos(heading), np.sin(heading)])
    weighted = tangent * length  # N^-1 T^T of the paper, N = diag(1 / length)
    length = length - weighted.T @ np.linalg.solve(tangent @ weighted.T, tangent @ length)
    curve = np.cumsum(tangent * length, axis=1).T
    return np.vstack([np.zeros(2), curve[:-1]])


def _covered_twice(ring: FloatArray) -> float:
    """Share of the area inside a closed curve (b, 2) that it winds round more than once."""
    import shapely

    following = np.roll(ring, -1, axis=0)
    total = 0.5 * float(cross_2d(ring, following).sum())
    pieces = shapely.get_parts(shapely.polygonize([shapely.node(shapely.linearrings(ring))]))
    once = 0.0
    for piece in pieces:
        x, y = shapely.get_coordinates(shapely.point_on_surface(piece))[0]
        rises = (ring[:, 1] <= y) & (following[:, 1] > y)
        falls = (ring[:, 1] > y) & (following[:, 1] <= y)
        left = cross_2d(following - ring, np.array([x, y]) - ring)
        winds = np.count_nonzero(rises & (left > 0)) - np.count_nonzero(falls & (left < 0))
        once += piece.area if winds else 0.0
    return 1.0 - once / total if total > 0.0 else 1.0


# Sparse factorisations of Laplacians, by scipy's SuperLU in an order that suits meshes.

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


# Maps onto a circle: far from isometric, but free of flips whatever the surface.
#
# Floater, "One-to-one piecewise linear mappings over triangulations", Mathematics of Computation
# 72, 2003: with positive weights and a convex border no triangle flips.


def uniform_on_circle(disc: Disc) -> FloatArray:
    """(n, 2) every inner vertex in the middle of its neighbours (Tutte 1963) [m]."""
    return _extend(disc, uniform_laplacian(disc.faces, len(disc.vertices)))


def uniform_laplacian(faces: IntArray, n: int) -> csc_array:
    """(n, n) number of neighbours less the neighbours of each vertex."""
    pairs = edges(faces)
    half = coo_array((np.ones(len(pairs)), pairs.T), shape=(n, n)).tocsc()
    degree = np.bincount(pairs.ravel(), minlength=n).astype(np.float64)
    return (diags_array(degree) - half - half.T).tocsc()


def harmonic_on_circle(disc: Disc) -> FloatArray:
    """(n, 2) least Dirichlet energy; obtuse triangles can make it flip [m]."""
    return _extend(disc, disc.laplacian)


def _extend(disc: Disc, laplacian: csc_array) -> FloatArray:
    """Solve for the inner vertices, the border on a circle."""
    inner = disc.inner
    uv = np.zeros((len(disc.vertices), 2))
    uv[disc.loop] = _circle(disc)
    if len(inner):
        rows = laplacian[:, inner]
        border = rows[disc.loop].T @ uv[disc.loop]
        uv[inner] = factorise(rows[inner])(-border)
    return uv


def _circle(disc: Disc) -> FloatArray:
    """Border positions (b, 2) on a circle of the area of the disc, spaced by length."""
    border = disc.vertices[disc.loop]
    length = np.linalg.norm(np.roll(border, -1, axis=0) - border, axis=1)
    angle = 2.0 * np.pi * np.concatenate([[0.0], np.cumsum(length)[:-1]]) / length.sum()
    radius = np.sqrt(disc.areas.sum() / np.pi)
    return np.asarray(radius * np.column_stack([np.cos(angle), np.sin(angle)]))
