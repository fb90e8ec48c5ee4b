"""Boards laid by anchors on the family of links, and what becomes of wrong input.

The truth is a formula (`links`), the evidence simulated: anchors of 1 mm a coordinate. No constant
of the wrap was chosen by the links that are `judged`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmarks.calibration.links import Case, family_cases, far_apart, normalised
from benchmarks.harness.timing import timed
from calibration import PatchCalibration, Status, wrap_layout
from calibration.patch.link_surface import make_target
from skinmap.arrays import FloatArray, IntArray

COUNTS = (4, 6, 8)  # anchors
NOISE = 1e-3  # of each of their coordinates [m]
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
        "status": str(found.status), "ok": found.status is Status.OK, "reasons": found.reasons,
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
            "normalised_error_squared": {
                "lowest": float(squares.min()), "median": float(np.median(squares)),
                "highest": float(squares.max()), "share_inside": float(inside.mean()),
            },
            "seconds_median": float(np.median([run["seconds"] for run in own])),
        })  # fmt: skip
    return rows


def anchored(case: Case, count: int, rng: np.random.Generator) -> tuple[IntArray, FloatArray]:
    """Taxels far apart, and where they were measured."""
    taxels = far_apart(case.layout, count, rng)
    return taxels, case.truth[taxels] + rng.normal(0.0, NOISE, (count, 3))


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
