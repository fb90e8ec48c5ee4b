"""What is asked for, and what it costs: time and memory by parts, taxels, mesh detail and layers.

Each case runs in fresh processes, which take turns; memory is the largest resident size above
that after the imports. Writes benchmarks/results/needs.json, and docs/needs.md from it
(`--page` writes the page from the file alone).
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from record import RESULTS, command
from timing import quartiles, timed

TURNS = 3
PAGE = Path(__file__).parents[1] / "docs" / "needs.md"
PARTS = (1, 3, 13)
TAXELS = (1_000, 3_000, 10_000, 30_000)
CELLS_MM = (16.0, 8.0, 4.0, 2.0, 1.0)
LAYERS = ("pressure", "patches", "distortion", "structures")
# What is measured, its cases, and its words in the page.
WHATS: dict[str, tuple[tuple[Any, ...], str]] = {
    "parts loaded": (PARTS, "Taxels, normals and links of so many parts of the iCub"),
    "parts prepared": (PARTS, "The same with surface meshes and flat maps"),
    "parts shown": (PARTS, "The same in a scene, on the links that carry them; first picture"),
    "taxels": (TAXELS, "One sheet of so many taxels, meshed and flattened"),
    "mesh detail": (CELLS_MM, "All links of the iCub, reduced to cells of so many mm"),
    "layers": (LAYERS, "The right forearm in a scene, one layer shown; first picture"),
}


def measure(quick: bool, *, turns: int = TURNS) -> dict[str, Any]:
    """One row a case: medians and quartiles over fresh processes.

    Parameters
    ----------
    quick : bool
        One turn, the first and the last case of each.
    turns : int
        Fresh processes for each case.
    """
    cases = [
        (what, case)
        for what, (every, _) in WHATS.items()
        for case in (every[:: max(len(every) - 1, 1)] if quick else every)
    ]
    runs: dict[tuple[str, Any], list[dict[str, float]]] = {key: [] for key in cases}
    for _ in range(1 if quick else turns):
        for what, case in cases:
            runs[what, case].append(_fresh(what, case))
    return {"cases": [_row(*key, found) for key, found in runs.items()]}


def _row(what: str, case: Any, runs: list[dict[str, float]]) -> dict[str, Any]:
    each = {key: [run[key] for run in runs] for key in runs[0]}
    cpu, wall, mb = (quartiles(each[key]) for key in ("cpu_s", "wall_s", "mb"))
    several = len(runs) > 1
    return {
        "what": what,
        "case": str(case),
        "taxels": each["taxels"][0],
        "cpu_s": cpu[1],
        "wall_s": wall[1],
        "mb": mb[1],
        "imports_mb": float(np.median(each["imports_mb"])),
        "spread_s": cpu if several else None,
        "spread_mb": mb if several else None,
        "turns": len(runs),
    }


def _fresh(what: str, case: Any) -> dict[str, float]:
    child = [sys.executable, str(Path(__file__).resolve()), "--case", what, str(case)]
    done = subprocess.run(child, capture_output=True, text=True, timeout=300)
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
        raise RuntimeError(f"{what}, {case}: {said}")
    return dict(json.loads(done.stdout.splitlines()[-1]))


def _child(what: str, case: str) -> dict[str, float]:
    """Time and memory of one case, in this process, after its imports."""
    run = MAKE[what](case)
    before = _peak_mb()
    taxels, cpu, wall = timed(run)
    return {"taxels": taxels, "cpu_s": cpu, "wall_s": wall, "imports_mb": before,
            "mb": max(_peak_mb() - before, 0.0)}  # fmt: skip


def _imports() -> None:
    """What work on skins imports, so that it is in no case's figures."""
    import icub_models  # noqa: F401
    import igl  # noqa: F401
    import scipy.sparse.csgraph
    import scipy.spatial  # noqa: F401
    import trimesh  # noqa: F401
    import yourdfpy  # noqa: F401

    import skinmap.io.manifest
    import skinmap.touch.prepared  # noqa: F401


