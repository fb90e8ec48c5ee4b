"""What `skinmap flatten` does: surfaces, maps, other methods and drawings, and their numbers."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import IntArray
from skinmap.cli.flatten.rows import drawing_row, drawn_charts, method_row, patch_row
from skinmap.cli.flatten.tasks import FlatTask, flat_map, flatten_task
from skinmap.errors import InvalidArrayError, MissingFileError, SkinWarning, UnknownNameError
from skinmap.flat.drawing_comparison import DrawnChart
from skinmap.flat.face_metrics import FaceMetric
from skinmap.flat.flat_map import FlatMap
from skinmap.flat.mesh_charts import mesh_surface
from skinmap.flat.methods import flatteners
from skinmap.io.flat_maps.drawing import read_drawing
from skinmap.io.robots.urdf import read_mesh
from skinmap.parallel.run import run_tasks
from skinmap.parallel.workers import ONE, Workers
from skinmap.skin.robot import Robot
from skinmap.surface.surface_mesh import DEFAULT, MESHING, SurfaceMesh, build_surface

DRAWING = "drawing"
MAX_CHANNEL = 10_000_000


@dataclass(frozen=True, slots=True)
class FlatJob:
    """One run of the command.

    Attributes
    ----------
    name : str
        Robot or file as people call it.
    method, metric_name : str
    meshing : str or None
        None for a mesh file, which is a surface already.
    metric : FaceMetric
    others : tuple of str
        Methods to compare with.
    drawing : Path or None
        The drawing of all parts, instead of those that the manifest names.
    with_drawing : bool
    away : (k,) int
        Channels that seams keep away from.
    budgets : dict
        `max_seconds` and `max_edge_rms`, those that were given.
    seed : int
    iterations : int or None
        None takes the method's own number.
    precision : str
    surfaces : mapping of str to callable
        By part, what makes its surface mesh.
    drawings : mapping of str to Path
        By part, as the manifest has them.
    """

    name: str
    method: str
    metric_name: str
    metric: FaceMetric
    others: tuple[str, ...]
    drawing: Path | None
    with_drawing: bool
    away: IntArray
    budgets: Mapping[str, float]
    meshing: str | None
    seed: int
    iterations: int | None = None
    precision: str = "float64"
    surfaces: Mapping[str, Callable[[], SurfaceMesh]] = field(default_factory=dict)
    drawings: Mapping[str, Path] = field(default_factory=dict)

    def for_meshes(self, paths: Sequence[Path]) -> FlatJob:
        """The job on several mesh files; parts are named as their files, by path where two agree.

        Raises
        ------
        MissingFileError
            No such file.
        """
        names = [path.name for path in paths]
        surfaces: dict[str, Callable[[], SurfaceMesh]] = {}
        for path in paths:
            name = path.name if names.count(path.name) == 1 else str(path)
            (surfaces[name],) = self.for_mesh(path).surfaces.values()
        return replace(self, name=", ".join(surfaces), surfaces=surfaces, meshing=None)

    def for_mesh(self, path: Path) -> FlatJob:
        """The job on a mesh file.

        Raises
        ------
        MissingFileError
            No such file.
        """
        if not path.is_file():
            raise MissingFileError(path, "a mesh file")
        surface = {path.name: lambda: mesh_surface(*read_mesh(path, merge=False), name=path.name)}
        return replace(self, name=path.name, surfaces=surface, meshing=None)

    def for_robot(self, robot: Robot, parts: tuple[str, ...]) -> FlatJob:
        """The job on parts of a robot."""

        def maker(part: str) -> Callable[[], SurfaceMesh]:
            if self.meshing != "accurate":
                return lambda: build_surface(robot.skin(part), method=self.meshing or DEFAULT)
            link = robot.part(part).link
            return lambda: build_surface(robot.skin(part), method="accurate", body=robot.mesh(link))

        specs = {part: robot.part(part).drawing for part in parts}
        return replace(
            self,
            name=robot.name,
            surfaces={part: maker(part) for part in parts},
            drawings={part: path for part, path in specs.items() if path is not None},
        )


Outcome = tuple[
    dict[str, Any],
    dict[str, FlatMap],
    dict[str, dict[str, FlatMap]],
    dict[str, list[DrawnChart]],
]


def run_job(
    job: FlatJob, *, workers: Workers = ONE, progress: Callable[[str], None] | None = None
) -> Outcome:
    """The JSON object (without files), the maps, those of other methods, and the drawings."""
    drawings = _drawings(job)
    meshes = {part: surface() for part, surface in job.surfaces.items()}
    away = _taxels(job.away, meshes)
    how = {"iterations": job.iterations, "precision": job.precision, **job.budgets}
    tasks = [
        FlatTask(mesh, job.method, job.others, away[part], how) for part, mesh in meshes.items()
    ]
    found = run_tasks(flatten_task, tasks, workers=workers, progress=progress)
    made = {
        part: {name: flat_map(mesh, plain) for name, plain in own.items()}
        for (part, mesh), own in zip(meshes.items(), found, strict=True)
    }
    maps = {part: own.pop("") for part, own in made.items()}
    others = made
    drawn = {part: drawn_charts(maps[part], read_drawing(path)) for part, path in drawings.items()}
    rows = [
        patch_row(part, flat, chart, job.metric)
        for part, flat in maps.items()
        for chart in flat.charts
    ]
    result = {
        "robot": job.name,
        "method": job.method,
        "meshing": job.meshing,
        "iterations": job.iterations,
        "precision": job.precision,
        "metric": job.metric_name,
        "seed": job.seed,
        "patches": rows,
        "compare": _compare_rows(maps, others, drawn),
        "seconds": sum(row["seconds"] for row in rows),
    }
    return result, maps, others, drawn


def check_compare(words: str) -> tuple[tuple[str, ...], bool]:
    """The methods named in a list with commas, and whether a drawing is among them.

    Raises
    ------
    UnknownNameError
        No such method.
    """
    names = tuple(dict.fromkeys(word.strip() for word in words.split(",") if word.strip()))
    methods = tuple(name for name in names if name != DRAWING)
    for name in methods:
        flatteners.get(name)
    return methods, DRAWING in names


def check_budget(
    method: str, max_seconds: float | None, max_edge_rms: float | None
) -> dict[str, float]:
    """The budgets that were given: seconds, and the edge error as a share.

    Raises
    ------
    InvalidArrayError
        One that is not above zero, or with another method than `auto`.
    """
    given = {"max_seconds": max_seconds, "max_edge_rms": max_edge_rms}
    budgets = {name: value for name, value in given.items() if value is not None}
    for name, value in budgets.items():
        option = "--" + name.replace("_", "-")
        if not (0.0 < value < np.inf):
            raise InvalidArrayError(f"{option} must be above 0, got {value:g}")
        if method != "auto":
            raise InvalidArrayError(f"{option} needs --method auto, got {method!r}")
    if "max_edge_rms" in budgets:
        budgets["max_edge_rms"] /= 100.0
    return budgets


def check_meshing(name: str) -> None:
    """Refuse a meshing method that there is not.

    Raises
    ------
    UnknownNameError
    """
    if name not in MESHING:
        raise UnknownNameError("meshing method", name, MESHING)


def read_channels(words: tuple[str, ...]) -> IntArray:
    """Channels (k,) of lists such as `3,8,20-31`, each once.

    Raises
    ------
    InvalidArrayError
        Something that is no number and no range.
    """
    found: set[int] = set()
    for word in ",".join(words).split(","):
        if not word.strip():
            continue
        match = re.fullmatch(r"\s*(\d{1,8})(?:\s*-\s*(\d{1,8}))?\s*", word)
        low, high = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if not low <= high <= MAX_CHANNEL:
            raise InvalidArrayError(
                f"--seam-away wants channels as 3,8,20-31, got {word.strip()!r}"
            )
        found.update(range(low, high + 1))
    return np.array(sorted(found), np.int64)


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


def _drawings(job: FlatJob) -> dict[str, Path]:
    """The drawing of each part that has one.

    Raises
    ------
    MissingFileError
        A drawing was asked for and there is none.
    """
    if not job.with_drawing:
        return {}
    if job.drawing is not None:
        if not job.drawing.is_file():
            raise MissingFileError(job.drawing, "a drawing of iCubSkinGui (.ini)")
        return dict.fromkeys(job.surfaces, job.drawing)
    if not job.drawings:
        raise MissingFileError(
            "drawing",
            f"`drawing = ...` for a part in the manifest of {job.name}, or --drawing FILE",
        )
    without = [part for part in job.surfaces if part not in job.drawings]
    if without:
        warnings.warn(f"no drawing of {', '.join(without)}", SkinWarning, stacklevel=2)
    return dict(job.drawings)


def _compare_rows(
    maps: Mapping[str, FlatMap],
    others: Mapping[str, Mapping[str, FlatMap]],
    drawn: Mapping[str, list[DrawnChart]],
) -> list[dict[str, Any]]:
    rows = []
    for part, flat in maps.items():
        for name, other in others[part].items():
            rows += [{**method_row(part, chart), "with": name} for chart in other.charts]
        pairs = zip(flat.charts, drawn.get(part, ()), strict=False)
        rows += [drawing_row(part, chart, sketch) for chart, sketch in pairs]
    return rows
