"""Flat maps as tasks for other processes: what a worker gets, and what it gives back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from skinmap.arrays import IntArray
from skinmap.flat.distortion import Distortion
from skinmap.flat.flat_map import Chart, FlatMap, flatten
from skinmap.surface.surface_mesh import SurfaceMesh


@dataclass(frozen=True, eq=False, slots=True)
class FlatTask:
    """One part: what a worker needs.

    Attributes
    ----------
    mesh : SurfaceMesh
    method : str
    others : tuple of str
        Methods to compare with.
    avoid : (k,) int
        Taxels that seams keep away from.
    how : mapping
        Options of `flatten` for the first method: its budgets, iterations and precision.
    """

    mesh: SurfaceMesh
    method: str
    others: tuple[str, ...]
    avoid: IntArray
    how: Mapping[str, Any]


def flatten_task(task: FlatTask) -> dict[str, dict[str, Any]]:
    """The map by each method, the first one asked for, as plain arrays and numbers."""
    first = flatten(task.mesh, method=task.method, avoid=task.avoid, **task.how)
    rest = {name: flatten(task.mesh, method=name, avoid=task.avoid) for name in task.others}
    # The mesh is not sent back: who gave the task has it.
    return {
        "": _plain(first),
        **{name: _plain(flat) for name, flat in rest.items()},
    }


def flat_map(mesh: SurfaceMesh, plain: Mapping[str, Any]) -> FlatMap:
    """The flat map of a mesh from what a worker gave back."""
    charts = tuple(
        Chart(**{**chart, "distortion": Distortion(**chart["distortion"])})
        for chart in plain["charts"]
    )
    return FlatMap(mesh, charts, plain["uv"])


def _plain(flat: FlatMap) -> dict[str, Any]:
    charts = [{**_own(chart), "distortion": _own(chart.distortion)} for chart in flat.charts]
    return {"charts": charts, "uv": flat.uv}


def _own(value: Chart | Distortion) -> dict[str, Any]:
    return {field.name: getattr(value, field.name) for field in fields(value)}
