"""Time and memory from 1,000 to 1,000,000 taxels, the peers beside us in the same processes.

Each point of a curve is measured in a process of its own, which shows its memory (the largest
resident size above that after the imports and the input). A size that would take longer than its
share of the time, by what the smaller sizes took, is left out and named so.
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
from timing import Times, take_turns

SIZES = (1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
DECADES = (1_000, 10_000, 100_000, 1_000_000)
OF_CURVE = {"histograms": DECADES, "contacts": DECADES, "drawing": DECADES[:3]}
LONGEST = 45.0  # wall time of one point [s]; a longer one is left out
GROWTH = 1.35  # exponent by which the next size is foreseen
TURNS = ((10_000, 5), (100_000, 3))  # up to so many taxels, so many turns; one above
Tasks = dict[str, Callable[[], object]]
AFTER: dict[str, Callable[[], int]] = {}  # flips of a map, counted after it was timed


def measure(quick: bool, *, longest: float = LONGEST) -> dict[str, Any]:
    """Rows of all curves.

    Parameters
    ----------
    quick : bool
        1,000 taxels only.
    longest : float
        Wall time of one point [s].
    """
    rows = []
    for curve in CASES:
        sizes = OF_CURVE.get(curve, SIZES)
        seconds, before = 0.0, 1
        for n in sizes[:1] if quick else sizes:
            foreseen = seconds * (n / before) ** GROWTH
            if foreseen > longest:
                rows.append({"curve": curve, "taxels": n, "peer": False,
                             "left_out": f"would take about {foreseen:.0f} s"})  # fmt: skip
                continue
            found = point(curve, n)
            rows += found
            seconds, before = sum(row.get("wall_s", 0.0) for row in found), n
    return {"curves": rows, "exponents": exponents(rows)}


def point(curve: str, n: int) -> list[dict[str, Any]]:
    """Rows of one curve at one size, one for us and each peer; or what went wrong."""
    command = [sys.executable, str(Path(__file__).resolve()), curve, str(n)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=4 * LONGEST)
    except subprocess.TimeoutExpired:
        return [{"curve": curve, "taxels": n, "peer": False, "left_out": "took too long"}]
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
        return [{"curve": curve, "taxels": n, "peer": False, "left_out": said[:200]}]
    return list(json.loads(done.stdout.splitlines()[-1]))


def exponents(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Slope of log seconds over log taxels of each curve, from 10,000 taxels on."""
    fits = {}
    for name in dict.fromkeys(row["curve"] for row in rows):
        own = [row for row in rows if row["curve"] == name and row.get("cpu_s")]
        points = [(row["taxels"], row["cpu_s"]) for row in own if row["taxels"] >= 9_000]
        if len(points) >= 2:
            fits[name] = float(np.polyfit(*np.log(np.array(points, float)).T, 1)[0])
    return fits


def meshing(n: int) -> tuple[Tasks, Tasks]:
    """A surface mesh over a wavy sheet."""
    from meshing import installed, wavy_skin

    from skinmap.surface.surface_mesh import build_surface

    skin = wavy_skin(n)
    peers = {name: run for name, run in installed().items() if name.startswith("pymeshlab")}
    build_surface(wavy_skin(400))  # compiled code is read now, and is no cost of a mesh
    return (
        {"meshing": lambda: build_surface(skin)},
        {f"meshing, {name}": lambda run=run: run(skin) for name, run in peers.items()},
    )


