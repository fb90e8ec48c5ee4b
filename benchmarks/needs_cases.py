"""The cases of needs.py: each is prepared, then timed, in a process forked after the imports.

`python benchmarks/needs_cases.py GROUP '[["parts loaded", "1"], ...]'` prints one line of JSON a
case. What is forked has the imports of its group and no more, so no case helps the next. A forked
process maps the libraries' pages anew as it runs through them, which is no memory that a case
needs: all are mapped before.
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path

from timing import timed

POPULATE_READ = 22  # MADV_POPULATE_READ of Linux's asm-generic/mman-common.h
SIZE = (1024, 768)  # of a picture [px]
LAYERS = ("pressure", "patches", "distortion", "structures")
ALL_LAYERS = "all four"
SKINS = (
    "icub_models", "igl", "scipy.sparse.csgraph", "scipy.spatial", "trimesh", "yourdfpy", "meshing",
    "skinmap.flat.flat_map", "skinmap.io.manifest", "skinmap.touch.prepared",
)  # fmt: skip
VIEWER = ("pyvista.plotting", "viewer.scene", "viewer.drawing.body")
# What work on skins imports, and the viewer's besides: in no case's figures.
IMPORTS = {"skins": SKINS, "viewer": (*SKINS, *VIEWER)}
GROUPS = {
    "parts loaded": "skins", "parts prepared": "skins", "taxels": "skins",
    "parts shown": "viewer", "mesh detail": "viewer", "layers": "viewer",
}  # fmt: skip


def main() -> None:
    """Import, then fork for each case."""
    group, cases = sys.argv[1], json.loads(sys.argv[2])
    for module in IMPORTS[group]:
        import_module(module)
    imports_mb = peak_mb()
    for what, case in cases:
        if not (pid := os.fork()):
            _end_with(what, case, imports_mb)
        _, status = os.waitpid(pid, 0)
        if status:
            raise SystemExit(f"{what}, {case}: exit {os.waitstatus_to_exitcode(status)}")


def _end_with(what: str, case: str, imports_mb: float) -> None:
    """Measure a case in this process and end it, without what the process before would do."""
    code = 1
    try:
        map_libraries()
        print(json.dumps(measured(what, case) | {"imports_mb": imports_mb}), flush=True)
        code = 0
    finally:
        if code:
            traceback.print_exc()
            sys.stderr.flush()
        os._exit(code)


def measured(what: str, case: str) -> dict[str, float]:
    """Time and memory of one case, in this process."""
    run = MAKE[what](case)
    before = peak_mb()
    size, cpu, wall = timed(run)
    counted = "triangles" if what == "mesh detail" else "taxels"
    mb = max(peak_mb() - before, 0.0)
    return {counted: size, "cpu_s": cpu, "wall_s": wall, "mb": mb}


def map_libraries() -> None:
    """Map all pages of the libraries in use (Linux 5.14; elsewhere their pages count as memory)."""
    madvise = ctypes.CDLL(None).madvise
    madvise.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
    for line in Path("/proc/self/maps").read_text(encoding="utf-8").splitlines():
        fields = line.split()
        if len(fields) > 5 and fields[1].startswith("r") and fields[5].startswith("/"):
            first, last = (int(one, 16) for one in fields[0].split("-"))
            madvise(first, last - first, POPULATE_READ)


def peak_mb() -> float:
    """Largest resident size of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _loaded(case: str) -> Callable[[], int]:
    import skinmap

    def run() -> int:
        robot = skinmap.load_robot("icub")
        return sum(len(robot.skin(part)) for part in robot.parts[-int(case) :])

    return run


def _prepared(case: str) -> Callable[[], int]:
    import skinmap
    from skinmap.touch.prepared import PreparedSkin

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
    from meshing import wavy_skin

    from skinmap.touch.prepared import PreparedSkin

    skin = wavy_skin(int(case))
    PreparedSkin(wavy_skin(400)).flat  # noqa: B018  (compiled code is read now)

    def run() -> int:
        return len(PreparedSkin(skin).flat.uv)

    return run


def _detail(case: str) -> Callable[[], int]:
    import pyvista as pv

    import skinmap
    from viewer.display import require_opengl
    from viewer.drawing.body import body_meshes
    from viewer.drawing.polydata import make_mesh

    require_opengl()

    def run() -> int:
        robot = skinmap.load_robot("icub")
        if case == "as read":
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
    main()
