"""Accuracy and time of calibrations: `make bench-calibration` (`--quick` for a glance).

Evidence is simulated on real boards and links of the iCub and on a family of made links, so every
accuracy here is simulated; the truth is named with each table. Times are CPU time of one thread,
the wrap of a link's mesh apart, as it is kept. Each table goes to benchmarks/results/
calibration.json as it comes, with the commit that it is of; all of them take an hour and a half,
`--only wrap mount` those named.

The family of links has formulas as truth, and anchors of 1 mm a coordinate; no constant of the wrap
was chosen by the links that are `judged`. Mounts, drift under a held press and wrong input are
planted.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from functools import partial
from importlib.util import find_spec
from statistics import median
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from benchmarks.calibration.links import (
    Case,
    displaced,
    family_cases,
    far_apart,
    icub_cases,
    normalised,
    simulate_touches,
)
from benchmarks.calibration.person import checkup_rows
from benchmarks.calibration.planes import plane_rows
from benchmarks.calibration.self_touch_rows import simulated_rows
from benchmarks.harness.record import RESULTS, about, code_of, commit, readable, write
from benchmarks.harness.timing import timed
from calibration import PatchCalibration, Status, locate_by_touch, register_scan, wrap_layout
from calibration.mount.rigid_mount import fit_mount
from calibration.patch.link_surface import OFFSET, make_target
from calibration.response.response import ResponseCalibration
from skinmap.arrays import FloatArray, IntArray
from skinmap.geometry.proximity import closest_on_mesh
from skinmap.geometry.rigid import transform_points

COUNTS = (4, 6, 8)  # anchors
ANCHOR_NOISE = 1e-3  # of each of their coordinates [m]
OFF = 9e-3  # how far a misplaced anchor is off, along the skin [m]
INSIDE = (0.2, 2.5)  # normalised errors squared that count as true
WRONG_BY_MM = 2.0  # a median error above this must not be called ok
NEAR = 8  # taxels round one, which tell its tangent plane
FIRST_CHANNEL = 1000  # so that no channel is a row
Run = dict[str, Any]


def family_rows(repeats: int, *, some: int | None = None) -> list[dict[str, Any]]:
    """Rows by anchors and kind of board, over links that chose constants and others."""
    cases = [(board, link.judged, case) for board in ("flat", "modules")
             for link, case in list(family_cases(board))[:some]]  # fmt: skip
    rows = []
    for count in COUNTS:
        runs = []
        for board, judged, case in cases:
            for repeat in range(repeats):
                rng = np.random.default_rng([repeat, count, len(case.layout), len(case.part)])
                taxels, points = anchored(case, count, rng)
                modules = case.modules if board == "modules" else None
                run = wrapped(case, case.layout, taxels, points, modules=modules, rng=rng)
                runs.append(run | {"board": board, "judged": judged})
        rows += _summaries(runs, count)
    return rows


def wrapped(case: Case, layout: FloatArray, taxels: Any, points: Any, **how: Any) -> Run:
    """One board laid by anchors, against where it is; the link's wrap is made before."""
    make_target(case.vertices, case.faces)
    found, seconds, _ = timed(
        partial(wrap_layout, layout, case.vertices, case.faces, taxels, points, **how)
    )
    return measured(found, case, seconds)


def measured(found: PatchCalibration, case: Case, seconds: float) -> Run:
    """Errors of the taxels [mm], how honest they are, status and CPU time."""
    error = found.positions - case.truth
    length = 1e3 * np.linalg.norm(error, axis=1)
    return {
        "median": float(np.median(length)), "p95": float(np.percentile(length, 95)),
        "normalised": normalised(error, found.covariance), "seconds": seconds,
        "ok": found.status is Status.OK, "reasons": found.reasons,
    }  # fmt: skip


def _summaries(runs: list[Run], count: int) -> list[dict[str, Any]]:
    groups: dict[str, Callable[[Run], bool]] = {
        "all": lambda run: True,
        "flat": lambda run: run["board"] == "flat",
        "modules": lambda run: run["board"] == "modules",
        "judged": lambda run: run["judged"],
    }
    rows = []
    for name, belongs in groups.items():
        own = [run for run in runs if belongs(run)]
        if not own:
            continue
        squares = np.array([run["normalised"] for run in own])
        inside = (squares >= INSIDE[0]) & (squares <= INSIDE[1])
        rows.append({
            "method": "flat map", "anchors": count, "boards": name, "runs": len(own),
            "median_mm": float(np.mean([run["median"] for run in own])),
            "p95_mm": float(np.mean([run["p95"] for run in own])),
            "worst_median_ok_mm": max((run["median"] for run in own if run["ok"]), default=None),
            "refused": sum(not run["ok"] for run in own),
            "normalised_error_squared": {"share_inside": float(inside.mean())},
            "seconds_median": float(np.median([run["seconds"] for run in own])),
        })  # fmt: skip
    return rows


