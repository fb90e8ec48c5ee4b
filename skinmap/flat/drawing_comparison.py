"""Hand-drawn maps beside computed ones: what each patch would have cost as it was drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinmap.arrays import FloatArray, IntArray, freeze
from skinmap.flat.distortion import Distortion, measure_distortion
from skinmap.flat.flat_map import Chart, FlatMap
from skinmap.geometry.triangles import cross_products, signed_areas


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
