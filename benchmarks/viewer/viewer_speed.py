"""CPU time, start-up and memory of the viewer, the plain PyVista way in turns: `make bench-viewer`.

Writes benchmarks/results/viewer.json. CPU time of the process per frame at 1024x768, pictures
not read back. `--quick` takes few rounds and leaves out what takes long; `--soak N` shows N
updates. The long soak of 200,000 is `make soak`.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import ROOT
from benchmarks.harness.record import RESULTS
from benchmarks.viewer.viewer_scenes import SIZE, empty_window, large_scene, plain_pyvista
from benchmarks.viewer.viewer_soak import ages, moments, soak

LIBRARIES = ("numpy", "vtk", "pyvista", "scipy")
PLAIN, FLOOR = "plain PyVista", "floor: empty window"
Frame = Callable[[int], object]
CHILD = """
import json, resource, sys, time
def memory(): return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
from viewer.display import require_opengl
require_opengl()
import skinmap, skinmap.io.robots.manifest, skinmap.flat.flat_map, skinmap.surface.surface_mesh
import lxml.etree, trimesh, igl, icub_models, pyvista.plotting
from viewer.scene import Scene
imported, before = time.process_time(), memory()
wall, links = time.perf_counter(), sys.argv[2]
parts = None if sys.argv[1] == "all" else [sys.argv[1]]
scene = Scene.load("icub", parts, links=links, window_size=(1024, 768))
scene.refresh(360.0)
print(json.dumps({"imports_s": imported, "first_picture_s": time.process_time() - imported,
    "first_picture_wall_s": time.perf_counter() - wall, "memory_mb": memory() - before}))
"""


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few rounds, no 100,000 taxels")
    parser.add_argument("--soak", type=int, help="updates to show; 5,000, or 2,000 with --quick")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the results")
    options = parser.parse_args()
    from viewer.display import require_opengl

    require_opengl()
    started = time.perf_counter()
    repeats = 1 if options.quick else 3
    result: dict[str, Any] = {"commit": _commit(), "versions": _versions(), "size_px": SIZE}
    result["first_picture"] = [
        first_picture(parts, links, repeats)
        for parts, links in (("all", "all"), ("torso", "all"), ("torso", "skin"))
    ]
    result["help_s"] = help_seconds(repeats)
    print(f"first pictures after {time.perf_counter() - started:.0f} s", flush=True)
    result["frames"] = frame_rows(options.quick)
    print(f"frames after {time.perf_counter() - started:.0f} s", flush=True)
    scene = _icub(["torso"], (320, 240))
    updates = options.soak or (2_000 if options.quick else 5_000)
    result["soak"] = soak(scene, updates, lambda line: print(line, flush=True))
    scene.close()
    result["ages_at_50_hz"] = ages(_icub(None, SIZE))
    result["ages_at_50_hz_turning"] = ages(_icub(None, SIZE), turn=1.0)
    result["web"] = web_rows()
    result["load_average"] = os.getloadavg()[0]
    result["minutes"] = (time.perf_counter() - started) / 60.0
    result["goals"] = goals(result)
    options.out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(result, indent=1, allow_nan=False)
    (options.out / "viewer.json").write_text(text + "\n", encoding="utf-8")
    for goal in result["goals"]:
        print(f"{'met   ' if goal['met'] else 'MISSED'} {goal['what']}: "
              f"{goal['reached']:.4g}, asked {goal['asked']:.4g}")  # fmt: skip


def first_picture(parts: str, links: str, repeats: int) -> dict[str, Any]:
    """Medians over fresh processes; nothing is kept from one to the next."""
    runs = []
    for _ in range(repeats):
        child = [sys.executable, "-c", CHILD, parts, links]
        done = subprocess.run(child, capture_output=True, text=True, check=True)
        runs.append(json.loads(done.stdout.splitlines()[-1]))
    row = {key: float(np.median([run[key] for run in runs])) for key in runs[0]}
    return {"parts": parts, "links": links, **row, "runs": runs}


def help_seconds(repeats: int) -> float:
    """CPU time of `skinmap view --help`, Python's own start included."""
    command = [str(Path(sys.executable).with_name("skinmap")), "view", "--help"]
    times = []
    for _ in range(repeats):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, capture_output=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return float(np.median(times))


def frame_rows(quick: bool) -> list[dict[str, Any]]:
    """CPU time of a frame of each kind; all of a robot, and all of large skins, take turns.

    Large skins are drawn after the robot: windows that nobody has beside it would empty its caches.
    """
    rounds, repeats = (3, 5) if quick else (7, 8)
    scene = _icub(None, SIZE)
    skins = {part: layer.skin for part, layer in scene.layers.items()}
    kinds: dict[str, Frame] = {
        FLOOR: empty_window(),
        PLAIN: plain_pyvista(scene.robot, skins),
        "iCub at rest, all taxels change": changing(scene),
        "iCub at rest, three of 13 parts change": changing(scene, list(skins)[3:6]),
        "iCub at rest, the part of the flat map changes": changing(scene, ["torso"]),
        "iCub at rest, one touch": touching(scene),
        "iCub at rest, nothing changes": lambda _: scene.refresh(),
        "iCub moving, all taxels change": moving(scene),
    }
    rows = cpu_ms(kinds, rounds, repeats)
    scene.close()
    return rows + ([] if quick else large_rows(rounds, repeats))


