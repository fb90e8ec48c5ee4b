"""Cutting surfaces open until they are discs: tubes along a seam, closed skins along a slit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from skinmap.arrays import BoolArray, FloatArray, Frozen, IntArray
from skinmap.errors import InvalidMeshError
from skinmap.flat.disc import Disc
from skinmap.geometry.proximity import symmetric_graph
from skinmap.geometry.topology import (
    boundary_loops,
    by_edge,
    components,
    edges,
    euler_number,
    face_components,
    half_edges,
    loop_length,
    loops_by_length,
)
from skinmap.geometry.triangles import pair_lengths

AWAY = 20.0  # times the length of edges that seams are to keep away from
UNTOUCHED = 0.05  # of the price of the mean of touches: a seam through nothing is still kept short
ROOTS = 6  # of a closed surface with handles: the loops from the best of so many vertices


@dataclass(frozen=True, eq=False, slots=True)
class CutMesh(Frozen):
    """A surface with its seams opened.

    Attributes
    ----------
    faces : (m, 3) int
        Over the new vertices, in the order of the faces that came.
    origin : (k,) int
        Old vertex of each new one; vertices on a seam come twice or more.
    seam_length : float
        [m].
    """

    faces: IntArray
    origin: IntArray
    seam_length: float


def open_surface(
    vertices: FloatArray,
    faces: IntArray,
    *,
    hole_share: float,
    bulge: float = np.inf,
    avoid: IntArray | None = None,
    touched: FloatArray | None = None,
    untouched: float = UNTOUCHED,
    slit: tuple[int, int] | None = None,
    along: IntArray | None = None,
) -> CutMesh:
    """Cut a connected surface until only its outer border and small holes are left.

    Parameters
    ----------
    vertices : (n, 3) array of float
        [m]; every vertex belongs to a face.
    faces : (m, 3) array of int
    hole_share : float
        Holes up to this share of the outer border's length are left for filling.
    bulge : float
        Of those, what has more curvature than this is a rim, too [rad]: `rims_and_holes`.
    avoid : (k,) array of int, optional
        Vertices that seams keep away from where there is another way.
    touched : (n,) array of float, optional
        How often each vertex is touched: seams then run where they divide few touches.
    untouched : float
        What a seam through nothing costs, of the price of the mean of touches.
    slit : (int, int), optional
        Where the slit of a closed surface begins and ends; far apart by default.
    along : (c, 2) array of int, optional
        Edges that are cut whatever they cost; what is no disc then is cut further.

    Returns
    -------
    CutMesh
        A disc but for small holes. Handles (a torus) are cut along their shortest loops.

    References
    ----------
    Erickson and Whittlesey, "Greedy optimal homotopy and homology generators", SODA 2005.
    """
    if along is not None and len(along):
        again = {"avoid": avoid, "touched": touched, "untouched": untouched, "bulge": bulge}
        return _open_further(vertices, faces, along, hole_share, again)
    price = SeamPrice(vertices, avoid, touched, untouched)
    rims, holes = rims_and_holes(vertices, faces, hole_share, bulge)
    if rims:
        cuts = _opening(price, faces, rims, holes)
    else:
        ends = slit or far_ends(vertices, faces, 0, 1)
        cuts = (
            _slit(price, faces, ends)
            if euler_number(faces) == 2
            else _handle_cuts(price, faces, None, [], np.zeros((0, 2), np.int64))
        )
    if len(cuts) == 0:
        return CutMesh(faces, np.arange(len(vertices)), 0.0)
    opened, origin = split_along(faces, cuts)
    if face_components(opened).any():  # a seam along a small hole cuts out what lies between
        cuts = _opening(price, faces, [*rims, *holes], [])
        opened, origin = split_along(faces, cuts)
    return CutMesh(opened, origin, float(price.lengths(cuts).sum()))


def rims_and_holes(
    vertices: FloatArray, faces: IntArray, hole_share: float, bulge: float = np.inf
) -> tuple[list[IntArray], list[IntArray]]:
    """The loops of a surface that seams lead to, the longest first, and those that are filled.

    A rim is longer than a share of the longest loop, or what fills it has more curvature than
    `bulge` [rad]: by the angles round it none where a hole is cut out of what lies flat, and
    2 pi (1 - sin a) at the narrow end of a cone of half angle a (Gauss-Bonnet).
    """
    loops = loops_by_length(vertices, faces)
    found: tuple[list[IntArray], list[IntArray]] = [], []
    limit = hole_share * loop_length(vertices, loops[0]) if loops else 0.0
    sums = Disc(vertices, faces, faces[0]).angle_sums
    for loop in loops:
        curved = abs(2.0 * np.pi + float((np.pi - sums[loop]).sum())) > bulge
        found[0 if curved or loop_length(vertices, loop) > limit else 1].append(loop)
    return found


def _open_further(
    vertices: FloatArray, faces: IntArray, along: IntArray, hole_share: float, how: dict[str, Any]
) -> CutMesh:
    """A surface cut along given edges, then as far as it takes to make it a disc.

    Raises
    ------
    InvalidMeshError
        The edges cut it into pieces.
    """
    opened, origin = split_along(faces, along)
    pieces = int(face_components(opened).max()) + 1
    if pieces > 1:
        raise InvalidMeshError(f"the seam cuts it into {pieces} pieces, it must stay one")
    if how["avoid"] is not None:
        how["avoid"] = np.flatnonzero(np.isin(origin, how["avoid"]))
    if how["touched"] is not None:
        how["touched"] = how["touched"][origin]
    rest = open_surface(vertices[origin], opened, hole_share=hole_share, **how)
    length = float(pair_lengths(vertices, along).sum()) + rest.seam_length
    return CutMesh(rest.faces, origin[rest.origin], length)


def far_ends(vertices: FloatArray, faces: IntArray, *which: int) -> tuple[int, ...]:
    """Vertices far from each other along the edges, each the furthest from those before it.

    The first is the furthest from vertex 0; `which` of them are given.
    """
    plain = SeamPrice(vertices).graph(faces)
    found = [int(np.argmax(dijkstra(plain, directed=False, indices=0)))]
    near = dijkstra(plain, directed=False, indices=found[0])
    while len(found) <= max(which):
        found.append(int(np.argmax(near)))
        near = np.minimum(near, dijkstra(plain, directed=False, indices=found[-1]))
    return tuple(found[k] for k in which)


def path_along(vertices: FloatArray, faces: IntArray, stops: IntArray) -> IntArray:
    """Edges (c, 2) of the shortest ways from each stop (s,) to the next one.

    Raises
    ------
    InvalidMeshError
        No way leads there.
    """
    plain = SeamPrice(vertices).graph(faces)
    found = [np.zeros((0, 2), np.int64)]
    for start, end in zip(stops[:-1].tolist(), stops[1:].tolist(), strict=True):
        _, before = dijkstra(plain, directed=False, indices=start, return_predecessors=True)
        way = _walk_back(end, before)
        if start != end and (len(way) == 0 or way[-1, 1] != start):
            raise InvalidMeshError(f"no way leads from vertex {start} to vertex {end}")
        found.append(way)
    return np.concatenate(found)


def split_along(
    faces: IntArray, cuts: IntArray, *, joined: IntArray | None = None
) -> tuple[IntArray, IntArray]:
    """Faces (m, 3) with the edges (c, 2) opened, and the old vertex (k,) of each new one.

    Corners of one vertex stay together where an uncut edge joins their faces, or where these
    pairs (j, 2) of half-edges do.
    """
    order, same = by_edge(faces)
    n = int(faces.max()) + 1
    cut = np.isin(np.sort(half_edges(faces)) @ [n, 1], np.sort(cuts, axis=1) @ [n, 1])
    first, second = order[:-1], order[1:]
    whole = same & ~cut[first]
    first, second = first[whole], second[whole]
    if joined is not None:
        first = np.concatenate([first, joined[:, 0]])
        second = np.concatenate([second, joined[:, 1]])
    # Half-edge 3 f + i runs from corner i to corner i + 1 of face f; its twin runs back, or along
    # where a face is turned over.
    start = np.arange(faces.size)
    end = start - start % 3 + (start + 1) % 3
    pairs = np.concatenate(
        [
            np.column_stack([one[first], other[second]])
            for one in (start, end)
            for other in (start, end)
        ]
    )
    same = faces.ravel()[pairs[:, 0]] == faces.ravel()[pairs[:, 1]]
    pairs = pairs[same]
    label = components(pairs[:, 0], pairs[:, 1], faces.size)
    _, corner, opened = np.unique(label, return_index=True, return_inverse=True)
    return opened.reshape(-1, 3), faces.ravel()[corner]


def path_from_border(
    faces: IntArray, ends: IntArray, price: Callable[[IntArray], FloatArray]
) -> IntArray:
    """Edges (c, 2), each once, of the cheapest ways from the border to some vertices (k,).

    They form trees rooted on the outer border: cutting them leaves the surface in one piece.
    """
    pairs, n = edges(faces), int(faces.max()) + 1
    border, *holes = sorted(boundary_loops(faces), key=len, reverse=True)
    away, cost = np.isin(pairs, border).all(axis=1), price(pairs)
    for hole in holes:  # a way from a hole would widen it
        away |= np.isin(pairs, hole).any(axis=1)
    cost = np.where(away, cost.sum(), cost)
    graph = symmetric_graph(n, pairs, cost)
    _, before = _ways_from(graph, border)
    ways = [_walk_back(end, before) for end in ends.tolist()]
    return _once(ways)


@dataclass(frozen=True, eq=False, slots=True)
class SeamPrice:
    """What seams cost: their length, times twenty near some vertices, or times the touches there.

    The number of touches that a seam divides is the integral of their density along it.
    """

    vertices: FloatArray
    avoid: IntArray | None = None
    touched: FloatArray | None = None
    untouched: float = UNTOUCHED

    def lengths(self, pairs: IntArray) -> FloatArray:
        """(e,) lengths of edges [m]."""
        return pair_lengths(self.vertices, pairs)

    def of(self, pairs: IntArray) -> FloatArray:
        """(e,) what cutting edges costs."""
        return self.lengths(pairs) * self.factors(pairs)

    def factors(self, pairs: IntArray) -> FloatArray:
        """(e,) what the length of each edge is multiplied with."""
        factor = np.ones(len(pairs))
        if self.avoid is not None:
            factor[np.isin(pairs, self.avoid).any(axis=1)] = AWAY
        if self.touched is not None and (mean := float(self.touched.mean())) > 0.0:
            factor *= self.untouched + self.touched[pairs].mean(axis=1) / mean
        return factor

    def graph(self, faces: IntArray) -> csr_array:
        """(n, n) costs of the edges of some faces."""
        pairs = edges(faces)
        return symmetric_graph(len(self.vertices), pairs, self.of(pairs))


def _opening(
    price: SeamPrice, faces: IntArray, wide: Sequence[IntArray], small: list[IntArray]
) -> IntArray:
    """Edges (c, 2) of seams that join wide loops and open handles; small loops stay holes."""
    cuts = _seams(price, faces, wide)
    if euler_number(faces) == 2 - len(wide) - len(small):
        return cuts
    border = np.unique(np.concatenate([*wide, cuts.ravel()]))
    return np.concatenate([cuts, _handle_cuts(price, faces, border, small, cuts)])


def _seams(price: SeamPrice, faces: IntArray, loops: Sequence[IntArray]) -> IntArray:
    """Edges (c, 2) of the cheapest paths that join all loops.

    The nearest loop comes next: no way to it touches another one, which would cut out a piece.
    """
    graph, left = price.graph(faces), list(loops[1:])
    reached, cuts = loops[0], [np.zeros((0, 2), np.int64)]
    while left:
        cost, before = _ways_from(graph, np.unique(reached))
        nearest = min(range(len(left)), key=lambda k: float(cost[left[k]].min()))
        loop = left.pop(nearest)
        cuts.append(_walk_back(int(loop[np.argmin(cost[loop])]), before))
        reached = np.concatenate([reached, loop, cuts[-1].ravel()])
    return np.concatenate(cuts)


def _slit(price: SeamPrice, faces: IntArray, ends: tuple[int, ...]) -> IntArray:
    """Edges of a slit half round a closed surface, where it crosses fewest vertices."""
    pairs, n = edges(faces), len(price.vertices)
    length = price.lengths(pairs)
    cost = (np.ones(len(pairs)) + length / length.max()) * price.factors(pairs)
    graph = symmetric_graph(n, pairs, cost)
    _, before = dijkstra(graph, directed=False, indices=ends[0], return_predecessors=True)
    return _walk_back(ends[1], before)


def _handle_cuts(
    price: SeamPrice,
    faces: IntArray,
    border: IntArray | None,
    holes: list[IntArray],
    cuts: IntArray,
) -> IntArray:
    """Edges (c, 2) that open every handle: two loops for each, the shortest from the border.

    A tree of shortest ways from the border (of a closed surface, from one vertex) and a tree
    through the faces that crosses none of it leave two edges for each handle; each of them
    closes a loop with its ways back to the root. Holes count as filled.
    """
    n = len(price.vertices)
    fans = [
        np.column_stack([np.roll(loop, -1), loop, np.full(len(loop), n + number)])
        for number, loop in enumerate(holes)
    ]
    filled = np.concatenate([faces, *fans])
    pairs = edges(filled)
    inside = pairs[:, 1] < n
    cost = np.zeros(len(pairs))
    cost[inside] = price.of(pairs[inside])
    cost[~inside] = cost.sum()  # no way leads across a hole
    graph = symmetric_graph(n + len(holes), pairs, cost)
    tried = (
        [border] if border is not None else np.linspace(0, n - 1, ROOTS, dtype=np.int64)[:, None]
    )

    def loops(roots: IntArray) -> IntArray:
        """Edges (c, 2) of the loops from the roots that open every handle."""
        far, before = _ways_from(graph, roots)
        joined = _left_over(filled, pairs, far[pairs].sum(axis=1) + cost, before, cuts)
        steps = [
            np.concatenate([pair[None], *(_walk_back(int(end), before) for end in pair)])
            for pair in pairs[joined]
        ]
        return _once(steps)

    return min(map(loops, tried), key=lambda cut: float(price.lengths(cut).sum()))


def _left_over(
    faces: IntArray, pairs: IntArray, loop: FloatArray, before: IntArray, cuts: IntArray
) -> IntArray:
    """Edges in neither tree, where the tree of faces crosses what would make the longest loops."""
    n = len(before)
    key = pairs @ [n, 1]
    ways = np.flatnonzero(before >= 0)
    walked = np.sort(np.column_stack([ways, before[ways]]), axis=1) @ [n, 1]
    free = ~np.isin(key, [*walked, *(np.sort(cuts, axis=1) @ [n, 1])])
    directed = half_edges(faces)
    of_edge = np.searchsorted(key, np.sort(directed, axis=1) @ [n, 1])
    order = np.argsort(of_edge, kind="stable")
    number, first, count = np.unique(of_edge[order], return_index=True, return_counts=True)
    crossed = number[(count == 2) & free[number]]
    first = first[np.searchsorted(number, crossed)]
    sides = np.column_stack([order[first] // 3, order[first + 1] // 3])
    tree = _spanning(len(faces), sides, loop[crossed])
    return crossed[~tree]


def _spanning(n: int, sides: IntArray, weight: FloatArray) -> BoolArray:
    """(e,) edges of the heaviest tree over n nodes, two nodes joined more than once or not."""
    from scipy.sparse.csgraph import minimum_spanning_tree

    # Ranks are distinct, so that the tree names its edges; of parallel ones the first stays.
    rank = 1 + np.argsort(np.argsort(-weight, kind="stable"))
    low, high = sides.min(axis=1), sides.max(axis=1)
    order = np.lexsort((rank, high, low))
    repeated = np.zeros(len(order), bool)
    repeated[1:] = (low[order[1:]] == low[order[:-1]]) & (high[order[1:]] == high[order[:-1]])
    single = order[~repeated]
    graph = csr_array((rank[single].astype(float), (low[single], high[single])), shape=(n, n))
    return np.isin(rank, minimum_spanning_tree(graph).data.astype(np.int64))


def _ways_from(graph: csr_array, roots: IntArray) -> tuple[FloatArray, IntArray]:
    """(n,) cost of the cheapest way from any root, and the node before on it."""
    cost, before, _ = dijkstra(
        graph, directed=False, indices=roots, min_only=True, return_predecessors=True
    )
    return cost, before


def _once(ways: Sequence[IntArray]) -> IntArray:
    """Edges (c, 2) of several ways, each once."""
    return np.unique(np.sort(np.concatenate([np.zeros((0, 2), np.int64), *ways])), axis=0)


def _walk_back(end: int, before: IntArray) -> IntArray:
    path = [end]
    while before[path[-1]] >= 0:
        path.append(int(before[path[-1]]))
    return np.column_stack([path[:-1], path[1:]]).astype(np.int64)  # of no step, too


def touch_counts(touches: Sequence[IntArray], n: int) -> FloatArray:
    """How many touches cover each taxel.

    Parameters
    ----------
    touches : sequence of (k,) array of int
        Taxels of each touch, each once.
    n : int
        Taxels of the skin.

    Returns
    -------
    (n,) array of float
    """
    every = np.concatenate([np.zeros(0, np.int64), *(np.unique(touch) for touch in touches)])
    return np.bincount(every, minlength=n).astype(np.float64)


def divided_touches(faces: IntArray, origin: IntArray, touches: Sequence[IntArray]) -> int:
    """How many touches a chart shows in two places or more.

    A piece counts where it has a taxel that is not itself on a seam: the rim of a touch that a
    seam runs along is drawn twice, and divides nothing.

    Parameters
    ----------
    faces : (m, 3) array of int
        Chart vertices.
    origin : (k,) array of int
        Taxel of each chart vertex.
    touches : sequence of (j,) array of int
        Taxels of each touch.
    """
    if len(touches) == 0:
        return 0
    taxels = [np.unique(np.asarray(touch, np.int64)) for touch in touches]
    of_touch = np.repeat(np.arange(len(taxels)), [len(touch) for touch in taxels])
    n = int(origin.max(initial=-1)) + 1
    column = np.concatenate(taxels)
    known = column < n
    shape = (n, len(taxels))
    marks = csr_array((np.ones(known.sum()), (column[known], of_touch[known])), shape=shape)
    # A node for each chart vertex of each touch, joined where an edge has both of its ends.
    nodes = marks[origin].tocoo()
    number = csr_array((np.arange(1, nodes.nnz + 1), nodes.coords), shape=nodes.shape)
    pairs = edges(faces)
    ends = [number[pairs[:, side]] for side in (0, 1)]
    both = ends[0].astype(bool).multiply(ends[1].astype(bool))
    joined = [csr_array(end.multiply(both)).sorted_indices().data - 1 for end in ends]
    piece = components(joined[0], joined[1], nodes.nnz)
    vertex, touch = nodes.coords
    counts = np.bincount(origin)[origin[vertex]] == 1
    seen = np.unique(np.column_stack([touch, piece])[counts], axis=0)
    return int((np.bincount(seen[:, 0], minlength=1) > 1).sum())