def anchored(case: Case, count: int, rng: np.random.Generator) -> tuple[IntArray, FloatArray]:
    """Taxels far apart, and where they were measured."""
    taxels = far_apart(case.layout, count, rng)
    return taxels, case.truth[taxels] + rng.normal(0.0, ANCHOR_NOISE, (count, 3))


def wrong_rows(icub: list[Case], each: int) -> list[dict[str, Any]]:
    """Wrong inputs of each kind, and as many honest ones: called ok, refused, named right."""
    family = [case for board in ("flat", "modules") for _, case in family_cases(board)]
    cases = [*icub, *family]
    rows = []
    for number, (kind, spoil) in enumerate(SPOILT.items()):
        runs = []
        for trial in range(each):
            rng = np.random.default_rng([trial, number, 11])
            runs.append(_spoilt(cases[rng.integers(len(cases))], spoil, COUNTS[trial % 3], rng))
        rows.append({
            "kind": kind, "runs": each,
            "ok": sum(run["ok"] for run in runs),
            "ok_and_wrong": sum(run["ok"] and run["median"] > WRONG_BY_MM for run in runs),
            "named_percent": 100.0 * float(np.mean([run["named"] for run in runs])),
        })  # fmt: skip
    return rows


def _spoilt(case: Case, spoil: Any, count: int, rng: np.random.Generator) -> Run:
    taxels, points = anchored(case, count, rng)
    layout, points, words = spoil(case, taxels, points, rng)
    modules = case.modules if len(np.unique(case.modules)) > 1 and "flat" not in case.part else None
    run = wrapped(
        case, layout, taxels, points, modules=modules,
        channels=FIRST_CHANNEL + np.arange(len(layout)), rng=rng,
    )  # fmt: skip
    said = run["reasons"][0] if run["reasons"] else ""
    named = all(word in said for word in words) and bool(said) == bool(words)
    return run | {"named": named}


Spoilt = tuple[FloatArray, FloatArray, tuple[str, ...]]  # layout, points, words that name it


def _mirrored(case: Case, taxels: Any, points: Any, rng: Any) -> Spoilt:
    return case.layout * [-1.0, 1.0], points, ("drawn from the other side",)


def _misplaced(case: Case, taxels: Any, points: Any, rng: Any) -> Spoilt:
    row = int(rng.integers(len(taxels)))
    away = case.truth - case.truth[taxels[row]]
    near = away[np.argsort(np.linalg.norm(away, axis=1))[:NEAR]]
    normal = np.linalg.svd(near, full_matrices=False)[2][2]
    step = rng.normal(size=3)
    step -= (step @ normal) * normal
    moved = points.copy()
    moved[row] += OFF * step / np.linalg.norm(step)
    return case.layout, moved, (f"channel {FIRST_CHANNEL + taxels[row]} is misplaced",)


def _exchanged(case: Case, taxels: Any, points: Any, rng: Any) -> Spoilt:
    pair = rng.choice(len(taxels), 2, replace=False)
    moved = points.copy()
    moved[pair] = points[pair[::-1]]
    names = (str(FIRST_CHANNEL + taxels[row]) for row in pair)
    return case.layout, moved, ("are exchanged", *names)


def _scaled(case: Case, taxels: Any, points: Any, rng: Any) -> Spoilt:
    factor = float(rng.choice([0.8, 0.9, 1.1, 1.3]))
    return factor * case.layout, points, (f"% too {'large' if factor > 1.0 else 'small'}",)


SPOILT: dict[str, Callable[..., Spoilt]] = {
    "honest": lambda case, taxels, points, rng: (case.layout, points, ()),
    "mirrored": _mirrored,
    "one anchor 9 mm off": _misplaced,
    "two anchors exchanged": _exchanged,
    "drawn 10 to 30 % too large or small": _scaled,
}


