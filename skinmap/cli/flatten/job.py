"""What `skinmap flatten` does: surfaces, maps, other methods and drawings, and their numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import IntArray
from skinmap.cli.flatten.options import FlatOptions, drawings_of, drawn_charts
from skinmap.cli.flatten.result import ComparedRow, FlattenResult, PatchRow, Spread, WorstFace
from skinmap.cli.flatten.seam import seams_of
from skinmap.errors import InvalidArrayError, MissingFileError
from skinmap.flat.distortion import Distortion
from skinmap.flat.drawing_comparison import DrawnChart
from skinmap.flat.face_metrics import FaceMetric, face_metric, worst_faces
from skinmap.flat.flat_map import Chart, FlatMap, flatten
from skinmap.flat.geodesic import geodesic_stress
from skinmap.flat.mesh_charts import mesh_surface
from skinmap.flat.seam_choice import Divided
from skinmap.io.flat_maps.drawing import Drawing
from skinmap.io.flat_maps.tactile_maps import read_tactile_maps
from skinmap.io.robots.mesh_file import read_mesh
from skinmap.io.taxels.cyskin import read_cyskin, read_cyskin_taxels
from skinmap.io.text import check_file
from skinmap.parallel.run import run_tasks
from skinmap.parallel.workers import ONE, Workers
from skinmap.skin.robot import Robot
from skinmap.skin.skin import skin_from_table
from skinmap.surface.surface_mesh import DEFAULT, SurfaceMesh, build_surface

MAX_GEODESIC = 200_000  # vertices: one way on a larger mesh takes a tenth of a second
WORST = 5  # triangles listed for each patch
MM = 1e3


@dataclass(frozen=True, slots=True)
class Surfaces:
    """What is laid flat.

    Attributes
    ----------
    name : str
        Robot or files as people call them.
    makers : mapping of str to callable
        By part, what makes its surface mesh.
    meshing : str or None
        None for mesh files.
    drawings : mapping of str to Path
        By part, as the manifest has them.
    theirs : mapping of str to callable
        By part, what reads the flat maps that its files bring.
    """

    name: str
    makers: Mapping[str, Callable[[], SurfaceMesh]]
    meshing: str | None = None
    drawings: Mapping[str, Path] = field(default_factory=dict)
    theirs: Mapping[str, Callable[[], Mapping[str, Drawing]]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, slots=True)
class Flattened:
    """The numbers, and the maps that pictures and files are made from.

    Attributes
    ----------
    result : FlattenResult
    maps : mapping of str to FlatMap
        By part.
    others : mapping of str to mapping of str to FlatMap
        By part, then by method: the maps to compare with.
    drawn : mapping of str to mapping of str to sequence of DrawnChart
        By part, then by the name of the drawing.
    """

    result: FlattenResult
    maps: Mapping[str, FlatMap]
    others: Mapping[str, Mapping[str, FlatMap]]
    drawn: Mapping[str, Mapping[str, Sequence[DrawnChart]]]


def mesh_surfaces(paths: Sequence[Path], *, split_sheets: bool = False) -> Surfaces:
    """Several mesh files; parts are named as their files, by path where two agree.

    With `split_sheets` faces that meet three or more at an edge come apart there into sheets.

    Raises
    ------
    MissingFileError
        No such file.
    """
    names = [path.name for path in paths]

    def maker(path: Path) -> Callable[[], SurfaceMesh]:
        if not path.is_file():
            raise MissingFileError(path, "a mesh file")
        return lambda: mesh_surface(
            *read_mesh(path, merge=False), name=path.name, split_sheets=split_sheets
        )

    makers = {
        path.name if names.count(path.name) == 1 else str(path): maker(path) for path in paths
    }
    return Surfaces(", ".join(makers), makers)


def robot_surfaces(robot: Robot, parts: Sequence[str], meshing: str = DEFAULT) -> Surfaces:
    """Parts of a robot, meshed by a method."""

    def make(part: str) -> SurfaceMesh:
        body = robot.mesh_under(part) if meshing == "accurate" else None
        return build_surface(robot.skin(part), method=meshing, body=body)

    specs = {part: robot.part(part).drawing for part in parts}
    drawings = {part: path for part, path in specs.items() if path is not None}
    theirs = {
        part: partial(read_tactile_maps, files)
        for part in parts
        if (files := robot.part(part).maps)
    }
    makers = {part: partial(make, part) for part in parts}
    return Surfaces(robot.name, makers, meshing, drawings, theirs)


def file_surfaces(paths: Sequence[Path], meshing: str | None = None) -> Surfaces:
    """Skins of CySkin files: their own triangles, or ours by a meshing method."""

    def make(path: Path) -> SurfaceMesh:
        found = read_cyskin(path)
        table = read_cyskin_taxels(path)
        hint = found.normals if found.normals.any() else None
        skin = skin_from_table(table, None, path.stem, table.link, hint=hint)
        if meshing is not None:
            return build_surface(skin, method=meshing)
        return build_surface(skin, faces=found.faces)

    for path in paths:
        check_file(path, "a CySkin file")
    names = [path.stem for path in paths]
    keys = {path.stem if names.count(path.stem) == 1 else str(path): path for path in paths}
    return Surfaces(
        ", ".join(keys),
        {name: partial(make, path) for name, path in keys.items()},
        meshing,
        theirs={name: partial(read_tactile_maps, [path]) for name, path in keys.items()},
    )


def work(
    options: FlatOptions,
    surfaces: Surfaces,
    *,
    workers: Workers = ONE,
    progress: Callable[[str], None] | None = None,
) -> Flattened:
    """Lay everything flat and measure it."""
    drawings = drawings_of(options, surfaces)
    meshes = {part: make() for part, make in surfaces.makers.items()}
    away = _taxels(options.away, meshes)
    how = {
        "iterations": options.iterations,
        "precision": options.precision,
        "max_distortion": options.max_distortion,
        **options.budgets,
    }
    seams = seams_of(options.seam, meshes)
    tasks = [
        FlatTask(mesh, options.method, options.others, {"avoid": away[part], **seams[part]}, how)
        for part, mesh in meshes.items()
    ]
    found = run_tasks(flatten_task, tasks, workers=workers, progress=progress)
    made = {
        part: {name: flat_map(mesh, plain) for name, plain in own.items()}
        for (part, mesh), own in zip(meshes.items(), found, strict=True)
    }
    maps = {part: own.pop("") for part, own in made.items()}
    drawn = {
        part: {
            name: drawn_charts(maps[part], one)
            for name, one in read(len(meshes[part].skin)).items()
        }
        for part, read in drawings.items()
    }
    metric = face_metric(options.metric)
    rows = [
        _patch_row(part, flat, chart, metric, np.random.default_rng(options.seed))
        for part, flat in maps.items()
        for chart in flat.charts
    ]
    result = FlattenResult(
        robot=surfaces.name,
        method=options.method,
        meshing=surfaces.meshing,
        iterations=options.iterations,
        precision=options.precision,
        seam=options.seam.kind,
        metric=options.metric,
        scale=options.scale,
        seed=options.seed,
        patches=rows,
        compare=_compare_rows(maps, made, drawn),
        seconds=sum(row.seconds for row in rows),
    )
    return Flattened(result, maps, made, drawn)


def _taxels(channels: IntArray, meshes: Mapping[str, SurfaceMesh]) -> dict[str, IntArray]:
    """Rows of the named channels in each part."""
    known = [mesh.skin.channels for mesh in meshes.values()]
    lost = np.setdiff1d(channels, np.concatenate(known) if known else np.zeros(0, np.int64))
    if len(lost):
        few = ", ".join(map(str, lost[:5].tolist())) + (" ..." if len(lost) > 5 else "")
        raise InvalidArrayError(f"--seam-away: no channel {few} in {', '.join(meshes)}")
    return {
        part: np.flatnonzero(np.isin(mesh.skin.channels, channels)) for part, mesh in meshes.items()
    }


@dataclass(frozen=True, eq=False, slots=True)
class FlatTask:
    """One part: what a worker needs.

    Attributes
    ----------
    mesh : SurfaceMesh
    method : str
    others : tuple of str
        Methods to compare with.
    seam : mapping
        Keywords of `flatten` that say where seams are.
    how : mapping
        Others, for the first method: its budgets, iterations, precision and bound.
    """

    mesh: SurfaceMesh
    method: str
    others: tuple[str, ...]
    seam: Mapping[str, Any]
    how: Mapping[str, Any]


def flatten_task(task: FlatTask) -> dict[str, dict[str, Any]]:
    """The map by each method, the first one asked for, as plain arrays and numbers."""
    first = flatten(task.mesh, method=task.method, **task.seam, **task.how)
    rest = {name: flatten(task.mesh, method=name, **task.seam) for name in task.others}
    # The mesh is not sent back: who gave the task has it.
    return {
        "": _plain(first),
        **{name: _plain(flat) for name, flat in rest.items()},
    }


def flat_map(mesh: SurfaceMesh, plain: Mapping[str, Any]) -> FlatMap:
    """The flat map of a mesh from what a worker gave back."""
    charts = tuple(
        Chart(
            **{
                **chart,
                "distortion": Distortion(**chart["distortion"]),
                "divided": chart["divided"] and Divided(**chart["divided"]),
            }
        )
        for chart in plain["charts"]
    )
    return FlatMap(mesh, charts, plain["uv"])


def _plain(flat: FlatMap) -> dict[str, Any]:
    charts = [
        {
            **_own(chart),
            "distortion": _own(chart.distortion),
            "divided": chart.divided and _own(chart.divided),
        }
        for chart in flat.charts
    ]
    return {"charts": charts, "uv": flat.uv}


def _own(value: Chart | Distortion | Divided) -> dict[str, Any]:
    return {field.name: getattr(value, field.name) for field in fields(value)}


def _figures(distortion: Distortion) -> dict[str, Any]:
    """The fields of `Distorted`."""
    summary: dict[str, Any] = distortion.summary()
    return {k: Spread(**v) if isinstance(v, Mapping) else v for k, v in summary.items()}


def _patch_row(
    part: str, flat: FlatMap, chart: Chart, metric: FaceMetric, rng: np.random.Generator
) -> PatchRow:
    stress = error = None
    if len(chart.taxels) <= MAX_GEODESIC:
        vertices = flat.mesh.vertices[chart.taxels]
        found = geodesic_stress(vertices, chart.faces, chart.uv, rng=rng)
        stress, error = found.value, found.error
    return PatchRow(
        part=part,
        patch=chart.patch,
        vertices=len(chart.taxels),
        faces=len(chart.faces),
        holes=chart.holes,
        cut_mm=MM * chart.seam_length,
        period_mm=None if chart.period is None else MM * float(np.linalg.norm(chart.period)),
        **_touch_figures(chart),
        method=chart.method,
        fallback=chart.fallback,
        reason=chart.reason,
        **_figures(chart.distortion),
        geodesic_stress=stress,
        geodesic_stress_error=error,
        seconds=chart.seconds,
        worst=_worst(flat, chart, metric),
    )


def _touch_figures(chart: Chart) -> dict[str, Any]:
    """The fields of `PatchRow` on touches."""
    found = chart.divided
    if found is None:
        return {}
    gain = found.gain if np.isfinite(found.gain) else None
    return {
        "touches": found.touches,
        "touches_divided": found.divided,
        "touches_divided_shortest": found.divided_shortest,
        "touches_saved_percent": None if gain is None else 100.0 * gain,
    }


def _worst(flat: FlatMap, chart: Chart, metric: FaceMetric) -> list[WorstFace]:
    faces, values = worst_faces(chart, metric, WORST)
    channels = flat.mesh.skin.channels[chart.taxels[chart.faces[faces]]]
    pairs = zip(channels.tolist(), values.tolist(), strict=True)
    return [WorstFace(channels=corners, value=value) for corners, value in pairs]


def _compare_rows(
    maps: Mapping[str, FlatMap],
    others: Mapping[str, Mapping[str, FlatMap]],
    drawn: Mapping[str, Mapping[str, Sequence[DrawnChart]]],
) -> list[ComparedRow]:
    rows = []
    for part, flat in maps.items():
        for name, other in others[part].items():
            rows += [
                ComparedRow(
                    part=part,
                    patch=chart.patch,
                    with_=name,
                    fallback=chart.fallback,
                    seconds=chart.seconds,
                    **_figures(chart.distortion),
                )
                for chart in other.charts
            ]
        for name, sketches in drawn.get(part, {}).items():
            pairs = zip(flat.charts, sketches, strict=False)
            rows += [_drawing_row(part, name, chart, sketch) for chart, sketch in pairs]
    return rows


def _drawing_row(part: str, name: str, chart: Chart, drawn: DrawnChart) -> ComparedRow:
    costs = drawn.distortion
    return ComparedRow(
        part=part,
        patch=chart.patch,
        with_=name,
        taxels=len(drawn.vertices),
        missing=drawn.missing,
        mirrored=drawn.mirrored,
        scale=drawn.scale,
        distance_mm=MM * drawn.distance,
        flips=None if costs is None else costs.flips,
        edge_rms_percent=None if costs is None else 100.0 * costs.edge_rms,
        area_sd=None if costs is None else costs.area_sd,
    )
