"""The numbers of `skinmap flatten`: a row for each patch, method compared and drawing."""

from __future__ import annotations

from typing import Any

import numpy as np

from skinmap.flat.drawing_comparison import DrawnChart, compare_drawing
from skinmap.flat.face_metrics import FaceMetric, worst_faces
from skinmap.flat.flat_map import Chart, FlatMap
from skinmap.flat.geodesic import geodesic_stress
from skinmap.io.flat_maps.drawing import Drawing

MAX_GEODESIC = 200_000  # vertices: one way on a larger mesh takes a tenth of a second
WORST = 5  # triangles listed for each patch
MM = 1e3


def patch_row(part: str, flat: FlatMap, chart: Chart, metric: FaceMetric) -> dict[str, Any]:
    """The numbers of one chart, ready for JSON."""
    return {
        "part": part,
        "patch": chart.patch,
        "vertices": len(chart.taxels),
        "faces": len(chart.faces),
        "holes": chart.holes,
        "cut_mm": MM * chart.seam_length,
        "method": chart.method,
        "fallback": chart.fallback,
        "reason": chart.reason,
        **chart.distortion.summary(),
        **_stress(flat, chart),
        "seconds": chart.seconds,
        "worst": worst_rows(flat, chart, metric),
    }


def worst_rows(flat: FlatMap, chart: Chart, metric: FaceMetric) -> list[dict[str, Any]]:
    """Channels and value of the triangles furthest from the metric's ideal."""
    faces, values = worst_faces(chart, metric, WORST)
    channels = flat.mesh.skin.channels[chart.taxels[chart.faces[faces]]]
    return [
        {"channels": corners, "value": value}
        for corners, value in zip(channels.tolist(), values.tolist(), strict=True)
    ]


def method_row(part: str, chart: Chart) -> dict[str, Any]:
    """The numbers of one chart by a method to compare with."""
    return {
        "part": part,
        "patch": chart.patch,
        "with": chart.method,
        "fallback": chart.fallback,
        **chart.distortion.summary(),
        "seconds": chart.seconds,
    }


def drawn_charts(flat: FlatMap, drawing: Drawing) -> list[DrawnChart]:
    """The drawing laid over each chart of a part."""
    return [
        compare_drawing(
            chart,
            flat.mesh.vertices[chart.taxels],
            flat.mesh.skin.channels[chart.taxels],
            drawing.channels,
            drawing.xy,
        )
        for chart in flat.charts
    ]


def drawing_row(part: str, chart: Chart, drawn: DrawnChart) -> dict[str, Any]:
    """The numbers of one chart as it was drawn; null where too few of its taxels are."""
    numbers = None if drawn.distortion is None else drawn.distortion.summary()
    return {
        "part": part,
        "patch": chart.patch,
        "with": "drawing",
        "taxels": len(drawn.vertices),
        "missing": drawn.missing,
        "mirrored": drawn.mirrored,
        "scale": drawn.scale,
        "distance_mm": MM * drawn.distance,
        "flips": None if numbers is None else numbers["flips"],
        "edge_rms_percent": None if numbers is None else numbers["edge_rms_percent"],
        "area_sd": None if numbers is None else numbers["area_sd"],
    }


def _stress(flat: FlatMap, chart: Chart) -> dict[str, float | None]:
    if len(chart.taxels) > MAX_GEODESIC:
        return {"geodesic_stress": None, "geodesic_stress_error": None}
    vertices, rng = flat.mesh.vertices[chart.taxels], np.random.default_rng(0)
    found = geodesic_stress(vertices, chart.faces, chart.uv, rng=rng)
    return {"geodesic_stress": found.value, "geodesic_stress_error": found.error}
