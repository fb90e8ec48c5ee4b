"""The necessary work of commands: the functions that their output is made of, and what they import.

`python -m benchmarks.scale.command_work NAME` imports, works once and prints the CPU time of the
work [s] as JSON; with `--imports` it only imports.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from benchmarks import ROOT
from skinmap.imports import run_late

ARRAYS = ("numpy", "scipy.sparse.csgraph", "scipy.sparse.linalg", "scipy.spatial", "click", "rich")
ANSWER = ("click", "rich.table", "rich.console", "msgspec", "importlib.metadata")
MESHES = (*ARRAYS, "igl", "lxml.etree", "icub_models")
FLAT = (*MESHES, "shapely", "potpourri3d")
PLOTS = ("matplotlib.figure", "matplotlib.backends.backend_agg", "matplotlib.collections")
FILE = (*FLAT, "trimesh")  # of a mesh that no robot brings
NAMES = (*FLAT, "sklearn.base")
TRAINING = (*NAMES, "sklearn.svm", "sklearn.linear_model", "sklearn.model_selection")
SCENE = (*NAMES, "pyvista.plotting", "vtkmodules.vtkRenderingOpenGL2", "PIL.Image")


def _surfaces(robot: str, *parts: str) -> list[Any]:
    import skinmap

    body = skinmap.load_robot(robot)
    return [skinmap.build_surface(body.skin(part)) for part in parts or body.parts]


def _maps(robot: str, *parts: str, methods: tuple[str, ...] = ("balanced",)) -> list[Any]:
    import numpy as np

    import skinmap
    from skinmap.flat.geodesic import geodesic_stress

    meshes = _surfaces(robot, *parts)
    maps = [skinmap.flatten(mesh, method=method) for mesh in meshes for method in methods]
    for flat in maps[:: len(methods)]:
        for chart in flat.charts:
            points = flat.mesh.vertices[chart.taxels]
            geodesic_stress(points, chart.faces, chart.uv, rng=np.random.default_rng(0))
    return maps


def _pictures(maps: list[Any]) -> None:
    from skinmap.cli.flatten.figures import histogram_figure, part_figure
    from skinmap.flat.face_metrics import face_metric

    for flat in maps:
        part_figure(flat, face_metric("edge_strain"))
        histogram_figure(flat)


def _mesh_map(path: str, method: str) -> Any:
    import numpy as np

    import skinmap
    from skinmap.flat.geodesic import geodesic_stress
    from skinmap.flat.mesh_charts import mesh_surface
    from skinmap.io.robots.mesh_file import read_mesh

    flat = skinmap.flatten(mesh_surface(*read_mesh(Path(path), merge=False)), method=method)
    for chart in flat.charts:
        points = flat.mesh.vertices[chart.taxels]
        geodesic_stress(points, chart.faces, chart.uv, rng=np.random.default_rng(0))
    return flat


def _inspect(*parts: str) -> None:
    import skinmap
    from skinmap.cli.inspect.inspection import inspect_part

    robot = skinmap.load_robot("icub")
    for part in parts or robot.parts:
        inspect_part(robot, part)


def _structures() -> None:
    import skinmap
    from skinmap.neighbours.structures import find_structures
    from skinmap.report.structure_figures import body_figure, structures_figure
    from skinmap.touch.prepared_skin import PreparedSkin

    robot = skinmap.load_robot("icub")
    skin = PreparedSkin(robot.skin("right_leg_upper"))
    found = find_structures(skin.neighbourhoods(symmetry=6), rotations=6)
    structures_figure({"right_leg_upper": skin}, found, Path("work.png"))
    body_figure(robot, {"right_leg_upper": skin}, found, Path("work.png"))


def _simulate() -> None:
    import skinmap

    robot = skinmap.load_robot("icub")
    for part in robot.parts:
        skinmap.simulate(robot.skin(part), per_gesture=20, rng=0)


def _train() -> None:
    """A model of two parts, and how well it does on all others."""
    import skinmap
    from skinmap.classify.descriptors import recorded_touches
    from skinmap.classify.evaluate import score
    from skinmap.touch.prepared_skin import prepare_skins

    every, robot = skinmap.load_recordings("touches.npz"), skinmap.load_robot("icub")
    own = [one for one in every if one.part in ("torso", "left_arm")]
    others = [one for one in every if one.part not in ("torso", "left_arm")]
    model = skinmap.train(own, robot)
    skins = prepare_skins(robot, others)
    score(model, [touch for one in others for touch in recorded_touches(skins[one.part], one)])


def _classify() -> None:
    import skinmap

    touches = [t for t in skinmap.load_recordings("touches.npz") if t.part == "right_forearm"]
    robot = skinmap.load_robot("icub")
    skinmap.classify(touches, skinmap.load_classifier("touch.skinmodel"), robot)


def _still(*parts: str) -> None:
    """A still of what the simulator touches for a while."""
    import skinmap
    from viewer.view_files import STILL_SECONDS
    from viewer.view_options import Session

    robot = skinmap.load_robot("icub")
    session = Session(robot, parts or robot.parts)
    session.prepare()
    felt = list(session.moments(STILL_SECONDS))
    skinmap.show(robot, moments=felt, parts=parts or None, path="work.png")


Work = tuple[tuple[str, ...], Callable[[], Any]]
WORKS: dict[str, Work] = {
    "inspect": (MESHES, _inspect),
    "inspect_part": (MESHES, lambda: _inspect("right_forearm")),
    "flatten": (FLAT, lambda: _maps("icub")),
    "flatten_out": ((*FLAT, *PLOTS), lambda: _pictures(_maps("icub", "left_arm"))),
    "flatten_compare": (
        (*FLAT, *PLOTS),
        lambda: _pictures(_maps("icub", "left_arm", methods=("balanced", "bff", "lscm"))[::3]),
    ),
    "hand_out": (
        (*FILE, *PLOTS),
        lambda: _pictures([_mesh_map(str(ROOT / "data/kaspar/meshes/hand.ply"), "accurate")]),
    ),
    "structures": ((*MESHES, *PLOTS), _structures),
    "export": (MESHES, lambda: _surfaces("icub", "torso")),
    "simulate": (MESHES, _simulate),
    "train": (TRAINING, _train),
    "classify": (NAMES, _classify),
    "still": (SCENE, _still),
    "still_part": (SCENE, lambda: _still("left_arm")),
    "nothing": (ANSWER, lambda: None),
}


def main() -> None:
    """Import, then work."""
    name, *rest = sys.argv[1:]
    modules, work = WORKS.get(name, (FILE, lambda: _mesh_map(*rest)))
    run_late()  # as commands do
    for module in modules:
        import_module(module)
    if "--imports" in rest:
        return
    started = time.process_time()
    work()
    print(json.dumps({"cpu_s": time.process_time() - started}))


if __name__ == "__main__":
    main()
