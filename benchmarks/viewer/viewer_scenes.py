"""What the viewer's benchmark draws: the iCub, large skins, and the iCub by PyVista alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from skinmap.geometry.rigid import transform_points
from skinmap.geometry.triangles import TriangleMesh
from skinmap.skin.robot import Part, Robot
from skinmap.skin.skin import Skin
from skinmap.surface.surface_mesh import SurfaceMesh

SIZE = (1024, 768)
PITCH = 5.5e-3  # between taxels [m]
BODY = 100_000  # triangles of a body that is drawn by who knows how
PARTS = 8  # that a large skin is cut into, as real ones are


class OneLink:
    """A body of one link."""

    links = visible_links = ("base",)
    joints: Mapping[str, tuple[float, float]] = {}
    sliding_joints: frozenset[str] = frozenset()

    def __init__(self, mesh: TriangleMesh) -> None:
        self._mesh = mesh

    def poses(self, angles: Mapping[str, float]) -> dict[str, np.ndarray]:
        """The link stands where it is."""
        return {"base": np.eye(4)}

    def mesh(self, link: str) -> TriangleMesh:
        """Its mesh."""
        return self._mesh


def large_scene(n: int, *, panel: bool = False) -> Any:
    """A scene of n taxels around a barrel, in eight parts, on a body of 100,000 triangles.

    With a panel the flat map of the first part is beside it.
    """
    from viewer.scene import Scene

    columns = PARTS * round(np.sqrt(n) / PARTS)
    rows = round(n / columns)
    strip = columns // PARTS
    meshes = {}
    for number in range(PARTS):
        positions, normals = _barrel(np.arange(strip) + number * strip, rows, columns, PITCH)
        skin = Skin(
            f"part {number}",
            "base",
            np.arange(len(positions)),
            np.zeros(len(positions), np.int64),
            positions,
            normals,
        )
        faces = _grid(strip, rows)
        taxel = np.arange(len(positions))
        patches = np.zeros(len(faces), np.int64)
        meshes[skin.part] = SurfaceMesh(skin, faces, taxel, patches)
    around = 320
    scale = PITCH * columns / around
    points, normals = _barrel(np.arange(around + 1), 160, around, scale)
    height = PITCH * rows / (scale * 160)
    points = (points - 2e-3 * normals) * [1.0, 1.0, height]
    robot = Robot(
        "barrel",
        OneLink(TriangleMesh(points, _grid(around + 1, 160))),
        {name: Part(name, "base", lambda: None, None) for name in meshes},  # type: ignore[arg-type,return-value]
    )
    first = next(iter(meshes))
    maps = {first: _unrolled(meshes[first], rows)} if panel else {}
    return Scene(robot, meshes, maps, window_size=SIZE, camera="still")


def _unrolled(mesh: Any, rows: int) -> Any:
    """The flat map of a strip of the barrel: its lattice."""
    from skinmap.flat.distortion import measure_distortion
    from skinmap.flat.flat_map import Chart, FlatMap

    taxels = np.arange(len(mesh.skin))
    uv = PITCH * np.stack([taxels // rows, taxels % rows], axis=1).astype(np.float64)
    distortion = measure_distortion(mesh.vertices, mesh.faces, uv)
    chart = Chart(0, taxels, mesh.faces, uv, distortion, "unrolled", False, 0, 0.0, 0.0)
    return FlatMap(mesh, (chart,), uv)


def _barrel(
    columns: np.ndarray, rows: int, around: int, pitch: float
) -> tuple[np.ndarray, np.ndarray]:
    """Lattice points and normals on a cylinder."""
    column, row = (part.ravel() for part in np.meshgrid(columns, np.arange(rows), indexing="ij"))
    angle = 2 * np.pi * column / around
    radius = pitch * around / (2 * np.pi)
    normals = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))], axis=1)
    points = radius * normals
    points[:, 2] = pitch * (row - rows / 2)
    return points, normals


def _grid(columns: int, rows: int) -> np.ndarray:
    """Triangles of a lattice, outward."""
    at = np.arange(columns * rows).reshape(columns, rows)
    a, b, c, d = (x.ravel() for x in (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]))
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def good_pyvista(
    robot: Robot, meshes: Mapping[str, SurfaceMesh], *, moving: bool = False
) -> Callable[[int], None]:
    """The robot in PyVista set up well: the skin a sheet, a body of few triangles, no smoothing.

    Other values of all taxels with each call.
    """
    import pyvista as pv

    def placed(mesh: Any, link: str) -> Any:
        points = transform_points(poses[link], mesh.vertices)
        return pv.PolyData.from_regular_faces(points, mesh.faces)

    poses = robot.body.poses(robot.pose)
    links = {link: robot.mesh(link) for link in robot.body.visible_links}
    body = pv.merge([placed(mesh, link) for link, mesh in links.items() if len(mesh.faces)])
    first, *others = (placed(one, one.skin.link) for one in meshes.values())
    skin = first.append_polydata(*others)
    skin["pressure"] = np.zeros(skin.n_points)
    plotter = pv.Plotter(off_screen=True, window_size=list(SIZE))
    plotter.disable_anti_aliasing()
    plotter.add_mesh(body.decimate(1.0 - BODY / body.n_cells), color="lightgray")
    plotter.add_mesh(skin, scalars="pressure", clim=(0, 255))
    plotter.camera_position = "yz"
    plotter.show(auto_close=False)
    rng = np.random.default_rng(0)
    values = [255 * rng.random(skin.n_points) for _ in range(4)]

    def draw(number: int) -> None:
        if moving:
            plotter.camera.Azimuth(1.0)
        skin["pressure"][:] = values[number % 4]
        plotter.render()

    return draw
