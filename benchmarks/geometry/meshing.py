"""Meshing of taxels against the peers: what comes out, and what it costs.

`meshing_rows` gives the rows, a part of `make bench-geometry`. Peers that are not installed are
left out, and named so.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from benchmarks.harness.timing import Quartiles, quartiles
from benchmarks.harness.timing import timed as timed_call
from skinmap.errors import InvalidMeshError
from skinmap.geometry.topology import face_components
from skinmap.skin.skin import Skin, skin_from_points
from skinmap.surface.surface_mesh import build_surface

REPEATS = 3
PITCH = 6.5e-3  # m, as on the iCub
Mesher = Callable[[Skin], np.ndarray]


def wavy_skin(n: int, seed: int = 0) -> Skin:
    """About n taxels on a wavy sheet: hexagons, each off its place by a twentieth of the pitch."""
    rng = np.random.default_rng(seed)
    side = round(np.sqrt(n))
    row, column = np.divmod(np.arange(side * side), side)
    x, y = column + 0.5 * (row % 2), row * np.sqrt(3) / 2
    points = np.column_stack([x, y, 2.0 * np.sin(0.2 * x)]) + 0.05 * rng.normal(size=(len(x), 3))
    normals = np.column_stack([-0.4 * np.cos(0.2 * x), 0 * x, 1 + 0 * x])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return skin_from_points(PITCH * points, normals)


def ours(method: str) -> Mesher:
    """One of our methods."""
    return lambda skin: build_surface(skin, method=method).faces


def pymeshlab_pivoting(skin: Skin) -> np.ndarray:
    """Ball pivoting of MeshLab with the radius of its choice."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(skin.positions, v_normals_matrix=skin.normals))
    meshes.generate_surface_reconstruction_ball_pivoting()
    return meshes.current_mesh().face_matrix().astype(np.int64)


METHODS: dict[str, tuple[str | None, Mesher]] = {
    "consensus": (None, ours("consensus")),
    "fast": (None, ours("fast")),
    "pymeshlab ball pivoting": ("pymeshlab", pymeshlab_pivoting),
}


def installed() -> dict[str, Mesher]:
    """The methods whose package is there."""
    return {
        name: mesher
        for name, (package, mesher) in METHODS.items()
        if package is None or importlib.util.find_spec(package) is not None
    }


def describe(faces: np.ndarray) -> dict[str, int]:
    """What a mesh is like: triangles, taxels used, patches."""
    label = face_components(faces) if len(faces) else np.array([-1])
    return {
        "faces": len(faces),
        "used": len(np.unique(faces)),
        "patches": int(label.max()) + 1,
    }


def timed(
    meshers: Mapping[str, Mesher], skin: Skin, repeats: int
) -> dict[str, tuple[np.ndarray, Quartiles]]:
    """Faces and quartiles of the CPU time [s] of each, all in turns."""

    def run(mesher: Mesher) -> np.ndarray:
        try:
            return mesher(skin)
        except InvalidMeshError:
            return np.zeros((0, 3), np.int64)

    runs: dict[str, list[float]] = {name: [] for name in meshers}
    faces = {}
    for _ in range(repeats):
        for name, mesher in meshers.items():
            faces[name], cpu, _ = timed_call(partial(run, mesher))
            runs[name].append(cpu)
    return {name: (faces[name], quartiles(each)) for name, each in runs.items()}


def meshing_rows(sizes: tuple[int, ...]) -> list[dict[str, Any]]:
    """One row for each size and method, methods interleaved, each warmed up on a small skin."""
    meshers = installed()
    small = wavy_skin(400)
    timed(meshers, small, 1)
    rows = []
    for size in sizes:
        skin = wavy_skin(size)
        for name, (faces, cpu) in timed(meshers, skin, REPEATS).items():
            row = {"method": name, "n": len(skin), **describe(faces), "cpu_s": cpu[1]}
            rows.append(row | {"quartiles_s": cpu})
    return rows


def missing() -> list[str]:
    """Peers that are not installed."""
    return [name for name in METHODS if name not in installed()]
