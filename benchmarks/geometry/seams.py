"""Seams that know touches: how many touches not used for choosing they divide, and at what cost.

Closed and tubular meshes are touched in three ways that no constant of the choice was set on:
from habit at few places anywhere, by strokes along one side, and evenly. Half of the touches
choose the seam, the others judge it beside the shortest one; a seam chosen by another body's
habits is the control. Periodic maps, and an overlap check of every map by an independent union of
its triangles. One thread: set OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

import skinmap
from benchmarks import ROOT
from benchmarks.harness.record import command
from skinmap.errors import FlatteningError, SkinWarning
from skinmap.flat.flat_map import Chart, FlatMap
from skinmap.flat.mesh_charts import mesh_surface
from skinmap.flat.seams import divided_touches
from skinmap.surface.surface_mesh import SurfaceMesh

TRIALS = 2
TOUCHES = 100  # that choose, and as many that judge
REACH = 0.1  # radius of a touch against the mesh's size
OVERLAP = 1e-6  # of a map's area


def meshes(quick: bool = False) -> Iterator[tuple[str, SurfaceMesh]]:
    """Closed and tubular meshes: bodies of the robots here, and shapes whose names say what."""
    import trimesh

    for path in sorted((ROOT / "data").glob("*/meshes/*.ply"))[: 3 if quick else None]:
        body = trimesh.load(path, process=False)
        yield path.stem, mesh_surface(body.vertices, body.faces, name=path.stem)
    ball = trimesh.creation.icosphere(3)
    capsule = trimesh.creation.capsule(2.0, 0.5, count=[24, 24])
    torus = trimesh.creation.torus(1.0, 0.35, major_sections=40, minor_sections=20)
    for name, shape in (("ball", ball), ("capsule", capsule), ("torus", torus)):
        yield name, mesh_surface(shape.vertices, shape.faces, name=name)
    yield "ellipsoid", mesh_surface(ball.vertices * [1.0, 0.6, 2.0], ball.faces, name="ellipsoid")
    for name, cone, bend in (("tube", 0.0, 0.0), ("cone", 0.5, 0.0), ("bent tube", 0.0, 1.0)):
        yield name, mesh_surface(*tube(cone, bend), name=name)


def tube(cone: float, bend: float) -> tuple[np.ndarray, np.ndarray]:
    """An open tube of radius 1 and length 5, narrower at its end by `cone`, bent by an angle."""
    around, along = 28, 24
    i, j = np.meshgrid(np.arange(around), np.arange(along))
    angle, height = 2 * np.pi * i.ravel() / around, 5.0 * j.ravel() / (along - 1)
    radius = 1.0 - cone * height / 5.0
    x, y, z = radius * np.cos(angle), radius * np.sin(angle), height
    if bend:
        turn = bend * z / 5.0
        x, z = (5.0 / bend + x) * np.cos(turn), (5.0 / bend + x) * np.sin(turn)
    p = (np.arange(along - 1)[:, None] * around + np.arange(around)).ravel()
    q = (np.arange(along - 1)[:, None] * around + (np.arange(around) + 1) % around).ravel()
    faces = np.concatenate(
        [np.column_stack([p, q, p + around]), np.column_stack([q, q + around, p + around])]
    )
    return np.column_stack([x, y, z]), faces


def touches(
    mesh: SurfaceMesh, habit: str, rng: np.random.Generator, count: int
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Two samples of touches of one body: rows of the taxels of each."""
    points, size = mesh.vertices, float(np.ptp(mesh.vertices, axis=0).max())
    tree = cKDTree(points)
    if habit == "strokes":
        side = points[np.argmax(points @ rng.normal(size=3))]
        near = points[np.linalg.norm(points - side, axis=1) < 0.6 * size]
        places = near[rng.choice(len(near), min(len(near), 30))]
    else:
        places = points[rng.choice(len(points), 5 if habit == "places" else len(points))]

    def one() -> np.ndarray:
        middle = places[rng.integers(len(places))] + rng.normal(0.0, 0.3 * REACH * size, 3)
        found = tree.query_ball_point(points[tree.query(middle)[1]], REACH * size)
        if habit == "strokes":  # the same again, a little further on
            further = middle + rng.normal(0.0, REACH * size, 3)
            found += tree.query_ball_point(points[tree.query(further)[1]], REACH * size)
        return np.unique(found)

    return [one() for _ in range(count)], [one() for _ in range(count)]


def habit_rows(quick: bool) -> list[dict[str, Any]]:
    """One row a mesh and habit: touches divided by the shortest seam, by ours, by a wrong one."""
    rows = []
    for name, mesh in meshes(quick):
        shortest = skinmap.flatten(mesh)
        for habit in ("places", "strokes", "even"):
            rng = np.random.default_rng(7)
            rows.append(_habit_row(name, mesh, habit, shortest, rng, 1 if quick else TRIALS))
    return rows


