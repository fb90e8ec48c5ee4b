"""The distortion of each triangle by name: what maps are coloured by and worst ones found with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import UnknownNameError
from skinmap.flat.flat_map import Chart
from skinmap.geometry.topology import half_edges


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
        No such metric (says which there are).

    Examples
    --------
    >>> face_metric("area").signed
    True
    """
    if name not in METRICS:
        raise UnknownNameError("metric", name, METRICS)
    return METRICS[name]


def worst_faces(chart: Chart, metric: FaceMetric, most: int) -> tuple[IntArray, FloatArray]:
    """The faces (k,) furthest from the ideal, worst first, and their values (k,)."""
    values = metric.of(chart)
    order = np.argsort(-metric.badness(values), kind="stable")[:most]
    return order, values[order]


def seam_edges(chart: Chart) -> IntArray:
    """(s, 2) border edges of a chart that were one edge before it was cut open."""
    directed = half_edges(chart.faces)
    n = int(chart.faces.max()) + 1
    border = directed[~np.isin(directed @ [n, 1], directed[:, ::-1] @ [n, 1])]
    ends = np.sort(chart.taxels[border], axis=1)
    _, number, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(border[count[number.ravel()] > 1])
