"""What each curve of scaling.py measures at a size: ours, and the peer beside it.

`echo '["meshing", 1000]' | python -m benchmarks.scale.scaling_cases` measures a point in a
process that is forked after the imports.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.harness.forked import peak_mb, serve
from benchmarks.harness.timing import Times, take_turns

PEERS_TO = 100_000  # taxels, beyond which the time is ours alone
TURNS = ((10_000, 5), (30_000, 3))  # up to so many taxels, so many turns; one above
IMPORTS = (
    "benchmarks.classify.histogram_speed", "benchmarks.geometry.meshing",
    "benchmarks.geometry.saddle", "benchmarks.geometry.structures",
    "benchmarks.viewer.viewer_scenes", "igl", "pymeshlab",
    "pyvista.plotting", "scipy.sparse.csgraph", "scipy.spatial", "sklearn.neighbors",
    "skinmap.flat.disc_map", "skinmap.live.contacts.contact_tracker",
    "skinmap.live.robot_skin", "skinmap.touch.votes",
    "viewer.scene",
)  # fmt: skip
WARM = 1_000  # taxels of the warm-up
SLOW_S = 3.0  # CPU time of a first call from which further turns are left out
Tasks = dict[str, Callable[[], object]]
AFTER: dict[str, Callable[[], int]] = {}  # flips of a map, counted after it was timed


def meshing(n: int) -> tuple[Tasks, Tasks]:
    """A surface mesh over a wavy sheet."""
    from benchmarks.geometry.meshing import installed, wavy_skin
    from skinmap.surface.surface_mesh import build_surface

    skin = wavy_skin(n)
    peers = installed() if n <= PEERS_TO else {}
    return (
        {"meshing": lambda: build_surface(skin)},
        {
            f"meshing, {name}": lambda run=run: run(skin)
            for name, run in peers.items()
            if name.startswith("pymeshlab")
        },
    )


def flattening(n: int, method: str) -> tuple[Tasks, Tasks]:
    """A flat map of a saddle; libigl's LSCM beside `fast`."""
    from benchmarks.geometry.saddle import distortion, peer_cases, saddle
    from skinmap.flat.disc_map import map_disc
    from skinmap.geometry.topology import boundary_loops

    vertices, faces = saddle(n)

    def ours() -> None:
        uv = map_disc(vertices, faces, method=method).uv
        # No part of what is timed.
        AFTER[f"flattening, {method}"] = lambda: distortion(vertices, faces, uv)["flips"]

    peers: Tasks = {}
    if method == "fast" and n <= PEERS_TO:
        cases = peer_cases(vertices, faces, boundary_loops(faces)[0])
        peers = {"flattening, libigl LSCM": cases["libigl LSCM"]}
    return {f"flattening, {method}": ours}, peers


def structures(n: int) -> tuple[Tasks, Tasks]:
    """Neighbourhoods of a noisy tiling of 10-pad boards, and the structures among them."""
    from sklearn.neighbors import NearestNeighbors

    from benchmarks.geometry.structures import noisy, tiling
    from skinmap.neighbours.offsets import BAND, neighbourhoods
    from skinmap.neighbours.structures import RADIUS, find_structures

    rows = max(2, round((n / 20) ** 0.5))
    skin = noisy(tiling("triangle_10pad", rows, most=n), 0.1e-3, 0)
    hoods = neighbourhoods(*skin, radius=RADIUS)

    def peer() -> None:
        nearest = NearestNeighbors(radius=RADIUS + BAND).fit(skin[0])
        nearest.radius_neighbors(return_distance=False)

    return (
        {
            "neighbourhoods": lambda: neighbourhoods(*skin, radius=RADIUS),
            "structures": lambda: find_structures(hoods, rotations=6),
        },
        {"neighbourhoods, scikit-learn": peer},
    )


def histograms(n: int) -> tuple[Tasks, Tasks]:
    """The histogram of one sample of a tiling of 10-pad boards; k-means a structure beside it."""
    from benchmarks.classify.histogram_speed import k_means
    from benchmarks.geometry.structures import tiling
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

    from skinmap.live.contacts.contact_tracker import ContactTracker
    from skinmap.live.robot_skin import JoinedSkin
    from skinmap.skin.skin import skin_from_points
    from skinmap.surface.surface_mesh import SurfaceMesh
    from skinmap.touch.prepared_skin import PreparedSkin

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

    from benchmarks.viewer.viewer_scenes import SIZE, large_scene
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
    "structures": structures,
    "histograms": histograms,
    "contacts": contacts,
    "drawing": drawing,
}
BRIEF = ("histograms", "contacts")  # many calls a turn
PREPARED = ("contacts", "drawing", "histograms")  # their memory is that of what is prepared


def child(curve: str, n: int) -> dict[str, Any]:
    """`rows` of one point; ours come first, as the largest memory only grows."""
    for run in CASES[curve](WARM)[0].values():  # imports and compiled code are no cost of a size
        run()
    fixed = time.process_time()
    start = peak_mb()
    ours, peers = CASES[curve](n)
    before = start if curve in PREPARED else peak_mb()
    first, memory = {}, {}
    for name, run in ours.items():
        first |= take_turns({name: run}, 1, warm=0)
        memory[name] = max(peak_mb() - before, 0.0)
        before = max(before, peak_mb())
    slow = max(sum(one.cpu) for one in first.values()) > SLOW_S
    turns = 1 if slow else turns_at(n)
    calls = max(1, 200_000 // n) if curve in BRIEF else 3 if curve == "drawing" and not slow else 1
    tasks = {name: (run, calls) for name, run in ({} if slow else ours).items()}
    tasks |= {name: (run, calls if curve in BRIEF else 1) for name, run in peers.items()}
    times = first | take_turns(tasks, turns, warm=warm_at(n))
    rows = [_row(name, n, name in peers, one) for name, one in times.items()]
    for row in rows[: len(ours)]:
        name = row["curve"]
        row["peak_mb"] = memory[name]
        row |= {"flips": AFTER[name]()} if name in AFTER else {}
    return {"rows": rows, "fixed_cpu_s": fixed}


def turns_at(n: int) -> int:
    """Turns of a size, the first call apart."""
    return next((count for most, count in TURNS if n <= most), 1)


def warm_at(n: int) -> int:
    """Calls before the turns."""
    return int(n <= TURNS[-1][0])


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


if __name__ == "__main__":
    serve(IMPORTS, child)
