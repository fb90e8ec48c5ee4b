"""The cases of needs.py, each in a process forked after the imports of its group.

`echo '["parts loaded", "1"]' | python -m benchmarks.scale.needs_cases skins`
prints one line of JSON.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from benchmarks.harness.forked import peak_mb, serve
from benchmarks.harness.timing import timed

SIZE = (1024, 768)  # of a picture [px]
LAYERS = ("pressure", "patches", "distortion", "structures")
ALL_LAYERS = "all four"
AS_READ = "as read"  # the links, not reduced
SKINS = (
    "icub_models", "igl", "scipy.sparse.csgraph", "scipy.spatial", "trimesh", "lxml.etree",
    "benchmarks.geometry.meshing",
    "skinmap.flat.flat_map", "skinmap.io.robots.manifest", "skinmap.touch.prepared_skin",
)  # fmt: skip
VIEWER = ("pyvista.plotting", "viewer.scene", "viewer.drawing.body.bare_body")
# What work on skins imports, and the viewer's besides: in no case's figures.
IMPORTS = {"skins": SKINS, "viewer": (*SKINS, *VIEWER)}
GROUPS = {
    "parts loaded": "skins", "parts prepared": "skins", "taxels": "skins",
    "parts shown": "viewer", "mesh detail": "viewer", "layers": "viewer",
}  # fmt: skip


def measured(what: str, case: str) -> dict[str, Any]:
    """Time and memory of one case, in this process."""
    run = MAKE[what](case)
    before = peak_mb()
    size, cpu, wall = timed(run)
    counted = "triangles" if what == "mesh detail" else "taxels"
    mb = max(peak_mb() - before, 0.0)
    return {counted: size, "cpu_s": cpu, "wall_s": wall, "mb": mb}


def _loaded(case: str) -> Callable[[], int]:
    import skinmap

    def run() -> int:
        robot = skinmap.load_robot("icub")
        return sum(len(robot.skin(part)) for part in robot.parts[-int(case) :])

    return run


def _prepared(case: str) -> Callable[[], int]:
    import skinmap
    from skinmap.touch.prepared_skin import PreparedSkin

    def run() -> int:
        robot = skinmap.load_robot("icub")
        skins = [PreparedSkin(robot.skin(part)) for part in robot.parts[-int(case) :]]
        return sum(len(skin.flat.mesh.skin) for skin in skins)  # meshed and flattened on the way

    return run


def _scene(parts: slice | list[str], layers: Sequence[str]) -> Callable[[], int]:
    import skinmap
    from viewer.display import require_opengl
    from viewer.scene import Scene

    require_opengl()

    def run() -> int:
        robot = skinmap.load_robot("icub")
        names = list(robot.parts[parts]) if isinstance(parts, slice) else parts
        scene = Scene.load(robot, names, links="skin", window_size=SIZE, layer=layers[0])
        scene.refresh(360.0)
        for layer in layers[1:]:
            scene.set_layer(layer)
            scene.refresh(360.0)
        return sum(len(one.skin) for one in scene.layers.values())

    return run


def _sheet(case: str) -> Callable[[], int]:
    from benchmarks.geometry.meshing import wavy_skin
    from skinmap.touch.prepared_skin import PreparedSkin

    skin = wavy_skin(int(case))
    PreparedSkin(wavy_skin(400)).flat  # noqa: B018  (compiled code is read now)

    def run() -> int:
        return len(PreparedSkin(skin).flat.uv)

    return run


def _detail(case: str) -> Callable[[], int]:
    import pyvista as pv

    import skinmap
    from viewer.display import require_opengl
    from viewer.drawing.body.bare_body import body_meshes
    from viewer.drawing.frame.polydata import make_mesh

    require_opengl()

    def run() -> int:
        robot = skinmap.load_robot("icub")
        if case == AS_READ:
            read = {link: robot.mesh(link) for link in robot.body.visible_links}
            meshes = {link: make_mesh(one.vertices, one.faces) for link, one in read.items()}
        else:
            meshes = body_meshes(robot, cell=1e-3 * float(case))
        plotter = pv.Plotter(off_screen=True, window_size=list(SIZE))
        for mesh in meshes.values():
            plotter.add_mesh(mesh)
        plotter.show(auto_close=False)
        return sum(mesh.n_cells for mesh in meshes.values())

    return run


MAKE: Mapping[str, Callable[[str], Callable[[], int]]] = {
    "parts loaded": _loaded,
    "parts prepared": _prepared,
    "parts shown": lambda case: _scene(slice(-int(case), None), ["pressure"]),
    "taxels": _sheet,
    "mesh detail": _detail,
    "layers": lambda case: _scene(["right_forearm"], LAYERS if case == ALL_LAYERS else [case]),
}


if __name__ == "__main__":
    serve(IMPORTS[sys.argv[1]], measured)