def large_rows(rounds: int, repeats: int) -> list[dict[str, Any]]:
    """The same of planted skins of 20,000 and 100,000 taxels, with the floor of then."""
    scenes: list[Any] = []
    kinds: dict[str, Frame] = {f"{FLOOR}, beside large skins": empty_window()}
    for n in (20_000, 100_000):
        scenes += [large_scene(n), large_scene(n, panel=True)]
        kinds[f"{n:,} taxels at rest, all change"] = changing(scenes[-2])
        kinds[f"{n:,} taxels at rest, all change, flat map beside"] = changing(scenes[-1])
    rows = cpu_ms(kinds, rounds, repeats)
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


def cpu_ms(kinds: dict[str, Frame], rounds: int, repeats: int) -> list[dict[str, Any]]:
    """Median and quartiles over rounds in which all kinds take turns."""
    times: dict[str, list[float]] = {name: [] for name in kinds}
    number = 0
    for _ in range(rounds):
        for name, draw in kinds.items():
            few = name == PLAIN  # half a second each
            for _ in range(1 if few else 3):  # what the kind before left is not its own cost
                number += 1
                draw(number)
            count = 2 if few else repeats
            started = time.process_time()
            for _ in range(count):
                number += 1
                draw(number)
            times[name].append((time.process_time() - started) / count * 1e3)
    rows = []
    for name, values in times.items():
        low, middle, high = np.quantile(values, [0.25, 0.5, 0.75]).tolist()
        rows.append({"what": name, "cpu_ms": middle, "quartiles": (low, high)})
        print(f"{name}: {middle:.2f} ms ({low:.2f} to {high:.2f})")
    return rows


def web_rows() -> Any:
    """Figures of the page in the browser, where what its benchmark needs is there.

    One short opening without its peers: `benchmarks/viewer/viewer_web.py` takes its time.
    """
    try:
        page: Any = import_module("benchmarks.viewer.viewer_web")
        page.WAYS = ()
        return page.measure(True)
    except ModuleNotFoundError as error:
        return f"not measured: {error}"


def goals(result: dict[str, Any]) -> list[dict[str, Any]]:
    """What was asked for beside what was reached; only what this run measured."""
    frames = {row["what"]: row["cpu_ms"] for row in result["frames"]}
    asked = [
        ("iCub at rest, three of 13 parts change", 10.0),
        ("iCub at rest, all taxels change", 10.0),
        ("iCub at rest, one touch", 10.0),
        ("iCub moving, all taxels change", 25.0),
        ("20,000 taxels at rest, all change", 40.0),
        ("100,000 taxels at rest, all change", 90.0),
        ("20,000 taxels at rest, all change, flat map beside", 40.0),
        ("100,000 taxels at rest, all change, flat map beside", 90.0),
    ]
    rows = [(f"{name} [ms]", frames[name], most) for name, most in asked if name in frames]
    first = {(row["parts"], row["links"]): row for row in result["first_picture"]}
    rows += [
        ("first picture, whole robot [s]", first["all", "all"]["first_picture_s"], 3.0),
        ("first picture, one part [s]", first["torso", "skin"]["first_picture_s"], 1.5),
        ("first picture, one part on the whole body [s]",
         first["torso", "all"]["first_picture_s"], 1.5),
        ("--help [s]", result["help_s"], 0.3),
        (f"memory grown in {result['soak']['updates']:,} updates [MB]",
         result["soak"]["grown_mb"], 20.0),
    ]  # fmt: skip
    for key, how in (("ages_at_50_hz", ""), ("ages_at_50_hz_turning", ", the camera turning")):
        if "worst_ms" in result[key]:
            what = f"oldest frame shown as live at 50 Hz{how} [ms]"
            rows.append((what, result[key]["worst_ms"], 100.0))
    found = [
        {"what": what, "reached": reached, "asked": most, "met": bool(reached <= most)}
        for what, reached, most in rows
    ]
    return found + web_goals(result["web"])


def web_goals(web: Any) -> list[dict[str, Any]]:
    """The same of the page, where there is a browser; updates a second are to be above."""
    if isinstance(web, str) or web["chromium"] is None:
        return []
    page = web["three touches"]["ours"]
    rows = [("page complete", "complete_s", 4.0), ("bytes of a sample", "bytes_per_sample", 2e4)]
    found = [
        {"what": what, "reached": page[key], "asked": most, "met": bool(page[key] <= most)}
        for what, key, most in rows
    ]
    rate = page["drawn_per_s"]
    what = "drawn updates a second in the browser"
    return [*found, {"what": what, "reached": rate, "asked": 20.0, "met": bool(rate >= 20.0)}]


def _icub(parts: list[str] | None, size: tuple[int, int]) -> Any:
    from viewer.scene import Scene

    return Scene.load("icub", parts, window_size=size, camera="still")


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version(), "machine": platform.machine()}
    return found | {name: version(name) for name in LIBRARIES}


def _commit() -> str:
    command = ["git", "-C", str(ROOT), "describe", "--always", "--dirty"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    return run.stdout.strip() or "unknown"


if __name__ == "__main__":
    main()
