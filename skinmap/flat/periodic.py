"""Tubes laid flat without a cut: a map that repeats itself, as a printed roll does.

The tube is opened along a seam as for any other map, but both copies of a seam vertex move
together, one period apart: a function of the vertices and of the period, in which the seam is a
place like any other. The map begins between two straight borders, where positive weights keep
every triangle's side on a cylinder as they do on a disc, and descends on the symmetric Dirichlet
energy with free borders and a free period.

References
----------
Tutte, "How to draw a graph", 1963; Gortler, Gotsman and Thurston, "Discrete one-forms on meshes
and applications to 3D mesh parameterization", Computer Aided Geometric Design 23(2), 2006.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csr_array

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import FlatteningError
from skinmap.flat.dirichlet import at_best_size, symmetric_dirichlet_descent
from skinmap.flat.disc import Disc, Solve, factorise, uniform_laplacian
from skinmap.flat.methods import DiscMap
from skinmap.flat.seams import CutMesh, open_surface, split_along
from skinmap.geometry.topology import (
    boundary_loops,
    euler_number,
    half_edges,
    loop_length,
    loops_by_length,
    twins,
)
from skinmap.geometry.triangles import vertex_normals
from skinmap.surface.consensus_meshing import close_loop

METHOD = "periodic"


def tube_rims(vertices: FloatArray, faces: IntArray, hole_share: float) -> list[IntArray] | None:
    """The loops of a tube, its two rims first; None for what is no tube.

    Loops up to a share of the longest one's length are holes, which count as filled.
    """
    loops = loops_by_length(vertices, faces)
    if len(loops) < 2 or euler_number(faces) != 2 - len(loops):
        return None
    limit = hole_share * loop_length(vertices, loops[0])
    wide = sum(loop_length(vertices, loop) > limit for loop in loops)
    return loops if wide == 2 else None


def periodic_map(
    vertices: FloatArray,
    faces: IntArray,
    rims: list[IntArray],
    *,
    hole_share: float,
    where: str = "mesh",
) -> tuple[CutMesh, DiscMap]:
    """Lay a tube flat with nothing cut: a strip whose two sides are one place.

    Parameters
    ----------
    vertices : (n, 3) array of float
        [m]; every vertex belongs to a face.
    faces : (m, 3) array of int
    rims : list of (b,) array of int
        As `tube_rims` gives them.
    hole_share : float
        Holes up to this share of the longest rim are filled for the solve.
    where : str
        How messages call it.

    Returns
    -------
    cut : CutMesh
        The opened tube; vertices on its seam come twice.
    flat : DiscMap
        Of its vertices; the two copies of one are one period apart.

    Raises
    ------
    FlatteningError
        No map without a flip is found: a triangle without area.
    """
    centre, size = vertices.mean(axis=0), float(np.ptp(vertices, axis=0).max()) or 1.0
    points = (vertices - centre) / size
    seam = open_surface(points, faces, hole_share=hole_share)
    cuts = _doubled_edges(faces, seam.faces)
    normals = vertex_normals(vertices, faces)
    filled = np.concatenate([faces, *(close_loop(points, normals, loop) for loop in rims[2:])])
    opened, origin = split_along(filled, cuts)
    roll = _Roll(points, opened, origin, cuts, rims[:2])
    uv = roll.flat()
    if not roll.is_injective(uv) or not roll.keeps_clear(uv):
        raise FlatteningError(f"{where}: no periodic map is free of flips")
    used, compact = np.unique(opened[: len(faces)], return_inverse=True)
    cut = CutMesh(compact.reshape(-1, 3), origin[used], 0.0)
    return cut, DiscMap(uv[used] * size, METHOD, False, len(rims) - 2)


def _doubled_edges(faces: IntArray, opened: IntArray) -> IntArray:
    """(c, 2) edges of a surface that came apart when it was cut."""
    apart = half_edges(faces)[(twins(opened) < 0) & (twins(faces) >= 0)]
    return np.unique(np.sort(apart, axis=1), axis=0)


class _Roll(Disc):
    """An opened tube whose seam is held together, one period apart.

    Parameters
    ----------
    points : (n, 3) array of float
    opened : (m, 3) array of int
    origin : (k,) array of int
        Vertex of each vertex of the opened tube.
    cuts : (c, 2) array of int
        The edges of the seam.
    rims : list of (b,) array of int
    """

    def __init__(
        self,
        points: FloatArray,
        opened: IntArray,
        origin: IntArray,
        cuts: IntArray,
        rims: list[IntArray],
    ) -> None:
        super().__init__(points[origin], opened, boundary_loops(opened)[0])
        self._points, self._origin, self._rims = points, origin, rims
        self._beyond = self._second_side(cuts)

    def _second_side(self, cuts: IntArray) -> IntArray:
        """(k,) 1 for the copies of seam vertices on the far side, one period on, otherwise 0."""
        way = _ordered(cuts, self._rims[0])
        directed, n = half_edges(self._origin[self.faces]), len(self._points)
        # From the first rim, which runs to the right, the seam runs up: what lies on its left
        # ends the strip.
        left = np.isin(directed @ [n, 1], way @ [n, 1])
        beyond = np.zeros(len(self._origin), np.int64)
        beyond[half_edges(self.faces)[left].ravel()] = 1
        return beyond

    @cached_property
    def spread(self) -> csr_array:
        """(k, n + 1) from places of the tube's vertices and the period to the opened tube."""
        k, n = len(self._origin), len(self._points)
        every = np.arange(k)
        rows = np.concatenate([every, every])
        columns = np.concatenate([self._origin, np.full(k, n)])
        values = np.concatenate([np.ones(k), self._beyond])
        return csr_array(coo_array((values, (rows, columns)), shape=(k, n + 1)))

    @cached_property
    def solve_free(self) -> Solve:
        """Solver of the Laplacian among the maps that repeat themselves, vertex 0 held."""
        spread = self.spread
        joined = (spread.T @ self.laplacian @ spread).tocsc()
        solve = factorise(joined[1:, 1:])

        def solve_repeating(right: FloatArray) -> FloatArray:
            own = spread.T @ right
            return np.asarray(spread @ np.concatenate([np.zeros_like(own[:1]), solve(own[1:])]))

        return solve_repeating

    def flat(self) -> FloatArray:
        """(k, 2) the map, at unit size; with free borders, held where those would cross."""
        start = at_best_size(self, self._between_lines())
        uv = symmetric_dirichlet_descent(self, start)
        if self.keeps_clear(uv):
            return uv

        def barrier(uv: FloatArray) -> tuple[float, FloatArray]:
            return (0.0 if self.keeps_clear(uv) else float("inf")), np.zeros_like(uv)

        return symmetric_dirichlet_descent(self, start, barrier=barrier)

    def keeps_clear(self, uv: FloatArray) -> bool:
        """Whether the two rims, repeated, neither touch nor cross themselves or each other."""
        import shapely

        step = self._period(uv)
        rims = [
            self._unrolled(uv, rim, way) for rim, way in zip(self._rims, (step, -step), strict=True)
        ]
        lines = [shapely.linestrings(rim) for rim in rims]
        simple = all(bool(shapely.is_simple(line)) for line in lines)
        return simple and not bool(shapely.intersects(*lines))

    def _period(self, uv: FloatArray) -> FloatArray:
        far = int(np.argmax(self._beyond))
        near = int(np.flatnonzero((self._origin == self._origin[far]) & (self._beyond == 0))[0])
        return np.asarray(uv[far] - uv[near])

    def _unrolled(self, uv: FloatArray, rim: IntArray, way: FloatArray) -> FloatArray:
        """A rim from the seam on, three periods long, which it runs through by `way` each."""
        own = self._from_seam(rim)
        place = np.full((len(self._points), 2), np.nan)
        near = self._beyond == 0
        place[self._origin[near]] = uv[near]
        line = place[own]
        if rim is self._rims[1]:  # it runs back, from the far side
            line[0] -= way
        return np.concatenate([line + k * way for k in (-1, 0, 1)])

    def _from_seam(self, rim: IntArray) -> IntArray:
        on_seam = np.isin(rim, self._origin[self._beyond == 1])
        return np.roll(rim, -int(np.argmax(on_seam)))

    def _between_lines(self) -> FloatArray:
        """(k, 2) every vertex in the middle of its neighbours, the rims on straight lines."""
        n, k = len(self._points), len(self._origin)
        weights = self.spread.T @ uniform_laplacian(self.faces, k) @ self.spread
        width = float(np.mean([loop_length(self._points, rim) for rim in self._rims]))
        height = float(self.areas.sum()) / width
        known = np.full((n + 1, 2), np.nan)
        known[n] = width, 0.0
        for number, rim in enumerate(self._rims):
            known[self._from_seam(rim)] = self._on_line(rim, width, number * height)
        free = np.flatnonzero(np.isnan(known[:, 0]))
        fixed = np.flatnonzero(~np.isnan(known[:, 0]))
        if len(free):
            rows = csr_array(weights)[free]
            solve = factorise(rows[:, free].tocsc())
            known[free] = solve(-(rows[:, fixed] @ known[fixed]))
        return np.asarray(self.spread @ known)

    def _on_line(self, rim: IntArray, width: float, height: float) -> FloatArray:
        """(b, 2) places of a rim from the seam on, spaced by length."""
        own = self._from_seam(rim)
        line = self._points[own]
        length = np.linalg.norm(np.roll(line, -1, axis=0) - line, axis=1)
        share = np.concatenate([[0.0], np.cumsum(length)[:-1]]) / length.sum()
        # The first rim runs with its faces: to the right below them. The second runs back.
        across = share if height == 0.0 else np.where(share > 0.0, 1.0 - share, 0.0)
        return np.column_stack([width * across, np.full(len(own), height)])


def _ordered(cuts: IntArray, rim: IntArray) -> IntArray:
    """Edges (c, 2) of a path, each from its end at a rim on."""
    beside: dict[int, list[int]] = {}
    for a, b in cuts.tolist():
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    ends = [vertex for vertex, found in beside.items() if len(found) == 1]
    on_rim = set(rim.tolist())
    path = [next(vertex for vertex in ends if vertex in on_rim)]
    while len(path) <= len(cuts):
        path.append(next(one for one in beside[path[-1]] if one not in path[-2:]))
    return np.column_stack([path[:-1], path[1:]])
