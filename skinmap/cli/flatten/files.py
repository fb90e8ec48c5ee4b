"""The files of `skinmap flatten`: pictures, meshes with texture coordinates, the report."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.cli.flatten.figures import comparison_figure, histogram_figure, part_figure
from skinmap.cli.flatten.report import Picture, write_flat_report
from skinmap.flat.drawing_comparison import DrawnChart
from skinmap.flat.face_metrics import METRICS, FaceMetric
from skinmap.flat.flat_map import FlatMap
from skinmap.io.flat_maps.surface_files import write_obj_with_uv, write_vtp_with_uv
from skinmap.io.output import staged_folder

REPORT = "report.html"


def write_all(
    result: Mapping[str, Any],
    maps: Mapping[str, FlatMap],
    others: Mapping[str, Mapping[str, FlatMap]],
    drawn: Mapping[str, Sequence[DrawnChart]],
    metric: FaceMetric,
    out: Path,
    advance: Callable[[str], None],
) -> list[str]:
    """Write everything into a folder, all of it or nothing; returns the names in it.

    Parameters
    ----------
    result : mapping
        What the command prints as JSON.
    maps : mapping of str to FlatMap
        By part.
    others : mapping of str to mapping of str to FlatMap
        By part, then by method: the maps to compare with.
    drawn : mapping of str to sequence of DrawnChart
        By part.
    metric : FaceMetric
        Colours.
    out : Path
    advance : callable
        Called with the name of each part before it is drawn.
    """
    names: list[str] = []
    pictures: dict[str, list[Picture]] = {}
    with staged_folder(out) as stage:
        for part, flat in maps.items():
            advance(part)
            stem = file_stem(part)
            part_figure(flat, metric, stage / f"{stem}.png")
            write_obj(flat, stage / f"{stem}.obj")
            write_vtp(flat, stage / f"{stem}.vtp")
            names += [f"{stem}.png", f"{stem}.obj", f"{stem}.vtp"]
            pictures[part] = [_picture(stage / f"{stem}.png", "flat map and body")]
            if others.get(part) or part in drawn:
                shown = [(str(result["method"]), flat), *others.get(part, {}).items()]
                path = stage / f"{stem}_compared.png"
                comparison_figure(shown, drawn.get(part, ()), metric, path)
                names.append(path.name)
                pictures[part].append(_picture(path, "the same charts compared"))
            histograms = stage / "histograms.png"
            histogram_figure(flat, histograms)
            pictures[part].append(_picture(histograms, "histograms"))
            histograms.unlink()
        write_flat_report(result, pictures, metric, stage / REPORT)
    return [*names, REPORT]


def file_stem(part: str) -> str:
    """A part's name as a file name."""
    return "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in part)


def write_obj(flat: FlatMap, path: Path) -> None:
    """OBJ of a part: taxels in their order, faces with the corners of the charts as vt."""
    start = np.cumsum([0, *(len(chart.taxels) for chart in flat.charts)])
    faces = [chart.taxels[chart.faces] for chart in flat.charts]
    corners = [chart.faces + at for chart, at in zip(flat.charts, start, strict=False)]
    uv = np.concatenate([chart.uv for chart in flat.charts])
    write_obj_with_uv(path, flat.mesh.vertices, np.concatenate(faces), uv, np.concatenate(corners))


def write_vtp(flat: FlatMap, path: Path) -> None:
    """VTP of a part: taxels in their order, the further copies of seam taxels after them."""
    order, start = [], 0
    for chart in flat.charts:
        order.append(np.column_stack([chart.taxels, np.arange(len(chart.taxels)) + start]))
        start += len(chart.taxels)
    pairs = np.concatenate(order)  # taxel, corner
    skin = flat.mesh.skin
    taxels, first = np.unique(pairs[:, 0], return_index=True)
    again = np.setdiff1d(np.arange(len(pairs)), first)
    row = np.empty(len(pairs), np.int64)
    row[first], row[again] = taxels, len(skin) + np.arange(len(again))
    # A taxel merged into another lies where that one lies on the map; NaN where no face is.
    uv = np.concatenate([flat.uv, np.concatenate([chart.uv for chart in flat.charts])[again]])
    taxel = np.concatenate([np.arange(len(skin)), pairs[again, 0]])
    offsets = np.cumsum([0, *(len(chart.taxels) for chart in flat.charts)])
    faces = [row[chart.faces + at] for chart, at in zip(flat.charts, offsets, strict=False)]
    uv[pairs[first, 0]] = np.concatenate([chart.uv for chart in flat.charts])[first]
    cells = {
        name: np.concatenate([metric.of(chart) for chart in flat.charts])
        for name, metric in METRICS.items()
    }
    patch = np.concatenate([np.full(len(c.faces), c.patch) for c in flat.charts])
    write_vtp_with_uv(
        path,
        skin.positions[taxel],
        np.concatenate(faces),
        {"uv": uv, "channel": skin.channels[taxel], "module": skin.modules[taxel]},
        {**cells, "patch": patch},
    )


def _picture(path: Path, what: str) -> Picture:
    return Picture(what, base64.b64encode(path.read_bytes()).decode())