TRUTH = "taxels of the built-in iCub; evidence simulated"
# Anchors, scale and jitter of the layout [m].
WRAPS = ((3, 1.0, 0.0), (4, 1.0, 0.0), (8, 1.0, 0.0), (4, 1.01, 0.3e-3), (8, 1.01, 0.3e-3))
TABLES = ("wrap", "family", "wrong", "touch", "scan", "mount", "wiring", "plane", "drift")
HEALTHY = 201  # skins without a fault: one false alarm in 200 is asked for at most
WRONG = 67  # inputs of each kind: 200 that are mirrored, misplaced or exchanged
TOUCHES: tuple[tuple[int, dict[str, Any]], ...] = (  # how many, and how they are made
    (32, {"noise": 1e-3}),
    (64, {"noise": 2e-3, "wrong": 0.3, "dead": 0.2}),
    (32, {"noise": 1e-3, "one_module": True}),
    (7, {"noise": 1e-3}),
)
POINTS, NOISE, STRAY = 4000, 0.7e-3, 0.1
TURN, SHIFT = np.radians(15.0), 15e-3


def wrap_rows(cases: list[Case], repeats: int) -> list[dict[str, Any]]:
    """Boards wrapped by 3, 4 and 8 anchors of 1 mm, with true layouts and with wrong ones."""
    rows = []
    for anchors, scale, jitter in WRAPS:
        runs = []
        for number, case in enumerate(cases):
            for repeat in range(repeats):
                rng = np.random.default_rng([repeat, anchors, number, 1])
                layout = scale * case.layout + rng.normal(0.0, jitter, case.layout.shape)
                taxels = far_apart(layout, anchors, rng)
                points = case.truth[taxels] + rng.normal(0.0, 1e-3, (anchors, 3))
                runs.append(wrapped(case, layout, taxels, points, modules=case.modules, rng=rng))
        row = {"anchors": anchors, "scale": scale, "jitter_mm": 1e3 * jitter}
        rows.append(row | _table_row(runs))
    return rows


def touch_rows(cases: list[Case], repeats: int) -> list[dict[str, Any]]:
    """Boards located by touches alone, gains spread by a quarter."""
    rows = []
    for count, how in TOUCHES:
        runs = []
        for number, case in enumerate(cases):
            if how.get("one_module") and len(np.unique(case.modules)) < 2:
                continue
            for repeat in range(repeats):
                rng = np.random.default_rng([repeat, count, number, 2])
                touches = simulate_touches(case, count, rng, **how)
                link = case.vertices, case.faces
                make_target(*link)
                work = partial(locate_by_touch, case.layout, *link, touches, modules=case.modules)
                found, seconds, _ = timed(partial(work, rng=rng))
                runs.append(measured(found, case, seconds))
        rows.append({"touches": count, "one_module": False, **how} | _table_row(runs))
    return rows


def _table_row(runs: list[dict[str, Any]]) -> dict[str, Any]:
    trusted = [run["median"] for run in runs if run["ok"]]
    return {
        "runs": len(runs),
        "median_mm": float(np.median([run["median"] for run in runs])),
        "p95_mm": float(np.median([run["p95"] for run in runs])),
        "worst_median_ok_mm": max(trusted, default=None),
        "ok": len(trusted),
        "normalised_error_squared": float(np.mean([run["normalised"] for run in runs])),
        "seconds": {"max": max(run["seconds"] for run in runs)},
    }


