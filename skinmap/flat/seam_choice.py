"""Which seams are cut: those that divide the fewest touches, and those that bound the distortion.

Of several cuts the one that divides fewest touches stays, where that holds. They are proposed by
pricing the ways with how often their places are touched, for a closed skin between several far ends
too. Each is judged by counting, and whether touches have habits at all by halves of them: a seam
chosen on one half has to divide fewer of the other.

A chart's distortion is brought below a bound by slits from its border to where it is worst. A
conformal map shrinks most at the tips of what bulges, so that the extremes of its scale factor are
where a slit takes off most curvature (Ben-Chen et al. 2008 put their cones there). Where the chart
has no such place left, the slit goes to the worst region of the map itself (Gu et al. 2002). Of the
two the better one stays. Slits keep the chart one disc.

References
----------
Ben-Chen, Gotsman and Bunin, "Conformal flattening by curvature prescription and metric scaling",
Computer Graphics Forum 27(2), 2008. Gu, Gortler and Hoppe, "Geometry images", SIGGRAPH 2002. Li,
Kaufman, Kim, Solomon and Sheffer, "OptCuts", ACM Transactions on Graphics 37(6), 2018: the bound.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations, product
from typing import Any

import numpy as np
from scipy.sparse import coo_array, diags_array

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.disc import Disc
from skinmap.flat.distortion import Distortion, measure_distortion
from skinmap.flat.methods import DiscMap
from skinmap.flat.seams import (
    UNTOUCHED,
    CutMesh,
    divided_touches,
    far_ends,
    open_surface,
    path_from_border,
    split_along,
    touch_counts,
)
from skinmap.geometry.topology import boundary_loops, edges, loops_by_length
from skinmap.geometry.triangles import pair_lengths

FLOORS = (UNTOUCHED, 0.3, 1.0)  # prices of a way through nothing: wide detours, moderate, small
FAR_ENDS = 6  # of a closed skin, between which slits are proposed
FAR = 0.7  # of the distance of the furthest two: slits between nearer ends distort more
EDGE_ERROR = 0.005  # that a seam may cost: half a percentage point of the edge error
GAIN = 0.1  # of the other half's divided touches that a seam must save to count as a gain
SURE = 1.64  # standard deviations of the counts that it must save, so that few do not mislead
MAX_ROUNDS = 40  # each flattens the chart twice; a chart that needs more is no skin
MAX_AT_ONCE = 8  # slits in one round, far from the bound
APART = 0.1  # of the surface's size: slits of one round end no closer to each other
AGAIN = 12  # times that the energy is spread to neighbours before its worst place is sought
PROGRESS = 1e-4  # of the excess energy: a round that gains less has stalled
STALLED = 3  # such rounds in a row end it: some curvature takes two slits


@dataclass(frozen=True, slots=True)
class Divided:
    """How many touches a seam divides, and whether knowing them helped.

    Attributes
    ----------
    touches : int
        That reach the patch.
    divided, divided_shortest : int
        Of them, by this cut and by the one that knows no touches.
    gain : float
        Share of the touches divided by the shortest cut that cuts chosen on one half of the
        touches save in the other half; below `GAIN` the shortest cut stays. NaN where the
        shortest divides none.
    """

    touches: int
    divided: int
    divided_shortest: int
    gain: float


def seam_of_touches(
    vertices: FloatArray,
    faces: IntArray,
    touches: Sequence[IntArray],
    edge_error: Callable[[CutMesh], float],
    **opening: Any,
) -> tuple[CutMesh, Divided]:
    """The cut that opens a connected surface and divides the fewest touches, and how many.

    Parameters
    ----------
    vertices : (n, 3) array of float
        [m]; every vertex belongs to a face.
    faces : (m, 3) array of int
    touches : sequence of (k,) array of int
        Vertices of each touch.
    edge_error : callable
        Edge error of the flat map of a cut surface, 0.01 for 1 %: no cut that costs more than
        half a percentage point beside the shortest is taken.
    opening
        Of the arguments of `open_surface`: `hole_share`, `bulge` and `avoid`.
    """
    plain = open_surface(vertices, faces, **opening)
    own = [touch for touch in touches if len(touch)]
    if len(plain.origin) == len(vertices) or not own:
        return plain, Divided(len(own), 0, 0, float("nan"))
    limit = edge_error(plain) + EDGE_ERROR

    @cache
    def is_faithful(cut: CutMesh) -> bool:
        return edge_error(cut) <= limit

    surface = _Surface(vertices, faces, opening, plain, is_faithful)
    before, after = surface.held_out(own)
    shortest = divided_touches(plain.faces, plain.origin, own)
    gain = 1.0 - after / before if before else float("nan")
    sure = before - after > SURE * np.sqrt(before + after)
    divided, cut = surface.best(own) if sure and gain >= GAIN else (shortest, plain)
    return cut, Divided(len(own), divided, shortest, gain)


@dataclass(frozen=True, eq=False, slots=True)
class _Surface:
    """What is to be cut, the cut that knows no touches, and whether another is as faithful."""

    vertices: FloatArray
    faces: IntArray
    opening: Mapping[str, Any]
    plain: CutMesh
    is_faithful: Callable[[CutMesh], bool]

    def best(self, touches: Sequence[IntArray]) -> tuple[int, CutMesh]:
        """The faithful cut that divides fewest touches, of those the shortest, and how many."""
        found = [
            (divided_touches(cut.faces, cut.origin, touches), cut)
            for cut in (self.plain, *self._proposed(touches))
        ]
        for divided, cut in sorted(found, key=lambda pair: (pair[0], pair[1].seam_length)):
            if cut is self.plain or self.is_faithful(cut):
                return divided, cut
        return found[0]

    def held_out(self, touches: Sequence[IntArray]) -> tuple[int, int]:
        """Touches of each half that the plain cut divides, and the cut chosen on the other."""
        before = after = 0
        for known, other in ((touches[::2], touches[1::2]), (touches[1::2], touches[::2])):
            _, cut = self.best(known)
            before += divided_touches(self.plain.faces, self.plain.origin, other)
            after += divided_touches(cut.faces, cut.origin, other)
        return before, after

    def _proposed(self, touches: Sequence[IntArray]) -> Iterator[CutMesh]:
        often = self._smoothed(touch_counts(touches, len(self.vertices)))
        slits: list[tuple[int, int] | None] = [None]
        if not boundary_loops(self.faces):
            slits += self._far_pairs()
        seen: set[bytes] = set()
        for floor, slit in product(FLOORS, slits):
            how = {**self.opening, "touched": often, "untouched": floor, "slit": slit}
            cut = open_surface(self.vertices, self.faces, **how)
            if (key := cut.faces.tobytes()) not in seen:
                seen.add(key)
                yield cut

    def _far_pairs(self) -> list[tuple[int, int]]:
        ends = far_ends(self.vertices, self.faces, *range(FAR_ENDS))
        pairs = list(combinations(dict.fromkeys(ends), 2))[1:]  # the first two are the usual ones
        apart = pair_lengths(self.vertices, np.array(pairs, np.int64).reshape(-1, 2))
        far = apart >= FAR * apart.max(initial=0.0)
        return [pair for pair, kept in zip(pairs, far, strict=True) if kept]

    def _smoothed(self, counts: FloatArray) -> FloatArray:
        """Counts (n,) spread to the neighbours once: few touches say what others will do."""
        n = len(self.vertices)
        pairs = edges(self.faces)
        half = coo_array((np.ones(len(pairs)), pairs.T), shape=(n, n)).tocsr()
        beside = half + half.T + diags_array(np.ones(n))
        return np.asarray((beside @ counts) / (beside @ np.ones(n)))


def add_seams(
    vertices: FloatArray,
    cut: CutMesh,
    lay_flat: Callable[[FloatArray, IntArray], DiscMap],
    bound: float,
    price: Callable[[IntArray], FloatArray],
) -> CutMesh:
    """Slit a chart until its mean symmetric Dirichlet energy is at most a bound.

    Parameters
    ----------
    vertices : (n, 3) array of float
        Of the uncut surface [m].
    cut : CutMesh
        A disc but for small holes.
    lay_flat : callable
        From vertices (k, 3) [m] and faces to a map.
    bound : float
        Above 4.
    price : callable
        From edges (e, 2) of the uncut surface to what cutting them costs.
    """

    def laid(cut: CutMesh) -> tuple[CutMesh, Distortion]:
        """A chart and what its map distorts, which may lie over itself: trials are not mended."""
        own = vertices[cut.origin]
        return cut, measure_distortion(own, cut.faces, lay_flat(own, cut.faces).uv)

    (cut, found), stalled = laid(cut), 0
    for _ in range(MAX_ROUNDS):
        energy = found.mean_energy
        if energy <= bound or stalled == STALLED:
            break
        count = int(np.clip((energy - 4.0) / (bound - 4.0) / 4.0, 1, MAX_AT_ONCE))
        slits = [_slit(vertices, cut, ends, price) for ends in _tips(vertices, cut, found, count)]
        tried = [laid(slit) for slit in slits if slit is not None]
        if not tried:
            break
        cut, found = min(tried, key=lambda one: one[1].mean_energy)
        gained = energy - found.mean_energy > PROGRESS * (energy - 4.0)
        stalled = 0 if gained else stalled + 1
    return cut


def _tips(vertices: FloatArray, cut: CutMesh, found: Distortion, count: int) -> list[list[int]]:
    """Chart vertices that slits may lead to: tips of curvature, and the worst place of the map."""
    own, faces = vertices[cut.origin], cut.faces
    size = float(np.ptp(own, axis=0).max())
    loops = loops_by_length(own, faces)
    inside = ~np.isin(np.arange(len(own)), np.concatenate(loops))
    if not inside.any():
        return []
    energy = _spread(faces, np.minimum(found.symmetric_dirichlet, 1e6) - 4.0, found.face_areas)
    scale = np.zeros(len(own))
    if len(loops) == 1:
        scale = np.abs(Disc(own / size, faces, loops[0]).scale)
    return [
        _peaks(own, np.where(inside, height, -1.0), count, APART * size)
        for height in (scale, energy)
        if height[inside].max() > 0.0
    ]


def _peaks(points: FloatArray, height: FloatArray, count: int, apart: float) -> list[int]:
    """The highest places, none near a higher one."""
    height = height.copy()
    found: list[int] = []
    while len(found) < count:
        top = int(np.argmax(height))
        if height[top] <= 0.0:
            break
        found.append(top)
        height[np.linalg.norm(points - points[top], axis=1) <= apart] = -1.0
    return found


def _spread(faces: IntArray, values: FloatArray, areas: FloatArray) -> FloatArray:
    """(n,) means of the values of faces over the neighbourhood of each vertex."""
    n = int(faces.max()) + 1
    rows = faces.ravel()
    columns = np.repeat(np.arange(len(faces)), 3)
    weights = np.repeat(areas, 3)
    at = coo_array((weights, (rows, columns)), shape=(n, len(faces))).tocsr()
    total = at @ np.ones(len(faces))
    means = values
    for _ in range(AGAIN):
        vertex = (at @ means) / total
        means = vertex[faces].mean(axis=1)
    return np.asarray(vertex)


def _slit(
    vertices: FloatArray, cut: CutMesh, ends: list[int], price: Callable[[IntArray], FloatArray]
) -> CutMesh | None:
    """The chart with slits from its border to some vertices."""
    own = vertices[cut.origin]
    ways = path_from_border(cut.faces, np.array(ends), lambda pairs: price(cut.origin[pairs]))
    if len(ways) == 0:
        return None
    opened, origin = split_along(cut.faces, ways)
    length = float(pair_lengths(own, ways).sum())
    return CutMesh(opened, cut.origin[origin], cut.seam_length + length)
