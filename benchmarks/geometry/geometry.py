"""Surface meshes, flat maps and contact images, with the peers in one run: `make bench-geometry`.

Writes benchmarks/results/geometry.json. CPU time of one thread; C is one sparse Cholesky (or LDL or
LU) factorisation of the same mesh's cotangent Laplacian by the fastest solver installed, measured
in turns with everything else. `--quick` takes 1,000 vertices only and leaves out what takes long.
"""

from __future__ import annotations

import importlib.util
import math
import resource
import sys
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from scipy.interpolate import LinearNDInterpolator

import skinmap
from benchmarks.harness.record import afresh, command
from benchmarks.harness.timing import (
    medians,
    quartiles,
    ratio_quartiles,
    spreads,
    take_turns,
    timed,
)
from skinmap.flat.disc import Disc, factorise
from skinmap.flat.distortion import measure_distortion
from skinmap.flat.flat_map import FlatMap, flatten
from skinmap.flat.methods import map_disc
from skinmap.geometry.topology import boundary_loops
from skinmap.skin.cover import measure_fit
from skinmap.skin.skin import Skin, skin_from_points
from skinmap.surface.surface_mesh import build_surface
from skinmap.touch.images.contact_image import image_geometry

# Flattening a saddle: our methods and the peers in turns, in multiples of one factorisation.
#
# `flattening_rows` gives one row a method and size; `large_rows` runs a mesh of a million vertices
# in a process of its own, which shows its memory. CPU time of one thread throughout.

OURS = ("fast", "balanced", "dirichlet")
TURNS = {1_000: 9, 3_000: 7, 10_000: 5}
ONCE_FROM = 30_000  # vertices: peers that take more than 5 C run once from here on
SLOW = ("libigl LSCM", "libigl SLIM-2 from BFF")


