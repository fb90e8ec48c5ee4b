"""CPU time, start-up and memory of the viewer, PyVista in turns: `make bench-viewer`.

Writes benchmarks/results/viewer.json. CPU time of the process per frame at 1024x768, pictures
not read back. `--quick` takes few rounds and leaves out what takes long. The long soak of 200,000
updates is `make soak`.
"""

from __future__ import annotations

import itertools
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness.record import afresh, command
from benchmarks.harness.timing import children_seconds, peak_mb, quartiles, take_turns
from benchmarks.viewer.viewer_soak import ages, moments, soak
from skinmap.geometry.rigid import transform_points
from skinmap.geometry.triangles import TriangleMesh
from skinmap.skin.robot import Part, Robot
from skinmap.skin.skin import Skin
from skinmap.surface.surface_mesh import SurfaceMesh

REPEATS = 8  # frames of a kind in a round
GOOD = "PyVista set up well"
Frame = Callable[[int], object]
# What a first picture imports: in none of its figures.
IMPORTS = (
    "skinmap", "skinmap.io.robots.manifest", "skinmap.flat.flat_map",
    "skinmap.surface.surface_mesh", "lxml.etree", "trimesh", "igl", "icub_models",
    "pyvista.plotting", "viewer.scene",
)  # fmt: skip


def measure(
    quick: bool, *, updates: int = 5_000, rounds: int = 7, fresh: int = 3
) -> dict[str, Any]:
    """Rows of first pictures, frames, memory over many updates, and the age of what is shown.

    Parameters
    ----------
    quick : bool
        Few rounds, and no large skins.
    updates : int
        Of the soak.
    rounds : int
        Rounds in which all kinds of frames take turns.
    fresh : int
        Processes for a first picture.
    """
    from skinmap.display import require_opengl

    require_opengl()
    fresh = 1 if quick else fresh
    result: dict[str, Any] = {
        "first_picture": [
            first_picture(parts, links, fresh)
            for parts, links in (("all", "all"), ("torso", "all"), ("torso", "skin"))
        ],
        "help_s": help_seconds(fresh),
        "frames": frame_rows(3 if quick else rounds, large=not quick),
    }
    scene = _icub(["torso"], (320, 240))
    result["soak"] = soak(scene, 2_000 if quick else updates)
    scene.close()
    result["ages_at_50_hz"] = ages(_icub(None, SIZE))
    result["ages_at_50_hz_turning"] = ages(_icub(None, SIZE), turn=1.0)
    return result


def first_picture(parts: str, links: str, repeats: int) -> dict[str, Any]:
    """Medians over fresh processes; nothing is kept from one to the next."""
    runs = [afresh(first_figures, parts, links) for _ in range(repeats)]
    row: dict[str, Any] = {key: float(np.median([run[key] for run in runs])) for key in runs[0]}
    if len(runs) > 1:
        row["first_picture_quartiles_s"] = quartiles([run["first_picture_s"] for run in runs])
    return {"parts": parts, "links": links, **row}


def first_figures(parts: str, links: str) -> dict[str, float]:
    """Time [s] and memory [MB] of a first picture in this process, which has drawn nothing yet."""
    from skinmap.display import require_opengl

    require_opengl()
    for name in IMPORTS:
        import_module(name)
    imported, before = time.process_time(), peak_mb()
    scene = import_module("viewer.scene").Scene.load(
        "icub", None if parts == "all" else [parts], links=links, window_size=SIZE
    )
    scene.refresh(360.0)
    return {"first_picture_s": time.process_time() - imported, "memory_mb": peak_mb() - before}


def help_seconds(repeats: int) -> float:
    """CPU time of `skinmap view --help`, Python's own start included."""
    line = [str(Path(sys.executable).with_name("skinmap")), "view", "--help"]
    times = []
    for _ in range(repeats):
        before = children_seconds()
        subprocess.run(line, capture_output=True, check=True)
        times.append(children_seconds() - before)
    return float(np.median(times))


def frame_rows(rounds: int, *, large: bool) -> list[dict[str, Any]]:
    """CPU time of a frame of each kind; all of a robot, and all of large skins, take turns.

    Large skins are drawn after the robot: windows that nobody has beside it would empty its caches.
    """
    scene = _icub(None, SIZE)
    meshes = {part: layer.mesh for part, layer in scene.layers.items()}
    kinds: dict[str, Frame] = {
        GOOD: good_pyvista(scene.robot, meshes),
        f"{GOOD}, moving": good_pyvista(scene.robot, meshes, moving=True),
        "iCub at rest, all taxels change": changing(scene),
        "iCub at rest, three of 13 parts change": changing(scene, list(meshes)[3:6]),
        "iCub at rest, one touch": touching(scene),
        "iCub moving, all taxels change": moving(scene),
    }
    rows = cpu_ms(kinds, rounds)
    scene.close()
    return rows + (large_rows(rounds) if large else [])


def large_rows(rounds: int) -> list[dict[str, Any]]:
    """The same of planted skins of 20,000 and 100,000 taxels."""
    scenes: list[Any] = []
    kinds: dict[str, Frame] = {}
    for n in (20_000, 100_000):
        scenes += [large_scene(n), large_scene(n, panel=True)]
        kinds[f"{n:,} taxels at rest, all change"] = changing(scenes[-2])
        kinds[f"{n:,} taxels at rest, all change, flat map beside"] = changing(scenes[-1])
    rows = cpu_ms(kinds, rounds)
    for one in scenes:
        one.close()
    return rows


def changing(scene: Any, parts: list[str] | None = None) -> Frame:
    """Every taxel of some parts, or of all, another value in each frame."""
    rng = np.random.default_rng(0)
    chosen = scene.layers if parts is None else parts
    sizes = {part: len(scene.layers[part].skin) for part in chosen}
    values = [{p: rng.uniform(0.0, 255.0, n) for p, n in sizes.items()} for _ in range(4)]

    def draw(number: int) -> None:
        for part, pressures in values[number % 4].items():
            scene.set_pressures(part, pressures)
        scene.refresh()

    return draw


def touching(scene: Any) -> Frame:
    """A touch that wanders, with its outline and label."""
    source = moments({part: layer.skin for part, layer in scene.layers.items()})

    def draw(_: int) -> None:
        scene.framing.mode = "still"
        scene.show_moment(next(source))
        scene.refresh()

    return draw


def moving(scene: Any) -> Frame:
    """The camera turns a degree with each frame."""
    change = changing(scene)

    def draw(number: int) -> None:
        scene.look(20.0 + number % 360)
        change(number)

    return draw


def cpu_ms(kinds: dict[str, Frame], rounds: int) -> list[dict[str, Any]]:
    """Median and quartiles over rounds in which all kinds take turns."""
    number = itertools.count(1)
    tasks = {name: (lambda draw=draw: draw(next(number)), REPEATS) for name, draw in kinds.items()}
    rows = []
    # What the kind before left is not a kind's own cost.
    for name, times in take_turns(tasks, rounds, settling=3).items():
        low, middle, high = quartiles(1e3 * times)
        rows.append({"what": name, "cpu_ms": middle, "quartiles": (low, high)})
        print(f"{name}: {middle:.2f} ms ({low:.2f} to {high:.2f})")
    return rows


def _icub(parts: list[str] | None, size: tuple[int, int]) -> Any:
    from viewer.scene import Scene

    return Scene.load("icub", parts, window_size=size, camera="still")


# What the viewer's benchmark draws: the iCub, large skins, and the iCub by PyVista alone.

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


if __name__ == "__main__":
    command(measure, __doc__, "viewer")
