"""Flattening a saddle: our methods and the peers in turns, in multiples of one factorisation.

`flattening_rows` gives one row a method and size; `large_rows` runs a mesh of a million vertices
in a process of its own, which shows its memory. CPU time of one thread throughout.
"""

from __future__ import annotations

import resource
import sys
from collections.abc import Callable
from statistics import median
from typing import Any

import numpy as np

from benchmarks.harness.record import afresh
from benchmarks.harness.timing import quartiles, timed
from skinmap.flat.disc import Disc, factorise
from skinmap.flat.disc_map import map_disc
from skinmap.flat.distortion import measure_distortion
from skinmap.geometry.topology import boundary_loops

OURS = ("fast", "balanced", "dirichlet")
REPEATS = {1_000: 9, 3_000: 7, 10_000: 5}
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


def flattening_rows(sizes: tuple[int, ...]) -> list[dict[str, Any]]:
    """One row a method and size: CPU seconds, multiples of C, flips and distortion."""
    return [row for n in sizes for row in _rows_of_size(n)]


def _rows_of_size(n: int) -> list[dict[str, Any]]:
    vertices, faces = saddle(n)
    loop = boundary_loops(faces)[0]
    factors = factor_cases(vertices, faces, loop)
    methods: dict[str, Callable[[], np.ndarray]] = {
        name: lambda name=name: map_disc(vertices, faces, method=name).uv for name in OURS
    }
    methods |= peer_cases(vertices, faces, loop)
    times: dict[str, list[float]] = {name: [] for name in (*factors, *methods)}
    results = {}
    for repeat in range(REPEATS.get(n, 3)):
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
    """Our methods on a large saddle, each once, in a process of its own that shows its memory."""
    rows: list[dict[str, Any]] = afresh(_large, n)
    return rows


def _large(n: int) -> list[dict[str, Any]]:
    """A row a method, then that of the factorisation."""
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