def saddle(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (about n, 3) and faces of z = (x^2 - y^2) / 2 over the square of side 2."""
    side = round(n**0.5)
    row, column = np.divmod(np.arange(side * side), side)
    x, y = 2.0 * column / (side - 1) - 1.0, 2.0 * row / (side - 1) - 1.0
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    lower = np.column_stack([corner, corner + 1, corner + side])
    upper = np.column_stack([corner + 1, corner + side + 1, corner + side])
    return np.column_stack([x, y, 0.5 * (x * x - y * y)]), np.concatenate([lower, upper])


def flattening_rows(n: int) -> list[dict[str, Any]]:
    """One row a method at a size: CPU seconds, multiples of C, flips and distortion."""
    vertices, faces = saddle(n)
    loop = boundary_loops(faces)[0]
    factors = factor_cases(vertices, faces, loop)
    methods: dict[str, Callable[[], np.ndarray]] = {
        name: lambda name=name: map_disc(vertices, faces, method=name).uv for name in OURS
    }
    methods |= peer_cases(vertices, faces, loop)
    times: dict[str, list[float]] = {name: [] for name in (*factors, *methods)}
    results = {}
    for repeat in range(TURNS.get(n, 3)):
        for name, run in {**factors, **methods}.items():
            if not repeat or n < ONCE_FROM or name not in SLOW:
                results[name], seconds, _ = timed(run)
                times[name].append(seconds)
    fastest = min(factors, key=lambda name: median(times[name]))
    rows: list[dict[str, Any]] = []
    for name, seconds in times.items():
        row: dict[str, Any] = {"n": n, "seconds": median(seconds)}
        if name in factors:
            rows.append({**row, "solver": name, "is_C": name == fastest})
            continue
        # Of the same turns: a busy machine slows both.
        ratios = quartiles(np.array(seconds) / np.array(times[fastest][: len(seconds)]))
        rows.append({**row, "method": name, "C": ratios[1], "C_quartiles": ratios,
                     **distortion(vertices, faces, results[name])})  # fmt: skip
    return rows


def distortion(vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray) -> dict[str, Any]:
    """Flips, symmetric Dirichlet energy and edge error of a map."""
    measured = measure_distortion(vertices, faces, uv)
    energy = float(np.average(measured.symmetric_dirichlet, weights=measured.face_areas))
    return {
        "flips": measured.flips,
        "symmetric_dirichlet": energy if np.isfinite(energy) else None,
        "edge_rms_percent": 100.0 * measured.edge_rms,
    }


def factor_cases(
    vertices: np.ndarray, faces: np.ndarray, loop: np.ndarray
) -> dict[str, Callable[[], object]]:
    """Factorisations of the cotangent Laplacian with one vertex held, by solver."""
    import igl

    matrix = Disc(vertices, faces, loop).laplacian[1:, 1:].tocsc()
    full = Disc(vertices, faces, loop).laplacian.tocsc()

    def eigen() -> object:
        data = igl.min_quad_with_fixed_data()
        igl.min_quad_with_fixed_precompute(full, np.array([0]), pd=True, data=data)
        return data

    return {"scipy": lambda: factorise(matrix), "Eigen (libigl)": eigen}


def peer_cases(
    vertices: np.ndarray, faces: np.ndarray, loop: np.ndarray
) -> dict[str, Callable[[], np.ndarray]]:
    """The libraries' own methods, each with all that it needs, from our BFF where it needs one."""
    import igl

    def start() -> np.ndarray:
        return Disc(vertices, faces, loop).conformal

    def lscm() -> np.ndarray:
        ends = np.array([loop[0], loop[len(loop) // 2]])
        return np.asarray(igl.lscm(vertices, faces, ends, np.array([[0.0, 0], [2.0, 0]]))[0])

    def arap() -> np.ndarray:
        first, data = start(), igl.ARAPData()
        data.max_iter = 10
        igl.arap_precomputation(vertices, faces, 2, np.array([0], np.int32), data)
        return np.asarray(igl.arap_solve(first[[0]], data, first))

    def slim(steps: int) -> np.ndarray:
        column, energy = np.asfortranarray, igl.MappingEnergyType.SYMMETRIC_DIRICHLET
        none = np.zeros(0, np.int32), np.zeros((0, 2), order="F")
        mesh = column(vertices), column(faces.astype(np.int32)), column(start())
        return np.asarray(igl.slim_solve(igl.slim_precompute(*mesh, energy, *none, 0.0), steps))

    return {
        "libigl LSCM": lscm,
        "libigl ARAP-10 from BFF": arap,
        "libigl SLIM-2 from BFF": lambda: slim(2),
    }


def large_rows(n: int) -> list[dict[str, Any]]:
    """Our methods on a large saddle, each once, then the factorisation.

    In a process of its own, which shows its memory.
    """
    vertices, faces = saddle(n)
    rows = []
    for name in OURS:
        flat, seconds, _ = timed(lambda name=name: map_disc(vertices, faces, method=name))
        # The largest so far: of the method that runs first, its own.
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        rows.append({"n": len(vertices), "method": name, "seconds": seconds, "peak_gb": peak,
                     **distortion(vertices, faces, flat.uv)})  # fmt: skip
        print(rows[-1], file=sys.stderr, flush=True)
    matrix = Disc(vertices, faces, boundary_loops(faces)[0]).laplacian[1:, 1:].tocsc()
    _, unit, _ = timed(lambda: factorise(matrix))
    factor = {"n": len(vertices), "solver": "scipy", "seconds": unit, "is_C": True}
    return [*(row | {"C": row["seconds"] / unit} for row in rows), factor]


REPEATS = 3
PITCH = 6.5e-3  # m, as on the iCub


def wavy_skin(n: int) -> Skin:
    """About n taxels on a wavy sheet: hexagons, each off its place by a twentieth of the pitch."""
    rng = np.random.default_rng(0)
    side = round(np.sqrt(n))
    row, column = np.divmod(np.arange(side * side), side)
    x, y = column + 0.5 * (row % 2), row * np.sqrt(3) / 2
    points = np.column_stack([x, y, 2.0 * np.sin(0.2 * x)]) + 0.05 * rng.normal(size=(len(x), 3))
    normals = np.column_stack([-0.4 * np.cos(0.2 * x), 0 * x, 1 + 0 * x])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return skin_from_points(PITCH * points, normals)


def pymeshlab_pivoting(skin: Skin) -> np.ndarray:
    """Ball pivoting of MeshLab with the radius of its choice."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(skin.positions, v_normals_matrix=skin.normals))
    meshes.generate_surface_reconstruction_ball_pivoting()
    return meshes.current_mesh().face_matrix().astype(np.int64)


def meshing_rows(sizes: tuple[int, ...]) -> list[dict[str, Any]]:
    """One row for each size and method, methods interleaved; the peer where it is installed."""
    methods: dict[str, Callable[[Skin], object]] = {"consensus": build_surface}
    if importlib.util.find_spec("pymeshlab"):
        methods["pymeshlab ball pivoting"] = pymeshlab_pivoting
    rows = []
    for size in sizes:
        skin = wavy_skin(size)
        tasks = {name: partial(mesher, skin) for name, mesher in methods.items()}
        for name, times in take_turns(tasks, REPEATS).items():
            spread = quartiles(times)
            rows.append({"method": name, "n": len(skin), "cpu_s": spread[1], "quartiles_s": spread})
    return rows


CYSKIN = Path(__file__).resolve().parents[3] / "shared" / "data" / "cyskin" / "ur10e"
SIZES = (1_000, 3_000, 10_000, 30_000, 100_000)
LARGE = 1_000_000
BATCH = 64
ROUNDS = 7
CASES = ((768, (66, 100), 400), (10_000, (512, 512), 20))


def measure(quick: bool, *, sizes: tuple[int, ...] = SIZES, large: int = LARGE) -> dict[str, Any]:
    """Rows of flattening, meshing and contact images, and what follows from them.

    Parameters
    ----------
    quick : bool
        1,000 vertices only, no contact images.
    sizes : tuple of int
        Vertices of the flattened meshes.
    large : int
        Vertices of the mesh that shows its memory; 0 leaves it out.
    """
    rows = [row for n in ((1_000,) if quick else sizes) for row in flattening_rows(n)]
    if large and not quick:
        rows += afresh(large_rows, large)
    result: dict[str, Any] = {
        "flattening": rows,
        "icub": icub_row(repeats=1 if quick else 5),
        "ur10e": ur10e_row(),
        "meshing": meshing_rows((1_000,) if quick else (1_000, 10_000)),
    }
    return result if quick else result | {"contact_images": contact_image_rows()}


def icub_row(repeats: int) -> dict[str, Any]:
    """All parts of the iCub meshed and flattened, warm."""
    robot = skinmap.load_robot("icub")
    skins = [robot.skin(part) for part in robot.parts]
    times = []
    for _ in range(repeats + 1):  # the first warms up
        meshes, meshed, _ = timed(lambda: [build_surface(skin) for skin in skins])
        maps, flattened, _ = timed(lambda meshes=meshes: [flatten(mesh) for mesh in meshes])
        times.append((meshed, flattened))
    meshing, flattening = np.median(times[1:], axis=0)
    fits = [measure_fit(skin, robot.mesh(skin.link)) for skin in skins]
    angles = np.degrees(np.concatenate([fit.normal_angle for fit in fits]))  # sign aside
    return {
        **flat_figures(maps),
        "meshing_seconds": float(meshing),
        "flattening_seconds": float(flattening),
        "seconds": float(np.median(np.sum(times[1:], axis=1))),
        "seconds_quartiles": quartiles(np.sum(times[1:], axis=1)),
        "taxels": len(angles),
        "normals_deg_median": float(np.median(angles)),
        "normals_within_15_deg_percent": 100.0 * float((angles <= 15.0).mean()),
    }


def flat_figures(maps: list[FlatMap]) -> dict[str, Any]:
    """Patches, flips and edge errors of the flat maps of a robot."""
    errors = [100.0 * chart.distortion.edge_rms for flat in maps for chart in flat.charts]
    return {
        "patches": len(errors),
        "flips": sum(flat.flips for flat in maps),
        "edge_rms_percent": {"median": float(np.median(errors)), "worst": max(errors)},
    }


def ur10e_row() -> dict[str, Any]:
    """The second real skin on our meshes and, where its laboratory's files are, on theirs."""
    robot = skinmap.load_robot("ur10e-cyskin")
    meshes = [build_surface(robot.skin(part)) for part in robot.parts]
    found = flat_figures([flatten(mesh) for mesh in meshes])
    return {
        **found,
        "edge_rms_percent": found["edge_rms_percent"]["worst"],
        "taxels": sum(len(np.unique(mesh.faces)) for mesh in meshes),
        "theirs": [theirs_row(path) for path in sorted(CYSKIN.glob("ur10e_*_patch1.json"))],
    }


def theirs_row(path: Path) -> dict[str, Any]:
    """Our edge error on the mesh of a CySkin file, and that of the best map that came with it."""
    from skinmap.cli.flatten import work

    found, _ = work([str(path)], compare="theirs")
    return {
        "file": path.name,
        "ours_percent": max(one.edge_rms_percent for one in found.patches),
        "theirs_percent": min(one.edge_rms_percent or math.inf for one in found.compare),
    }


def lattice(n: int, aspect: float) -> Skin:
    """N taxels of 8 mm pitch, hexagonal, round most of a cylinder; `aspect` as wide as high."""
    columns = round((n * aspect * np.sqrt(3) / 2) ** 0.5)
    row, column = np.divmod(np.arange(n), columns)
    across, along = 8e-3 * (column + 0.5 * (row % 2)), 8e-3 * row * np.sqrt(3) / 2
    radius = across.max() / (1.6 * np.pi)  # open at the back, its axis longer than its width
    angle = across / radius
    normals = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    positions = normals * radius + np.column_stack([np.zeros((n, 2)), along])
    return skin_from_points(positions, normals, part="lattice")


def compare(flat: FlatMap, shape: tuple[int, int], repeats: int) -> dict[str, object]:
    """One row: ours and the peers on one map and one grid."""
    rng = np.random.default_rng(0)
    geometry = image_geometry(flat, shape=shape)
    samples = rng.random((BATCH, len(geometry)), np.float32)
    sample = samples[0]
    values = samples.T.copy()
    rows, columns = geometry.shape
    x, y = np.meshgrid(
        geometry.corner[0] + geometry.pitch * (np.arange(columns) + 0.5),
        geometry.corner[1] - geometry.pitch * (np.arange(rows) + 0.5),
    )
    centres = np.column_stack([x.ravel(), y.ravel()])
    triangulation = LinearNDInterpolator(flat.uv, sample).tri
    # What one image must move: the stored geometry, the pressures and the image. Copying reads and
    # writes: the rate at which memory of this size can be moved at best.
    stored = (geometry.pixels, geometry.columns, geometry.weights)
    moved = sum(one.nbytes for one in stored) + 4 * len(geometry) + 4 * geometry.mask.size
    source = np.ones(moved // 8, np.float32)
    target = np.empty_like(source)
    few = max(1, repeats // 20)
    turns = take_turns(
        {
            "image": (lambda: geometry.image(sample), repeats),
            "copy": (lambda: np.copyto(target, source), repeats),
            "batch": (lambda: geometry.images(samples), few),
            "csr_batch": (lambda: geometry.single @ values, few),
            "peer_reused": (
                lambda: LinearNDInterpolator(triangulation, sample, fill_value=0.0)(centres),
                few,
            ),
        },
        ROUNDS,
    )
    times = medians(turns, 1e6)
    ratios = ratio_quartiles(turns, {"times_bandwidth_bound": ("image", "copy")})
    return {
        "taxels": len(geometry),
        "shape": list(geometry.shape),
        "quartiles_us": spreads(turns, 1e6),
        "image_us": times["image"],
        "batch_us_per_sample": times["batch"] / BATCH,
        "csr_batch_us_per_sample": times["csr_batch"] / BATCH,
        "times_bandwidth_bound": ratios["times_bandwidth_bound"][1],
        "ratio_quartiles": ratios,
        "batch_quartiles_us_per_sample": spreads(turns, 1e6 / BATCH)["batch"],
        "scipy_reused_us": times["peer_reused"],
    }


def contact_image_rows() -> list[dict[str, object]]:
    """66 x 100 from 768 taxels, 512 x 512 from 10,000."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return [
            compare(flatten(build_surface(lattice(n, shape[1] / shape[0]))), shape, repeats)
            for n, shape, repeats in CASES
        ]


if __name__ == "__main__":
    command(measure, __doc__, "geometry")