def _habit_row(
    name: str, mesh: SurfaceMesh, habit: str, shortest: FlatMap, rng: Any, trials: int
) -> dict[str, Any]:
    counts, errors, kept, apart = np.zeros(3, int), [], 0, []
    for _ in range(trials):
        known, others = touches(mesh, habit, rng, TOUCHES)
        wrong, _ = touches(mesh, "places", rng, TOUCHES)
        own = skinmap.flatten(mesh, touches=known)
        other = skinmap.flatten(mesh, touches=wrong) if habit == "places" else shortest
        maps = (shortest, own, other)
        counts += [sum(divided(chart, others) for chart in flat.charts) for flat in maps]
        errors.append(100.0 * (edge_error(own) - edge_error(shortest)))
        kept += all(
            one.seam_length == two.seam_length
            for one, two in zip(own.charts, shortest.charts, strict=True)
        )
        apart += [overlap_free(chart) for chart in own.charts]
    print(name, habit, counts, file=sys.stderr)
    return {
        "mesh": name,
        "vertices": len(mesh.vertices),
        "habit": habit,
        "trials": trials,
        "divided_by_the_shortest": int(counts[0]),
        "divided": int(counts[1]),
        "divided_by_a_wrong_one": int(counts[2]) if habit == "places" else None,
        "shortest_kept": kept,
        "edge_error_more_points": max(errors),
        "overlap_free": bool(all(apart)),
    }


def divided(chart: Chart, of: list[np.ndarray]) -> int:
    """Touches that a chart divides; the two sides of a periodic map are one place."""
    if chart.periodic:
        every = np.arange(int(chart.taxels.max()) + 1)
        return divided_touches(chart.taxels[chart.faces], every, of)
    return divided_touches(chart.faces, chart.taxels, of)


def edge_error(flat: FlatMap) -> float:
    """Of the worst chart."""
    return max(chart.distortion.edge_rms for chart in flat.charts)


def overlap_free(chart: Chart) -> bool:
    """Whether the union of a map's triangles is as large as all of them together."""
    import shapely

    triangles = shapely.polygons(chart.uv[chart.faces])
    together = shapely.area(triangles).sum()
    return bool(abs(shapely.union_all(triangles).area - together) <= OVERLAP * together)


def periodic_rows(quick: bool) -> list[dict[str, Any]]:
    """One row a tube: its periodic map beside its map with a seam."""
    rows = []
    for name, mesh in meshes(quick):
        try:
            flat = skinmap.flatten(mesh, periodic=True)
        except FlatteningError:
            continue  # closed: no tube
        if not flat.charts[0].periodic:
            continue
        known, _ = touches(mesh, "even", np.random.default_rng(3), TOUCHES)
        cut = skinmap.flatten(mesh, method="dirichlet")
        rows.append(
            {
                "mesh": name,
                "vertices": len(mesh.vertices),
                "divided_with_a_seam": sum(divided(chart, known) for chart in cut.charts),
                "divided": sum(divided(chart, known) for chart in flat.charts),
                "edge_rms_percent": 100.0 * edge_error(flat),
                "edge_rms_percent_with_a_seam": 100.0 * edge_error(cut),
                "flips": flat.flips,
                "overlap_free": all(overlap_free(chart) for chart in flat.charts),
            }
        )
    return rows


def bounded_rows(quick: bool) -> list[dict[str, Any]]:
    """One row a mesh: its mean symmetric Dirichlet energy before and after seams for 4.1."""
    rows = []
    for name, mesh in meshes(quick):
        plain = skinmap.flatten(mesh, method="dirichlet")
        slit = skinmap.flatten(mesh, method="dirichlet", max_distortion=4.1)
        rows.append(
            {
                "mesh": name,
                "vertices": len(mesh.vertices),
                "energy_before": max(map(_energy, plain.charts)),
                "energy": max(map(_energy, slit.charts)),
                "seams_longer": _seams(slit) / max(_seams(plain), 1e-12),
                "seconds": sum(chart.seconds for chart in slit.charts),
                "flips": slit.flips,
                "overlap_free": all(overlap_free(chart) for chart in slit.charts),
            }
        )
    return rows


def _energy(chart: Chart) -> float:
    return chart.distortion.mean_energy


def _seams(flat: FlatMap) -> float:
    return sum(chart.seam_length for chart in flat.charts)


def part_rows() -> dict[str, Any]:
    """Whether the maps of all parts of the built-in robots are free of overlaps."""
    apart = {}
    for name in ("icub", "kaspar"):
        robot = skinmap.load_robot(name)
        for part in robot.parts:
            flat = skinmap.flatten(skinmap.build_surface(robot.skin(part)))
            apart[f"{name} {part}"] = [overlap_free(chart) for chart in flat.charts]
    every = [free for charts in apart.values() for free in charts]
    return {"charts": len(every), "overlap_free": int(np.sum(every))}


def measure(quick: bool = False) -> dict[str, Any]:
    """All rows, and what they come to."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SkinWarning)
        parts, tubes, bounded = part_rows(), periodic_rows(quick), bounded_rows(quick)
        habits = habit_rows(quick)
    of = {
        habit: [row for row in habits if row["habit"] == habit and row["divided_by_the_shortest"]]
        for habit in ("places", "strokes", "even")
    }
    saved = {
        habit: [100.0 * (1.0 - row["divided"] / row["divided_by_the_shortest"]) for row in rows]
        for habit, rows in of.items()
    }
    wrong, usual = (
        sum(row[key] for row in of["places"])
        for key in ("divided_by_a_wrong_one", "divided_by_the_shortest")
    )
    maps = [row["overlap_free"] for row in (*habits, *tubes, *bounded)]
    return {
        "saved_percent": {habit: float(np.mean(found)) for habit, found in saved.items()},
        "saved_percent_by_a_wrong_seam": 100.0 * (1.0 - wrong / usual),
        "edge_error_more_points": max(row["edge_error_more_points"] for row in habits),
        "overlap_free_percent": 100.0 * float(np.mean(maps)),
        "energy": max(row["energy"] for row in bounded),
        "parts": parts,
        "habits": habits,
        "periodic": tubes,
        "bounded": bounded,
    }


if __name__ == "__main__":
    command(measure, __doc__, "seams")