def flattening(n: int, method: str) -> tuple[Tasks, Tasks]:
    """A flat map of a saddle; libigl's LSCM up to 100,000 vertices, else one factorisation."""
    from saddle import distortion, factor_cases, peer_cases, saddle

    from skinmap.flat.disc_map import map_disc
    from skinmap.geometry.topology import boundary_loops

    vertices, faces = saddle(n)
    loop = boundary_loops(faces)[0]
    map_disc(*saddle(400), method=method)

    def ours() -> None:
        uv = map_disc(vertices, faces, method=method).uv
        # No part of what is timed.
        AFTER[f"flattening, {method}"] = lambda: distortion(vertices, faces, uv)["flips"]

    peer = "libigl LSCM" if n <= 100_000 else "scipy"
    cases: Mapping[str, Any] = (peer_cases if n <= 100_000 else factor_cases)(vertices, faces, loop)
    said = "libigl LSCM" if n <= 100_000 else "one factorisation (SciPy)"
    return (
        {f"flattening, {method}": ours},
        {f"flattening, {said}": cases[peer]} if method == "fast" and peer in cases else {},
    )


def histograms(n: int) -> tuple[Tasks, Tasks]:
    """The histogram of one sample of a tiling of 10-pad boards; k-means a structure beside it."""
    from histogram_speed import k_means
    from structures import tiling

    from skinmap.neighbours.offsets import neighbourhoods
    from skinmap.neighbours.structures import find_structures
    from skinmap.touch.codebook import learn_codebook, patterns
    from skinmap.touch.votes import VoteCounter

    rng = np.random.default_rng(0)
    rows = max(2, round((n / 20) ** 0.5))
    skin = tuple(part[:n] for part in tiling("triangle_10pad", rows, most=n))
    found = find_structures(neighbourhoods(*skin, radius=8e-3), rotations=6)
    samples = 0.05 + 0.95 * rng.random((max(2, 20_000 // n), len(skin[0])))
    book = learn_codebook([(found, samples)], rng=rng)
    counter = VoteCounter(book, found, compiled=True)
    sample, width = samples[0], book.words.shape[2]
    machines = [k_means(words) for words in book.words]

    def peer() -> None:
        for s, machine in enumerate(machines):
            machine.predict(patterns(found, s, sample[None]).reshape(-1, width))

    return (
        {"histogram of a sample": lambda: counter.count_one(sample)},
        {"histogram of a sample, scikit-learn k-means": peer},
    )


def contacts(n: int) -> tuple[Tasks, Tasks]:
    """Contacts of one sample with five touches; SciPy's connected components beside it."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    from skinmap.live.identity import ContactTracker
    from skinmap.live.joined import JoinedSkin
    from skinmap.skin.skin import skin_from_points
    from skinmap.surface.surface_mesh import SurfaceMesh
    from skinmap.touch.prepared import PreparedSkin

    side = round(n**0.5)
    row, column = np.divmod(np.arange(side * side), side)
    points = 6.5e-3 * np.column_stack([column, row, 0 * row]).astype(float)
    skin = skin_from_points(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)))
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    lower = np.column_stack([corner, corner + 1, corner + side])
    upper = np.column_stack([corner + 1, corner + side + 1, corner + side])
    faces = np.concatenate([lower, upper])
    mesh = SurfaceMesh(skin, faces, np.arange(len(points)), np.zeros(len(faces), np.int64))
    joined = JoinedSkin({"sheet": PreparedSkin.of(mesh)})
    tracker = ContactTracker(joined)
    rng = np.random.default_rng(0)
    load = np.zeros(len(points))
    for centre in points[rng.integers(len(points), size=5)]:
        load += 140.0 * np.exp(-((np.linalg.norm(points - centre, axis=1) / 9e-3) ** 2))
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    clock = iter(range(10**9))

    def peer() -> None:
        active = load > 12.0
        a, b = ends[active[ends].all(axis=1)].T
        graph = coo_matrix((np.ones(len(a)), (a, b)), shape=(len(load), len(load)))
        connected_components(graph, directed=False)

    return (
        {"contacts of a sample": lambda: tracker.update(next(clock) / 50.0, load)},
        {"contacts of a sample, SciPy components": peer},
    )


def drawing(n: int) -> tuple[Tasks, Tasks]:
    """A frame at 1024x768 in which all taxels change; spheres by plain PyVista beside it."""
    import pyvista as pv
    from viewer_scenes import SIZE, large_scene

    from viewer.display import require_opengl

    require_opengl()
    scene = large_scene(n)
    rng = np.random.default_rng(0)
    values = {part: rng.uniform(0, 255, (4, len(one.skin))) for part, one in scene.layers.items()}
    turn = iter(range(10**9))

    def ours() -> None:
        number = next(turn) % 4
        for part, pressures in values.items():
            scene.set_pressures(part, pressures[number])
        scene.refresh()

    if n > 10_000:  # spheres would take seconds a frame
        return {"drawing a frame": ours}, {}
    cloud = pv.PolyData(np.concatenate([one.skin.positions for one in scene.layers.values()]))
    cloud["pressure"] = np.zeros(cloud.n_points)
    ball = pv.Sphere(radius=0.002, theta_resolution=8, phi_resolution=8)
    glyphs = cloud.glyph(geom=ball, scale=False, orient=False)
    plotter = pv.Plotter(off_screen=True, window_size=list(SIZE))
    plotter.add_mesh(glyphs, scalars="pressure", clim=(0, 255))
    plotter.show(auto_close=False)
    colours = [np.repeat(255 * rng.random(cloud.n_points), ball.n_points) for _ in range(4)]

    def peer() -> None:
        glyphs["pressure"][:] = colours[next(turn) % 4]
        plotter.render()

    return {"drawing a frame": ours}, {"drawing a frame, plain PyVista": peer}


CASES: dict[str, Callable[[int], tuple[Tasks, Tasks]]] = {
    "meshing": meshing,
    "fast": lambda n: flattening(n, "fast"),
    "balanced": lambda n: flattening(n, "balanced"),
    "histograms": histograms,
    "contacts": contacts,
    "drawing": drawing,
}
BRIEF = ("histograms", "contacts")  # many calls a turn
PREPARED = ("contacts", "drawing", "histograms")  # their memory is that of what is prepared


def child(curve: str, n: int) -> list[dict[str, Any]]:
    """Rows of one point, measured here: ours first, as the largest memory only grows."""
    start = peak_mb()
    ours, peers = CASES[curve](n)
    turns = next((count for most, count in TURNS if n <= most), 1)
    calls = max(1, 200_000 // n) if curve in BRIEF else 3 if curve == "drawing" else 1
    before = start if curve in PREPARED else peak_mb()
    # Long calls are not made only to warm up: their input and their code are warm already.
    warm = int(turns > 1 or curve in (*BRIEF, "drawing"))
    turns = max(turns, 5 if curve in BRIEF else 1)
    times = {}
    if not warm:  # a long call: one of ours, then one of each peer
        times = take_turns(ours, 1, warm=0)
    else:
        for run in ours.values():
            run()
    memory = peak_mb() - before
    tasks = {name: (run, calls) for name, run in ({**ours, **peers} if warm else peers).items()}
    times |= take_turns(tasks, turns, warm=warm)
    rows = []
    for name, one in times.items():
        row = _row(name, n, name in peers, one)
        if name in ours:
            row["peak_mb"] = max(memory, 0.0)
            row |= {"flips": AFTER[name]()} if name in AFTER else {}
        rows.append(row)
    return rows


def _row(name: str, n: int, peer: bool, times: Times) -> dict[str, Any]:
    quartiles = times.row()
    return {
        "curve": name,
        "taxels": n,
        "peer": peer,
        "cpu_s": quartiles["cpu"][1],
        "wall_s": quartiles["wall"][1],
        "spread_s": quartiles["cpu"] if quartiles["turns"] > 1 else None,
        "turns": quartiles["turns"],
    }


def peak_mb() -> float:
    """Largest resident size of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    if len(sys.argv) == 3:
        print(json.dumps(child(sys.argv[1], int(sys.argv[2]))))
    else:
        from record import command

        command(measure, __doc__, "scaling")
