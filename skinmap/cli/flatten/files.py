"""The files of `skinmap flatten`: pictures, meshes with texture coordinates, the report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from skinmap.cli.flatten.figures import comparison_figure, histogram_figure, part_figure
from skinmap.cli.flatten.job import Flattened
from skinmap.cli.flatten.options import FIXED
from skinmap.cli.flatten.result import Spread
from skinmap.flat.face_metrics import METRICS, face_metric
from skinmap.flat.flat_map import FlatMap
from skinmap.io.flat_maps.surface_files import write_obj_with_uv, write_vtp_with_uv
from skinmap.io.robots.mesh_file import MESH_SUFFIXES
from skinmap.report.image import image, media
from skinmap.report.page import heading, note, page
from skinmap.report.result import given
from skinmap.report.table import Cell, Table


def write(found: Flattened, stage: Path, advance: Callable[[str], None]) -> Iterator[str]:
    """Write a picture and the meshes of each part into a folder; the names."""
    metric = face_metric(found.result.metric)
    stems = file_stems(tuple(found.maps))
    for part, flat in found.maps.items():
        advance(part)
        stem = stems[part]
        picture = part_figure(flat, metric, fixed=found.result.scale == FIXED)
        (stage / f"{stem}.png").write_bytes(picture)
        # The OBJ of a mesh file that is one must not take its place.
        mesh = f"{stem}_flat.obj" if Path(part).suffix == ".obj" else f"{stem}.obj"
        write_obj(flat, stage / mesh)
        write_vtp(flat, stage / f"{stem}.vtp")
        yield from (f"{stem}.png", mesh, f"{stem}.vtp")
        others, drawn = found.others.get(part, {}), found.drawn.get(part, {})
        if others or drawn:
            shown = [(found.result.method, flat), *others.items()]
            compared = comparison_figure(shown, drawn, metric, fixed=found.result.scale == FIXED)
            (stage / f"{stem}_compared.png").write_bytes(compared)
            yield f"{stem}_compared.png"


def report(found: Flattened, stage: Path) -> str:
    """The page, with the pictures that were written."""
    result, metric = found.result, face_metric(found.result.metric)
    stems = file_stems(tuple(found.maps))
    sections = [
        note(
            f"Coloured by: {metric.label}. Distortion at the scale that keeps the whole area; "
            "means are weighted by area, the edge error by length."
        ),
        _patch_table(found).html(),
    ]
    if result.compare:
        sections += [heading("Compared"), _compare_table(found).html()]
    for part, flat in found.maps.items():
        stem = stems[part]
        worst: list[list[Cell]] = [
            [row.patch, ", ".join(map(str, face.channels)), face.value]
            for row in result.patches
            if row.part == part
            for face in row.worst
        ]
        compared = stage / f"{stem}_compared.png"
        sections += [
            heading(part),
            media(stage / f"{stem}.png", f"{part}: flat map and body"),
            media(compared, f"{part}: the same charts compared") if compared.exists() else "",
            image(histogram_figure(flat), f"{part}: histograms"),
            Table(["patch", "channels", metric.label], worst, "Worst triangles").html(),
        ]
    return page(f"{result.robot}: flat maps", sections)


def _patch_table(found: Flattened) -> Table:
    columns = ["part", "patch", "vertices", "faces", "holes", "cut [mm]", "method", "flips"]
    columns += ["quasi-conformal", "largest", "area sd", "symmetric Dirichlet", "largest"]
    columns += ["stretch L2", "edge rms [%]", "geodesic stress", "±", "seconds"]
    rows: list[list[Cell]] = [
        [
            row.part, row.patch, row.vertices, row.faces, row.holes, row.cut_mm, row.method,
            row.flips, *_ends(row.quasi_conformal), row.area_sd, *_ends(row.symmetric_dirichlet),
            row.stretch_l2, row.edge_rms_percent, row.geodesic_stress, row.geodesic_stress_error,
            row.seconds,
        ]
        for row in found.result.patches
    ]  # fmt: skip
    return Table(columns, rows)


def _compare_table(found: Flattened) -> Table:
    columns = ["part", "patch", "with", "taxels drawn", "flips", "quasi-conformal", "largest"]
    columns += ["area sd", "symmetric Dirichlet", "largest", "edge rms [%]", "apart [mm]"]
    rows: list[list[Cell]] = [
        [
            row.part, row.patch, row.with_, given(row.taxels), row.flips,
            *_ends(given(row.quasi_conformal)), row.area_sd,
            *_ends(given(row.symmetric_dirichlet)), row.edge_rms_percent,
            given(row.distance_mm), given(row.seconds),
        ]
        for row in found.result.compare
    ]  # fmt: skip
    return Table([*columns, "seconds"], rows)


def _ends(spread: Spread | None) -> tuple[float | None, float | None]:
    return (None, None) if spread is None else (spread.mean, spread.max)


def file_stems(parts: Sequence[str]) -> dict[str, str]:
    """By part, its name as that of files: of a mesh file without its suffix where that will do."""
    short = {part: _stem(part, cut=True) for part in parts}
    names = list(short.values())
    return {
        part: name if names.count(name) == 1 else _stem(part, cut=False)
        for part, name in short.items()
    }


def _stem(part: str, *, cut: bool) -> str:
    name = part[: -len(Path(part).suffix)] if cut and Path(part).suffix in MESH_SUFFIXES else part
    return "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in name)


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
