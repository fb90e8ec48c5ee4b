"""What is asked for, and what it costs: time and memory by parts and taxels.

Each case runs in a process of its own, forked from one that has only imported, so that no case
helps the next; the cases take turns. Memory is the largest resident size above that before the
case. Writes benchmarks/results/needs.json, and docs/needs.md from it.
"""

from __future__ import annotations

import ctypes
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from benchmarks import ROOT
from benchmarks.harness.record import RESULTS, afresh, command, table
from benchmarks.harness.timing import peak_mb, quartiles, timed

TURNS = 5
SIZE = (1024, 768)  # of a picture [px]
POPULATE_READ = 22  # MADV_POPULATE_READ of Linux's asm-generic/mman-common.h
# What cases import: in no case's figures.
IMPORTS = (
    "icub_models", "igl", "scipy.sparse.csgraph", "scipy.spatial", "trimesh", "lxml.etree",
    "benchmarks.geometry.geometry", "skinmap.flat.flat_map", "skinmap.io.robots.manifest",
    "skinmap.touch.prepared_skin", "pyvista.plotting", "viewer.scene",
)  # fmt: skip
PARTS, TAXELS = (1, 3, 13), (1_000, 3_000, 10_000, 30_000)
# What is measured, its cases, and its words in the page.
WHATS: dict[str, tuple[tuple[int, ...], str]] = {
    "parts loaded": (PARTS, "Taxels, normals and links of so many parts of the iCub"),
    "parts prepared": (PARTS, "The same with surface meshes and flat maps"),
    "parts shown": (PARTS, "The same in a scene, on the links that carry them; first picture"),
    "taxels": (TAXELS, "One sheet of so many taxels, meshed and flattened"),
}
PAGE = ROOT / "docs" / "needs.md"
RESULT = RESULTS / "needs.json"
HEADS = ("case", "taxels", "CPU [s]", "quartiles", "memory [MB]")
HEAD = """# Only what a scene needs

Time and memory grow with what is asked for, and nothing else is loaded, meshed, flattened or
trained (`tests/test_one_part.py` holds that for one part of a robot). Written by
`make bench-needs` from `benchmarks/results/needs.json`: commit {commit}, {cores} cores of
{processor}, load average {load};
{turns} fresh processes a case, medians of CPU time of one thread with their quartiles; memory is
the largest resident size above that after the imports ({imports:.0f} MB with all pages of the
libraries mapped). A first picture pays about 130 MB for the renderer itself.
"""


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
        for case in (every[:: len(every) - 1] if quick else every)
    ]
    runs: dict[tuple[str, int], list[dict[str, float]]] = {key: [] for key in cases}
    for _ in range(1 if quick else turns):
        for key in cases:
            runs[key].append(apart(*key))
    return {"cases": [_row(*key, found) for key, found in runs.items()]}


def apart(what: str, case: int) -> dict[str, float]:
    """Time and memory of one case, from a process of its own."""
    found: dict[str, float] = afresh(measured, what, case, preload=IMPORTS)
    return found


def measured(what: str, case: int) -> dict[str, float]:
    """Time and memory of one case, in this process."""
    map_libraries()
    imports = peak_mb()
    run = MAKE[what](case)
    before = peak_mb()
    taxels, cpu, _ = timed(run)
    mb = max(peak_mb() - before, 0.0)
    return {"taxels": taxels, "cpu_s": cpu, "mb": mb, "imports_mb": imports}


def map_libraries() -> None:
    """Map all pages of the libraries in use (Linux 5.14; elsewhere their pages count as memory).

    A forked process maps them anew as it runs through them: no memory that a case needs.
    """
    madvise = ctypes.CDLL(None).madvise
    madvise.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
    for line in Path("/proc/self/maps").read_text(encoding="utf-8").splitlines():
        fields = line.split()
        if len(fields) > 5 and fields[1].startswith("r") and fields[5].startswith("/"):
            first, last = (int(one, 16) for one in fields[0].split("-"))
            madvise(first, last - first, POPULATE_READ)


def _row(what: str, case: int, runs: list[dict[str, float]]) -> dict[str, Any]:
    table = {key: quartiles([run[key] for run in runs]) for key in runs[0]}
    return {
        "what": what,
        "case": str(case),
        "taxels": runs[0]["taxels"],
        **{key: table[key][1] for key in ("cpu_s", "mb", "imports_mb")},
        "spread_s": table["cpu_s"] if len(runs) > 1 else None,
        "turns": len(runs),
    }


def _loaded(case: int) -> Callable[[], int]:
    import skinmap

    def run() -> int:
        robot = skinmap.load_robot("icub")
        return sum(len(robot.skin(part)) for part in robot.parts[-case:])

    return run


def _prepared(case: int) -> Callable[[], int]:
    import skinmap
    from skinmap.touch.prepared_skin import PreparedSkin

    def run() -> int:
        robot = skinmap.load_robot("icub")
        skins = [PreparedSkin(robot.skin(part)) for part in robot.parts[-case:]]
        return sum(len(skin.flat.mesh.skin) for skin in skins)  # meshed and flattened on the way

    return run


def _shown(case: int) -> Callable[[], int]:
    import skinmap
    from skinmap.display import require_opengl
    from viewer.scene import Scene

    require_opengl()

    def run() -> int:
        robot = skinmap.load_robot("icub")
        scene = Scene.load(robot, list(robot.parts[-case:]), links="skin", window_size=SIZE)
        scene.refresh(360.0)
        return sum(len(one.skin) for one in scene.layers.values())

    return run


def _sheet(case: int) -> Callable[[], int]:
    from benchmarks.geometry.geometry import wavy_skin
    from skinmap.touch.prepared_skin import PreparedSkin

    skin = wavy_skin(case)
    PreparedSkin(wavy_skin(400)).flat  # noqa: B018  (compiled code is read now)
    return lambda: len(PreparedSkin(skin).flat.uv)


MAKE: Mapping[str, Callable[[int], Callable[[], int]]] = {
    "parts loaded": _loaded,
    "parts prepared": _prepared,
    "parts shown": _shown,
    "taxels": _sheet,
}


def page_of(result: Mapping[str, Any]) -> str:
    """The page as Markdown: a table for each question."""
    machine, cases = result["machine"], result["cases"]
    lines = [
        HEAD.format(
            commit=result["commit"], cores=machine["cores"], processor=machine["processor"],
            load=machine["load_average"], turns=cases[0]["turns"],
            imports=max(row["imports_mb"] for row in cases),
        )
    ]  # fmt: skip
    for what, (_, text) in WHATS.items():
        rows = [_cells(row) for row in cases if row["what"] == what]
        lines += [f"## {what.capitalize()}", "", f"{text}.", "", *table(HEADS, rows), ""]
    return "\n".join(lines)


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    spread = " to ".join(f"{one:.3f}" for one in (row["spread_s"] or ())[::2])
    return (
        row["case"], f"{row['taxels']:,.0f}", f"{row['cpu_s']:.3f}", spread, f"{row['mb']:.0f}"
    )  # fmt: skip


def write_page() -> None:
    """Write docs/needs.md from the kept rows."""
    PAGE.write_text(page_of(json.loads(RESULT.read_text(encoding="utf-8"))), encoding="utf-8")


if __name__ == "__main__":
    if command(measure, __doc__, "needs") == RESULT:
        write_page()