def measure(
    quick: bool,
    *,
    repeats: int = 2,
    wrong: int = WRONG,
    scans: int = 50,
    wirings: int = 35,
    planes: int = 30,
    trials: int = 20,
    only: Sequence[str] = TABLES,
    keep: Callable[[str, Any], object] = lambda *_: None,
) -> dict[str, Any]:
    """Tables by name.

    Parameters
    ----------
    quick : bool
        One patch, four scans.
    repeats : int
        Runs of each row on each of the 23 patches, and of each board of the family.
    wrong : int
        Wrong inputs of each kind, and honest ones.
    scans : int
        Scans that are registered.
    wirings : int
        Check-ups of each part with a fault; as many of healthy skins as it takes to see one false
        alarm in 200, or nine times as many.
    planes : int
        Trials of each row of presses on a table.
    trials : int
        Simulated robots that touch themselves, for each row.
    only : sequence of str
        Which tables.
    keep : callable
        Given the name and the rows of each table as it comes.
    """
    cases = list(icub_cases())
    some, most = cases, None
    healthy = min(9 * wirings, HEALTHY)
    checkups = {"faulty": wirings, "healthy": healthy, "rests": healthy, "histories": wirings // 3}
    if quick:
        some, most, repeats, wrong, scans, planes, trials = cases[7:8], 1, 1, 2, 4, 1, 2
        checkups = {"faulty": 2, "healthy": 3, "rests": 20, "histories": 1}
    tables: dict[str, Callable[[], Any]] = {
        "wrap": lambda: wrap_rows(some, repeats),
        "family": lambda: family_rows(repeats, some=2 if quick else None),
        "wrong": lambda: wrong_rows(cases, wrong),
        "touch": lambda: touch_rows(some, repeats),
        "scan": lambda: scan_rows(cases, scans),
        "mount": lambda: [pair_row(), *simulated_rows(trials)],
        "wiring": lambda: checkup_rows(**checkups),
        "plane": lambda: plane_rows(planes),
        "drift": lambda: drift_rows(most=most),
    }
    result: dict[str, Any] = {"truth": TRUTH}
    for name in only:
        if name == "scan" and find_spec("open3d") is None:  # the table of before stays
            lacks = "open3d is not installed (pip install .[scan])"
            print(f"scan: not measured, {lacks}", file=sys.stderr)
            continue
        result[name], cpu, _ = timed(tables[name])
        keep(name, result[name])
        print(f"{name}: {cpu:.0f} s CPU", file=sys.stderr, flush=True)
    return result


def scan_rows(cases: list[Case], runs: int) -> list[dict[str, Any]]:
    """Registrations of scans of several links, and of a bare cylinder."""
    links = list({len(case.vertices): case for case in cases}.values())
    errors = []
    for run in range(runs):
        case = links[run % len(links)]
        rng = np.random.default_rng([run, 6])
        scan = _half(case.vertices, case.faces, rng)
        T = displaced(scan.mean(axis=0), rng, TURN, SHIFT)
        link = transform_points(T, scan), case.vertices, case.faces
        found = register_scan(*link, rng=rng)
        away = transform_points(found.T_mesh_scan @ T, scan) - scan
        errors.append(np.linalg.norm(away, axis=1).mean())
    tube = trimesh.creation.cylinder(radius=45e-3, height=0.2, sections=64)
    rng = np.random.default_rng(6)
    angle, height = rng.uniform(0, np.pi, POINTS), rng.uniform(-0.05, 0.05, POINTS)
    points = np.column_stack([45e-3 * np.cos(angle), 45e-3 * np.sin(angle), height])
    points += rng.normal(0, NOISE, points.shape)
    bare = register_scan(points, tube.vertices, tube.faces, rng=rng)
    return [
        {
            "what": "half a link, 0.7 mm noise, 10 % stray, from 15 degrees / 15 mm (simulated)",
            "runs": runs,
            "median_mm": 1e3 * float(np.median(errors)),
            "below_1_mm": float(np.mean(np.array(errors) < 1e-3)),
        },
        {"what": "bare cylinder (simulated)", "status": str(bare.status)},
    ]


def _half(vertices: FloatArray, faces: Any, rng: np.random.Generator) -> FloatArray:
    """The outer surface of a link as seen from one side."""
    # Visual meshes have inner sheets that no scanner sees: the wrap's surface less its offset.
    target = make_target(vertices, faces)
    mesh = trimesh.Trimesh(target.vertices, target.faces, process=False)
    points, face = trimesh.sample.sample_surface(mesh, 4 * POINTS, seed=int(rng.integers(2**30)))
    normals = mesh.face_normals[face]
    points = np.asarray(points - OFFSET * normals)
    distance, _, _ = closest_on_mesh(points, vertices, faces)
    # Where the wrap spans an opening there is nothing to scan.
    seen = np.flatnonzero((normals @ rng.normal(size=3) > 0) & (distance < 1e-3))[:POINTS]
    scan = points[seen]
    scan = scan + rng.normal(0.0, NOISE, scan.shape)
    stray = rng.random(len(scan)) < STRAY
    low, high = scan.min(axis=0) - 0.02, scan.max(axis=0) + 0.02
    scan[stray] = rng.uniform(low, high, (int(stray.sum()), 3))
    return scan


def main() -> None:
    """Measure, and keep each table as it comes: a run that is interrupted has lost one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="whether it runs; no figures to keep")
    parser.add_argument("--only", nargs="+", choices=TABLES, default=TABLES, help="the others stay")
    options = parser.parse_args()
    file = RESULTS / "calibration.json"
    kept = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}

    def keep(name: str, table: Any) -> None:
        kept.update(about("full"), truth=TRUTH, **{name: table})
        kept["measured_at"] = {**kept.get("measured_at", {}), name: commit()}
        write(file, kept)

    with threadpool_limits(1):
        if options.quick:
            print(readable(measure(True, only=options.only)))
        else:
            measure(False, only=options.only, keep=keep)
            write(file, kept | {"code": code_of(measure)})


PAIRS, RUNS = 700, 30
RATE, MINUTES, TAXELS, HELD, PRESS = 50.0, 10.0, 60, 6, 80.0


def pair_row() -> dict[str, Any]:
    """What a mount from 700 pairs costs, whose places are known to 1 mm."""
    rng = np.random.default_rng(0)
    pairs = (_pairs(rng) for _ in range(RUNS))
    times = [timed(partial(fit_mount, *one, loss="cauchy"))[1] for one in pairs]
    return {"evidence": "pairs", "case": f"{PAIRS} pairs", "runs": RUNS, "cpu_s": median(times)}


def _pairs(rng: np.random.Generator) -> tuple[FloatArray, ...]:
    """Points (m, 3) in a mount, frames (m, 4, 4) of its link, and where they are."""
    mount = np.eye(4)
    mount[:3, :3] = Rotation.random(rng=rng).as_matrix()
    mount[:3, 3] = rng.normal(0, 0.15, 3)
    frames = np.tile(np.eye(4), (PAIRS, 1, 1))
    frames[:, :3, :3] = Rotation.random(PAIRS, rng=rng).as_matrix()
    frames[:, :3, 3] = rng.normal(0, 0.1, (PAIRS, 3))
    points = rng.normal(0, 0.05, (PAIRS, 3))
    T = frames @ mount
    targets = np.einsum("mij,mj->mi", T[:, :3, :3], points) + T[:, :3, 3]
    targets += rng.normal(0, 1e-3, targets.shape)
    return points, frames, targets


def drift_rows(*, most: int | None) -> list[dict[str, Any]]:
    """A press held for ten minutes while baselines walk 20 counts; simulated at 50 Hz, 8 bits."""
    rows = []
    for case, walk in list(_walks(np.random.default_rng(0)).items())[:most]:
        rng = np.random.default_rng(1)
        rest = np.rint(100 + rng.normal(0, 1.2, (int(5 * RATE), TAXELS)))
        press = np.zeros_like(walk)
        begin, end = int(10 * RATE), len(walk) - int(10 * RATE)
        press[begin:end, :HELD] = PRESS
        noise = rng.normal(0, 1.2, walk.shape)
        samples = np.clip(np.rint(100 + walk + press + noise), 0, 255)
        for name, track in TRACKERS.items():
            pressure = track(rest, samples)
            last = pressure[end - 50 - int(10 * RATE) : end - 50, :HELD]
            rows.append({
                "case": case, "tracker": name,
                "truth": f"press of {PRESS:.0f} counts (simulated)",
                "kept_after_10_min_percent": float(100.0 * last.mean() / PRESS),
                "false_touch_percent": 100.0 * float((pressure[:, HELD:] > 0).mean()),
            })  # fmt: skip
    return rows


def _walks(rng: np.random.Generator) -> dict[str, FloatArray]:
    t = int(RATE * 60 * MINUTES)
    ramp = np.linspace(0.0, 20.0, t)[:, None]
    free = (np.arange(TAXELS) >= HELD).astype(float)
    steps = np.cumsum(rng.normal(0, 20 / np.sqrt(t), (t, TAXELS)), axis=0)
    return {
        "free baselines rise": ramp * free,
        "free baselines fall": -ramp * free,
        "all baselines rise": ramp * np.ones(TAXELS),
        "all baselines fall": -ramp * np.ones(TAXELS),
        "each its own way": ramp * free * rng.choice([-1.0, 1.0], TAXELS),
        "random walks": steps * free,
    }


def _incumbent(rest: FloatArray, samples: FloatArray) -> FloatArray:
    """The iCub's skinManager as shipped: its baseline moves in every sample, also in contact."""
    baseline = rest.mean(axis=0)
    theta = np.maximum(1.0, np.percentile(rest, 95, axis=0) - baseline)
    out = np.empty(samples.shape)
    for row, sample in enumerate(samples):
        deviation = sample - baseline
        touched = deviation > theta + 7.0
        baseline = baseline + 0.02 * np.where(touched, 0.05, 0.2) * deviation / theta
        out[row] = np.where(touched, deviation, 0.0)
    return out


TRACKERS: dict[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
    "skinmap": lambda rest, samples: ResponseCalibration.fit(rest, rate=RATE).apply(samples),
    "incumbent, as shipped (margin 7, adapts under contact)": _incumbent,
}


if __name__ == "__main__":
    main()
