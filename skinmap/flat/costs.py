"""The rows of flat maps: what each patch costs, by another method too, and as others drew it.

Geodesic stress compares straight lines of the flat map with shortest ways on the skin. The
distortion of each triangle goes by its name, and hand-drawn maps stand beside computed ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import stdtrit

from skinmap.arrays import BoolArray, FloatArray, Frozen, IntArray
from skinmap.errors import check_known
from skinmap.flat.distortion import Distortion, measure_distortion
from skinmap.flat.flat_map import Chart, FlatMap
from skinmap.flat.flat_rows import ComparedRow, PatchRow, WorstFace
from skinmap.geometry.topology import border_edges, boundary_loops, half_edges
from skinmap.geometry.triangles import cross_products, face_areas, pair_lengths, signed_areas
from skinmap.rows import shallow


@dataclass(frozen=True, slots=True)
class FaceMetric:
    """One number a triangle.

    Attributes
    ----------
    label : str
        As an axis of a plot calls it, unit in brackets.
    ideal : float
        Of a map without distortion.
    limit : float
        End of the colour scale for a good map; worse maps stretch it.
    signed : bool
        Whether values lie on both sides of the ideal.
    of : callable
        From a chart to the values (m,) of its faces.
    """

    label: str
    ideal: float
    limit: float
    signed: bool
    of: Callable[[Chart], FloatArray]

    def badness(self, values: FloatArray) -> FloatArray:
        """How far values are from the ideal; NaN counts as infinitely far."""
        return np.asarray(np.where(np.isnan(values), np.inf, np.abs(values - self.ideal)))


METRICS: Mapping[str, FaceMetric] = {
    "edge_strain": FaceMetric(
        "edge strain, rms of three [%]",
        0.0,
        4.0,
        False,
        lambda chart: 100.0 * chart.distortion.face_edge_strain(chart.faces),
    ),
    "area": FaceMetric(
        "change of area [%]", 0.0, 6.0, True, lambda chart: 100.0 * (chart.distortion.area - 1.0)
    ),
    "quasi_conformal": FaceMetric(
        "quasi-conformal error", 1.0, 1.05, False, lambda chart: chart.distortion.quasi_conformal
    ),
    "symmetric_dirichlet": FaceMetric(
        "symmetric Dirichlet energy",
        4.0,
        4.01,
        False,
        lambda chart: chart.distortion.symmetric_dirichlet,
    ),
    "stretch_l2": FaceMetric(
        "texture stretch L2", 1.0, 1.05, True, lambda chart: chart.distortion.stretch
    ),
    "arap_energy": FaceMetric("ARAP energy", 0.0, 2e-3, False, lambda chart: chart.distortion.arap),
}


def face_metric(name: str) -> FaceMetric:
    """A metric by name.

    Parameters
    ----------
    name : str
        A key of `METRICS`.

    Returns
    -------
    FaceMetric

    Raises
    ------
    UnknownNameError
        No such metric (lists those that exist).

    Examples
    --------
    >>> face_metric("area").signed
    True
    """
    check_known("metric", [name], METRICS)
    return METRICS[name]


def worst_faces(chart: Chart, metric: FaceMetric, most: int) -> tuple[IntArray, FloatArray]:
    """The faces (k,) furthest from the ideal, worst first, and their values (k,)."""
    values = metric.of(chart)
    order = np.argsort(-metric.badness(values), kind="stable")[:most]
    return order, values[order]


def seam_edges(chart: Chart) -> IntArray:
    """(s, 2) border edges of a chart that were one edge before it was cut open."""
    border = border_edges(chart.faces)
    ends = np.sort(chart.taxels[border], axis=1)
    _, number, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(border[count[number.ravel()] > 1])


@dataclass(frozen=True, eq=False, slots=True)
class DrawnChart(Frozen):
    """The hand-drawn part of a patch, laid over the computed chart.

    Attributes
    ----------
    vertices : (k,) int
        Chart vertices that are drawn and belong to a whole triangle of drawn ones.
    faces : (m, 3) int
        Over those.
    uv : (k, 2) float
        As drawn, moved, turned, scaled and where needed mirrored to lie over the chart [m].
    distortion : Distortion or None
        Of the drawing against the skin; None without a triangle.
    mirrored : bool
        Whether it is drawn as seen from inside the body.
    scale : float
        Factor from the drawing to the chart.
    distance : float
        Root mean square from the drawn to the computed place [m].
    missing : int
        Taxels of the chart that are not drawn.
    """

    vertices: IntArray
    faces: IntArray
    uv: FloatArray
    distortion: Distortion | None
    mirrored: bool
    scale: float
    distance: float
    missing: int


def compare_drawing(
    chart: Chart, vertices: FloatArray, channels: IntArray, drawn: IntArray, xy: FloatArray
) -> DrawnChart:
    """Lay a drawing over a chart and measure it as any other map of the same triangles.

    Parameters
    ----------
    chart : Chart
    vertices : (k, 3) array of float
        The chart's [m].
    channels : (k,) array of int
        Channel of each chart vertex.
    drawn : (n,) array of int
        Channels of the drawing, ascending.
    xy : (n, 2) array of float
        Where they are drawn [m].
    """
    row = np.minimum(np.searchsorted(drawn, channels), len(drawn) - 1)
    known = drawn[row] == channels
    missing = len(np.unique(chart.taxels[~known]))
    whole = chart.faces[known[chart.faces].all(axis=1)]
    used, compact = np.unique(whole, return_inverse=True)
    faces = compact.reshape(-1, 3)
    if len(faces) == 0:
        none = np.zeros(0, np.int64)
        return DrawnChart(none, faces, np.zeros((0, 2)), None, False, 1.0, float("nan"), missing)
    places = xy[row[used]]
    # A picture of the inside turns all triangles over: what most of the skin says counts.
    area = np.linalg.norm(cross_products(vertices[used], faces), axis=1)
    mirrored = bool(np.sign(signed_areas(places, faces)) @ area < 0)
    if mirrored:
        places = places * [-1.0, 1.0]
    laid, scale = align_similar(places, chart.uv[used])
    distance = float(np.sqrt(((laid - chart.uv[used]) ** 2).sum(axis=1).mean()))
    distortion = measure_distortion(vertices[used], faces, laid)
    return DrawnChart(used, faces, laid, distortion, mirrored, scale, distance, missing)


def drawn_charts(flat: FlatMap, drawn: IntArray, xy: FloatArray) -> list[DrawnChart]:
    """A drawing, channels (n,) at places (n, 2) [m], laid over each chart of a part."""
    skin, vertices = flat.mesh.skin, flat.mesh.vertices
    return [
        compare_drawing(chart, vertices[chart.taxels], skin.channels[chart.taxels], drawn, xy)
        for chart in flat.charts
    ]


def align_similar(points: FloatArray, onto: FloatArray) -> tuple[FloatArray, float]:
    """Points (n, 2) moved, turned and scaled onto others (n, 2) by least squares, and the scale.

    Umeyama, IEEE Transactions on Pattern Analysis and Machine Intelligence 13(4), 1991, in the
    plane: as complex numbers the best factor is a quotient of inner products.
    """
    a = points - points.mean(axis=0)
    b = onto - onto.mean(axis=0)
    from_, to = a[:, 0] + 1j * a[:, 1], b[:, 0] + 1j * b[:, 1]
    square = float(np.vdot(from_, from_).real)
    factor = np.vdot(from_, to) / square if square > 0 else 1.0 + 0.0j
    turned = factor * from_
    return np.column_stack([turned.real, turned.imag]) + onto.mean(axis=0), float(abs(factor))


EXACT_BELOW = 600  # vertices: on coarse noisy skins, locally shortest ways are up to 0.0015 off
# Least height of a triangle as a share of the map's size: over thinner ones exact search may not
# end, and both ways are wrong by 1 % and more; at five times as much they agree to seven digits.
THIN = 1e-6
SOURCES = 6  # exact distances from so many vertices; a patch of the iCub takes 3 to 70 ms
PAIRS = (64, 1024)  # fewest and most pairs of a larger mesh
SECONDS_A_VERTEX = 3.5e-7  # of one way between a pair, on meshes of 3,000 to 17,000 vertices
BUDGET = 1.5  # seconds for the ways of one map, by the figure above (never by the clock)
TRIES = 8  # drawn for each pair that is wanted, at most: on a narrow ring few lines are free
ON_BORDER = 1e-9  # of the map's size: a line along the border counts as inside
APART = 1e-6  # of the edges there: both sides of a seam without a gap are drawn apart so far
CONFIDENCE = 0.95
ROUNDING = 1e-7  # exact geodesics are sums of square roots: half of the digits are left


@dataclass(frozen=True, slots=True)
class Stress:
    """Geodesic stress of a flat map, from a sample of its pairs.

    Attributes
    ----------
    value : float
        0 for an isometry; NaN where no pair has a free line, or a triangle is a sliver.
    error : float
        Half of the 95 % confidence interval of `value`; 0 where all pairs were taken.
    pairs : int
        How many were measured.
    """

    value: float
    error: float
    pairs: int


def geodesic_stress(
    vertices: FloatArray,
    faces: IntArray,
    uv: FloatArray,
    *,
    rng: np.random.Generator,
    exact: bool = False,
) -> Stress:
    """Kruskal's stress-1 of plane distances against geodesics on the mesh.

    Only pairs whose straight segment stays inside the map count: round a notch the shortest way
    is longer than the line, on the most perfect map too. The size of the map does not count.

    Parameters
    ----------
    vertices : (n, 3) array of float
        [m].
    faces : (m, 3) array of int
        One component, cut open.
    uv : (n, 2) array of float
    rng : numpy.random.Generator
        Draws the sample.
    exact : bool
        Take all pairs, by exact geodesics: n squared and more; minutes above 1,000 vertices.

    Returns
    -------
    Stress

    Notes
    -----
    Up to 600 vertices distances are exact, from 6 vertices to all. On larger meshes single pairs
    are measured along locally shortest ways, by flips of edges: the same to 0.1 % on meshes as
    fine as that, in a thousandth of the time.

    References
    ----------
    Zigelman, Kimmel and Kiryati, "Texture mapping using surface flattening via multidimensional
    scaling", IEEE Transactions on Visualization and Computer Graphics 8(2), 2002. Geodesics:
    Mitchell, Mount and Papadimitriou, SIAM Journal on Computing 16(4), 1987, through libigl;
    Sharp and Crane, "You can find geodesic paths in triangle meshes by just flipping edges",
    ACM Transactions on Graphics 39(6), 2020, through potpourri3d.
    """
    # The exact search has tolerances of its own: at other sizes than about 1 it may not end.
    size = float(np.ptp(vertices, axis=0).max())
    vertices, uv = (vertices - vertices.mean(axis=0)) / size, (uv - uv.mean(axis=0)) / size
    longest = np.linalg.norm(vertices[faces] - vertices[np.roll(faces, 1, axis=1)], axis=2).max(1)
    if (2.0 * face_areas(vertices, faces) < THIN * longest).any():
        return Stress(float("nan"), float("nan"), 0)
    lines = _Lines(uv, faces)
    if exact or len(vertices) <= EXACT_BELOW:
        ways = _exact_ways(vertices, faces, lines, rng, len(vertices) if exact else SOURCES)
    else:
        ways = _single_ways(vertices, faces, lines, rng)
    area = np.abs(signed_areas(uv, faces)).sum()
    ways.straight *= np.sqrt(face_areas(vertices, faces).sum() / area)
    return ways.stress(all_pairs=exact)


class _Lines:
    """Straight segments of a flat map, and whether they stay inside it."""

    def __init__(self, uv: FloatArray, faces: IntArray) -> None:
        import shapely

        self.uv, self._places = uv, _slits_opened(uv, faces)
        rings = sorted(
            (self._places[loop] for loop in boundary_loops(faces)),
            key=lambda ring: -float(np.ptp(ring, axis=0).max()),
        )
        shape = shapely.make_valid(shapely.Polygon(rings[0], rings[1:]))
        self._shape = shapely.buffer(shape, ON_BORDER * float(np.ptp(uv, axis=0).max()))
        shapely.prepare(self._shape)

    def free(self, starts: IntArray, ends: IntArray) -> BoolArray:
        """(k,) whether the segments between vertices stay inside."""
        import shapely

        places = self._places
        segments = shapely.linestrings(np.stack([places[starts], places[ends]], axis=1))
        return np.asarray(shapely.covers(self._shape, segments), dtype=bool)


def _slits_opened(uv: FloatArray, faces: IntArray) -> FloatArray:
    """Places (n, 2) of vertices, those at one place drawn apart a little, each into its own side.

    Lines across a seam whose sides meet on the map would count as inside.
    """
    near = 2.0 * ON_BORDER * float(np.ptp(uv, axis=0).max())
    double = np.unique(cKDTree(uv).query_pairs(near, output_type="ndarray"))
    pairs, places = half_edges(faces), uv.copy()
    for a, b in (pairs.T, pairs.T[::-1]):
        moved = np.isin(a, double)
        np.add.at(places, a[moved], APART * (uv[b[moved]] - uv[a[moved]]))
    return places


@dataclass(slots=True)
class _Ways:
    """(k,) straight and geodesic lengths of pairs, and the group that each was drawn with."""

    straight: FloatArray
    around: FloatArray
    group: IntArray

    def stress(self, *, all_pairs: bool) -> Stress:
        """The ratio of sums of squares, its error by leaving out one group after the other."""
        if not len(self.around):
            return Stress(float("nan"), float("nan"), 0)
        gap = np.bincount(self.group, (self.straight - self.around) ** 2)
        length = np.bincount(self.group, self.around**2)
        used = length > 0
        gap, length = gap[used], length[used]
        value = float(np.sqrt(gap.sum() / length.sum()))
        if all_pairs or (n := len(gap)) < 2:
            return Stress(value, 0.0 if all_pairs else float("nan"), len(self.around))
        left_out = np.sqrt((gap.sum() - gap) / (length.sum() - length))
        spread = np.sqrt((n - 1) / n * ((left_out - left_out.mean()) ** 2).sum())
        error = float(stdtrit(n - 1, 0.5 + 0.5 * CONFIDENCE) * spread)
        return Stress(value, max(error, ROUNDING), len(self.around))


def _exact_ways(
    vertices: FloatArray, faces: IntArray, lines: _Lines, rng: np.random.Generator, sources: int
) -> _Ways:
    """From some vertices to all: each of them a group of pairs that are not independent."""
    import igl

    n = len(vertices)
    everyone, none = np.arange(n), np.zeros(0, np.int64)
    chosen = everyone if sources >= n else np.sort(rng.choice(n, sources, replace=False))
    around = np.stack(
        [igl.exact_geodesic(vertices, faces, np.array([k]), none, everyone, none) for k in chosen]
    )
    group, end = np.nonzero((around > 0) & np.isfinite(around))
    free = lines.free(chosen[group], end)
    group, end = group[free], end[free]
    straight = np.linalg.norm(lines.uv[chosen[group]] - lines.uv[end], axis=1)
    return _Ways(straight, around[group, end], group)


def _single_ways(
    vertices: FloatArray, faces: IntArray, lines: _Lines, rng: np.random.Generator
) -> _Ways:
    """Between pairs drawn at random: as many as the budget allows at this size."""
    import potpourri3d

    n = len(vertices)
    wanted = int(np.clip(BUDGET / (SECONDS_A_VERTEX * n), *PAIRS))
    pairs = np.zeros((0, 2), np.int64)
    for _ in range(TRIES):
        drawn = rng.integers(0, n, (wanted, 2))
        drawn = drawn[drawn[:, 0] != drawn[:, 1]]
        pairs = np.concatenate([pairs, drawn[lines.free(drawn[:, 0], drawn[:, 1])]])[:wanted]
        if len(pairs) == wanted:
            break
    solver: Any = potpourri3d.EdgeFlipGeodesicSolver(vertices, faces)
    around = np.array([_length(solver.find_geodesic_path(int(a), int(b))) for a, b in pairs])
    straight = pair_lengths(lines.uv, pairs)
    return _Ways(straight, around, np.arange(len(pairs)))


def _length(path: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


MAX_GEODESIC = 200_000  # vertices: one way on a larger mesh takes a tenth of a second
WORST = 5  # triangles listed for each patch
MM = 1e3


def patch_rows(part: str, flat: FlatMap, metric: FaceMetric) -> list[PatchRow]:
    """A row for each chart of a part."""
    return [_patch_row(part, flat, chart, metric) for chart in flat.charts]


def _patch_row(part: str, flat: FlatMap, chart: Chart, metric: FaceMetric) -> PatchRow:
    stress = None
    if len(chart.faces) and len(chart.taxels) <= MAX_GEODESIC:
        vertices, rng = flat.mesh.vertices[chart.taxels], np.random.default_rng(0)
        stress = geodesic_stress(vertices, chart.faces, chart.uv, rng=rng)
    faces, values = worst_faces(chart, metric, WORST)
    channels = flat.mesh.skin.channels[chart.taxels[chart.faces[faces]]]
    pairs = zip(channels.tolist(), values.tolist(), strict=True)
    seam = chart.divided
    return PatchRow(
        part=part,
        patch=chart.patch,
        vertices=len(chart.taxels),
        faces=len(chart.faces),
        holes=chart.holes,
        cut_mm=MM * chart.seam_length,
        period_mm=None if chart.period is None else MM * math.hypot(*chart.period),
        method=chart.method,
        fallback=chart.fallback,
        reason=chart.reason,
        geodesic_stress=None if stress is None else stress.value,
        geodesic_stress_error=None if stress is None else stress.error,
        seconds=chart.seconds,
        worst=[WorstFace(channels=corners, value=value) for corners, value in pairs],
        touches=None if seam is None else seam.touches,
        touches_divided=None if seam is None else seam.divided,
        touches_divided_shortest=None if seam is None else seam.divided_shortest,
        touches_saved_percent=100.0 * seam.gain if seam and math.isfinite(seam.gain) else None,
        **shallow(chart.distortion.summary()),
    )


def method_rows(part: str, method: str, flat: FlatMap) -> list[ComparedRow]:
    """A row for each chart of a part by another method."""
    return [
        ComparedRow(
            part=part,
            patch=chart.patch,
            with_=method,
            fallback=chart.fallback,
            seconds=chart.seconds,
            **shallow(chart.distortion.summary()),
        )
        for chart in flat.charts
    ]


def drawing_rows(
    part: str, name: str, flat: FlatMap, drawn: Sequence[DrawnChart]
) -> list[ComparedRow]:
    """A row for each patch of a part as a drawing has it."""
    return [
        ComparedRow(
            part=part,
            patch=chart.patch,
            with_=name,
            taxels=len(one.vertices),
            missing=one.missing,
            mirrored=one.mirrored,
            scale=one.scale,
            distance_mm=MM * one.distance,
            flips=None if one.distortion is None else one.distortion.flips,
            edge_rms_percent=None if one.distortion is None else 100.0 * one.distortion.edge_rms,
            area_sd=None if one.distortion is None else one.distortion.area_sd,
        )
        for chart, one in zip(flat.charts, drawn, strict=True)
    ]
