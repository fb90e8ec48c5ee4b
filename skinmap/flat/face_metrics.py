"""The distortion of each triangle by name, and hand-drawn maps beside computed ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from skinmap.arrays import FloatArray, IntArray, freeze
from skinmap.errors import check_known
from skinmap.flat.distortion import Distortion, measure_distortion
from skinmap.flat.flat_map import Chart, FlatMap
from skinmap.geometry.topology import border_edges
from skinmap.geometry.triangles import cross_products, signed_areas


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
class DrawnChart:
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

    def __post_init__(self) -> None:
        freeze(self, vertices=self.vertices, faces=self.faces, uv=self.uv)


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
