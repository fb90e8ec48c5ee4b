"""Seams that know touches: of several cuts the one that divides fewest, where that holds.

Cuts are proposed by pricing the ways with how often their places are touched, for a closed skin
between several far ends too. Each is judged by counting, and whether touches have habits at all
by halves of them: a seam chosen on one half has to divide fewer of the other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations, product

import numpy as np
from scipy.sparse import coo_array, diags_array

from skinmap.arrays import FloatArray, IntArray
from skinmap.flat.seams import (
    UNTOUCHED,
    CutMesh,
    divided_touches,
    far_ends,
    open_surface,
    touch_counts,
)
from skinmap.geometry.topology import boundary_loops, edges

FLOORS = (UNTOUCHED, 0.3, 1.0)  # prices of a way through nothing: wide detours, moderate, small
FAR_ENDS = 6  # of a closed skin, between which slits are proposed
FAR = 0.7  # of the distance of the furthest two: slits between nearer ends distort more
EDGE_ERROR = 0.005  # that a seam may cost: half a percentage point of the edge error
GAIN = 0.1  # of the other half's divided touches that a seam must save to count as a gain
SURE = 1.64  # standard deviations of the counts that it must save, so that few do not mislead


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
    *,
    hole_share: float,
    avoid: IntArray | None = None,
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
    hole_share : float
        As for `open_surface`.
    avoid : (k,) array of int, optional
        Vertices that seams keep away from where there is another way.
    """
    plain = open_surface(vertices, faces, hole_share=hole_share, avoid=avoid)
    own = [touch for touch in touches if len(touch)]
    if len(plain.origin) == len(vertices) or not own:
        return plain, Divided(len(own), 0, 0, float("nan"))
    limit = edge_error(plain) + EDGE_ERROR

    @cache
    def is_faithful(cut: CutMesh) -> bool:
        return edge_error(cut) <= limit

    surface = _Surface(vertices, faces, hole_share, avoid, plain, is_faithful)
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
    hole_share: float
    avoid: IntArray | None
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
            cut = open_surface(
                self.vertices,
                self.faces,
                hole_share=self.hole_share,
                avoid=self.avoid,
                touched=often,
                untouched=floor,
                slit=slit,
            )
            if (key := cut.faces.tobytes()) not in seen:
                seen.add(key)
                yield cut

    def _far_pairs(self) -> list[tuple[int, int]]:
        ends = far_ends(self.vertices, self.faces, *range(FAR_ENDS))
        pairs = list(combinations(dict.fromkeys(ends), 2))[1:]  # the first two are the usual ones
        apart = {
            pair: float(np.linalg.norm(self.vertices[pair[0]] - self.vertices[pair[1]]))
            for pair in pairs
        }
        least = FAR * max(apart.values(), default=0.0)
        return [pair for pair in pairs if apart[pair] >= least]

    def _smoothed(self, counts: FloatArray) -> FloatArray:
        """Counts (n,) spread to the neighbours once: few touches say what others will do."""
        n = len(self.vertices)
        pairs = edges(self.faces)
        half = coo_array((np.ones(len(pairs)), pairs.T), shape=(n, n)).tocsr()
        beside = half + half.T + diags_array(np.ones(n))
        return np.asarray((beside @ counts) / (beside @ np.ones(n)))