def _loaded(case: str) -> Callable[[], int]:
    _imports()
    import skinmap

    def run() -> int:
        robot = skinmap.load_robot("icub")
        return sum(len(robot.skin(part)) for part in robot.parts[-int(case) :])

    return run


def _prepared(case: str) -> Callable[[], int]:
    _imports()
    import skinmap
    from skinmap.touch.prepared import PreparedSkin

    def run() -> int:
        robot = skinmap.load_robot("icub")
        skins = [PreparedSkin(robot.skin(part)) for part in robot.parts[-int(case) :]]
        return sum(len(skin.flat.mesh.skin) for skin in skins)  # meshed and flattened on the way

    return run


def _scene(parts: slice | list[str], layer: str) -> Callable[[], int]:
    _imports()
    import pyvista.plotting  # noqa: F401

    import skinmap
    from viewer.display import require_opengl
    from viewer.scene import Scene

    require_opengl()

    def run() -> int:
        robot = skinmap.load_robot("icub")
        names = list(robot.parts[parts]) if isinstance(parts, slice) else parts
        scene = Scene.load(robot, names, links="skin", window_size=(1024, 768), layer=layer)
        scene.refresh(360.0)
        return sum(len(one.skin) for one in scene.layers.values())

    return run


def _sheet(case: str) -> Callable[[], int]:
    _imports()
    from meshing import wavy_skin

    from skinmap.touch.prepared import PreparedSkin

    skin = wavy_skin(int(case))
    PreparedSkin(wavy_skin(400)).flat  # noqa: B018  (compiled code is read now)

    def run() -> int:
        return len(PreparedSkin(skin).flat.uv)

    return run


def _detail(case: str) -> Callable[[], int]:
    _imports()
    import pyvista.plotting  # noqa: F401

    import skinmap
    from viewer.drawing.body import body_meshes

    def run() -> int:
        meshes = body_meshes(skinmap.load_robot("icub"), cell=1e-3 * float(case))
        return 0 if meshes else -1

    return run


MAKE: Mapping[str, Callable[[str], Callable[[], int]]] = {
    "parts loaded": _loaded,
    "parts prepared": _prepared,
    "parts shown": lambda case: _scene(slice(-int(case), None), "pressure"),
    "taxels": _sheet,
    "mesh detail": _detail,
    "layers": lambda case: _scene(["right_forearm"], case),
}


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def page_of(result: Mapping[str, Any]) -> str:
    """docs/needs.md from the rows of a run."""
    machine = result["machine"]
    lines = [
        "# Only what a scene needs",
        "",
        "Time and memory grow with what is asked for. Written by `make bench-needs` from",
        f"`benchmarks/results/needs.json`: commit {result['commit']}, {machine['cores']} cores, "
        f"{machine['processor']},",
        f"{result['cases'][0]['turns']} fresh processes a case, medians; memory is above the "
        "imports.",
    ]
    for what, (_, text) in WHATS.items():
        rows = [row for row in result["cases"] if row["what"] == what]
        shows_taxels = any(row["taxels"] for row in rows)
        lines += ["", f"## {what.capitalize()}", "", f"{text}.", ""]
        lines.append(
            "| case |" + (" taxels |" if shows_taxels else "") + " CPU [s] | memory [MB] |"
        )
        lines.append("|---|" + ("---|" if shows_taxels else "") + "---|---|")
        for row in rows:
            taxels = f" {row['taxels']:,.0f} |" if shows_taxels else ""
            lines.append(f"| {row['case']} |{taxels} {row['cpu_s']:.3f} | {row['mb']:.0f} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure and write both files, be a child, or write the page alone."""
    if sys.argv[1:2] == ["--case"]:
        print(json.dumps(_child(*sys.argv[2:4])))
        return
    target: Path | None = RESULTS / "needs.json"
    if "--page" not in sys.argv:
        target = command(measure, __doc__, "needs")
    if target == RESULTS / "needs.json":
        PAGE.write_text(page_of(json.loads(target.read_text(encoding="utf-8"))), encoding="utf-8")


if __name__ == "__main__":
    main()
