"""The rows of flat maps: what each patch costs, by another method too, and as others drew it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from skinmap.flat.face_metrics import DrawnChart, FaceMetric, worst_faces
from skinmap.flat.flat_map import Chart, FlatMap
from skinmap.flat.flat_rows import ComparedRow, PatchRow, WorstFace
from skinmap.flat.geodesic import geodesic_stress
from skinmap.rows import shallow

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
