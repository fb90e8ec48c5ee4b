"""Meshing of taxels against the peers: what comes out, and what it costs.

`meshing_rows` and `icub_rows` give the rows, one dictionary each; run as a program this prints
them and writes benchmarks/results/meshing.json. Peers that are not installed are left out, and
named so. One thread: set OMP_NUM_THREADS=1.
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
from skinmap.geometry.topology import boundary_loops, edges, face_components, half_edges
from skinmap.skin.skin import Skin, skin_from_points
from skinmap.surface.consensus_meshing import Limits, close_small_holes
from skinmap.surface.merge import consensus, fans
from skinmap.surface.surface_mesh import build_surface
from skinmap.surface.taxel_cloud import make_cloud

SIZES = (1_000, 10_000, 100_000, 1_000_000)
REPEATS = 3
ONCE = 300_000  # points: from here on one run each
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


def potpourri3d_stars(skin: Skin) -> np.ndarray:
    """Stars from potpourri3d, then our merge and closing of holes."""
    import potpourri3d

    cloud = make_cloud(skin.positions, skin.normals)
    limits = Limits.of(cloud, None, None, 8)
    local = potpourri3d.PointCloudLocalTriangulation(np.array(cloud.points))
    votes = local.get_local_triangulation().reshape(-1, 3).astype(np.int64)
    votes = votes[(votes >= 0).all(axis=1)]
    corners = cloud.points[votes]
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    turned = np.einsum("ij,ij->i", np.cross(b - a, c - a), cloud.normals[votes[:, 0]]) < 0
    votes[turned] = votes[turned][:, ::-1]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    votes = votes[longest <= limits.max_edge]
    faces = consensus(cloud.points, cloud.normals, votes, limits.least_altitude)
    return cloud.vertices[close_small_holes(cloud, limits, faces)]


def open3d_pivoting(skin: Skin) -> np.ndarray:
    """Open3D ball pivoting with balls of one, one and a half and two spacings."""
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(np.array(skin.positions)))
    cloud.normals = open3d.utility.Vector3dVector(
        np.array(skin.normals)
    )  # it takes no read-only arrays
    radii = open3d.utility.DoubleVector([PITCH, 1.5 * PITCH, 2 * PITCH])
    mesh = open3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(cloud, radii)
    return np.asarray(mesh.triangles, np.int64)


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
    "potpourri3d stars, our merge": ("potpourri3d", potpourri3d_stars),
    "Open3D ball pivoting": ("open3d", open3d_pivoting),
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
    """What a mesh is like: taxels used, patches, holes, and what of it is not manifold."""
    if len(faces) == 0:
        return {"faces": 0, "used": 0, "patches": 0, "holes": 0, "bad_edges": 0, "bad_vertices": 0}
    directed = half_edges(faces)
    sides = np.sort(directed, axis=1)
    _, count = np.unique(sides, axis=0, return_counts=True)
    crowded = int((count > 2).sum()) + len(directed) - len(np.unique(directed, axis=0))
    pinched = _pinched(faces)
    return {
        "faces": len(faces),
        "used": len(np.unique(faces)),
        "patches": int(face_components(faces).max()) + 1,
        "holes": _holes(faces) if crowded + pinched == 0 else _euler_holes(faces),
        "bad_edges": crowded,
        "bad_vertices": pinched,
    }


def _holes(faces: np.ndarray) -> int:
    loops = len(boundary_loops(faces))
    return loops - int(face_components(faces).max()) - 1 if loops else 0


def _euler_holes(faces: np.ndarray) -> int:
    """Holes of a mesh that is no manifold: what its Euler number lacks to discs."""
    pieces = int(face_components(faces).max()) + 1
    return pieces - (len(np.unique(faces)) - len(edges(faces)) + len(faces))


def _pinched(faces: np.ndarray) -> int:
    _, vertex = fans(faces)
    return int((np.bincount(vertex) > 1).sum())


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


def meshing_rows(sizes: tuple[int, ...] = SIZES) -> list[dict[str, Any]]:
    """One row for each size and method, methods interleaved, each warmed up on a small skin."""
    meshers = installed()
    small = wavy_skin(400)
    timed(meshers, small, 1)
    rows = []
    for size in sizes:
        skin = wavy_skin(size)
        for name, (faces, cpu) in timed(meshers, skin, 1 if size >= ONCE else REPEATS).items():
            row = {"method": name, "n": len(skin), **describe(faces), "cpu_s": cpu[1]}
            rows.append(row | {"quartiles_s": cpu})
    return rows


def icub_rows() -> list[dict[str, Any]]:
    """One row for each method: all 13 parts of the iCub together, `accurate` on their links."""
    import skinmap

    robot = skinmap.load_robot("icub")
    skins = [robot.skin(part) for part in robot.parts]
    bodies = {id(skin): robot.mesh(skin.link) for skin in skins}

    def accurate(skin: Skin) -> np.ndarray:
        return build_surface(skin, method="accurate", body=bodies[id(skin)]).faces

    rows = []
    for name, mesher in {**installed(), "accurate": accurate}.items():
        total, complete, seconds = dict.fromkeys(describe(np.zeros((0, 3))), 0), 0, 0.0
        for skin in skins:
            repeats = 1 if name == "accurate" else REPEATS
            faces, cpu = timed({name: mesher}, skin, repeats)[name]
            found = describe(faces)
            total = {key: total[key] + value for key, value in found.items()}
            complete += found["used"] == len(skin)
            seconds += cpu[1]
        rows.append({"method": name, "n": sum(map(len, skins)), "complete_parts": complete,
                     **total, "cpu_s": seconds})  # fmt: skip
    return rows


def missing() -> list[str]:
    """Peers that are not installed."""
    return [name for name in METHODS if name not in installed()]


def measure(quick: bool, *, largest: int = SIZES[-1]) -> dict[str, Any]:
    """Rows of the iCub and of sheets of up to so many taxels."""
    sizes = (1_000,) if quick else tuple(size for size in SIZES if size <= largest)
    return {"not_installed": missing(), "icub": icub_rows(), "rows": meshing_rows(sizes)}


if __name__ == "__main__":
    from benchmarks.harness.record import command

    command(measure, __doc__, "meshing")
