"""Boards laid by anchors on the family of links, and what becomes of wrong input.

The truth is a formula (`links`), the evidence simulated: anchors of 1 mm a coordinate. No constant
of the wrap was chosen by the links that are `judged`. The former method, lengths alone, is measured
on the same evidence in the same run: it expects no strain and knows no plates.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np

from benchmarks.calibration.links import family_cases
from benchmarks.calibration.patches import Case, far_apart, simulate_touches
from benchmarks.harness.timing import timed
from calibration import PatchCalibration, Status, locate_by_touch, wrap_layout
from calibration.patch import board as boards
from calibration.patch import minima
from calibration.patch.link_surface import make_target
from skinmap.arrays import FloatArray, IntArray

COUNTS = (4, 6, 8)  # anchors
NOISE = 1e-3  # of each of their coordinates [m]
OFF = 9e-3  # how far a misplaced anchor is off, along the skin [m]
INSIDE = (0.2, 2.5)  # normalised errors squared that count as true
WRONG_BY = 2e-3  # a median error above this must not be called ok [m]
NEAR = 8  # taxels round one, which tell its tangent plane
FIRST_CHANNEL = 1000  # so that no channel is a row
Run = dict[str, Any]


@contextmanager
def lengths_alone() -> Iterator[None]:
    """The former method: all strain is unexpected."""
    rounds, smooth = minima.ROUNDS, boards.SMOOTH
    minima.ROUNDS, boards.SMOOTH = 0, 1e-6
    try:
        yield
    finally:
        minima.ROUNDS, boards.SMOOTH = rounds, smooth


def family_rows(repeats: int, *, some: int | None = None) -> list[dict[str, Any]]:
    """Rows by method, anchors and kind of board, over links that chose constants and others."""
    cases = [(board, link.judged, case) for board in ("flat", "modules")
             for link, case in list(family_cases(board))[:some]]  # fmt: skip
    rows = []
    for method in ("lengths alone", "flat map"):
        for count in COUNTS:
            runs = [
                _run(case, board, judged, method, count, repeat)
                for board, judged, case in cases
                for repeat in range(repeats)
            ]
            rows += _summaries(runs, method, count)
    return rows


def _run(case: Case, board: str, judged: bool, method: str, count: int, repeat: int) -> Run:
    rng = np.random.default_rng([repeat, count, len(case.layout), len(case.part)])
    taxels, points = anchored(case, count, rng)
    make_target(case.vertices, case.faces)
    modules = case.modules if board == "modules" and method == "flat map" else None
    solve = partial(
        wrap_layout, case.layout, case.vertices, case.faces, taxels, points,
        modules=modules, rng=rng,
    )  # fmt: skip
    if method == "flat map":
        found, seconds, _ = timed(solve)
    else:
        with lengths_alone():
            found, seconds, _ = timed(solve)
    return _measured(found, case, board, judged, seconds)


def _measured(found: PatchCalibration, case: Case, board: str, judged: bool, seconds: float) -> Run:
    error = found.positions - case.truth
    length = np.linalg.norm(error, axis=1)
    square = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance), error)
    return {
        "board": board, "judged": judged, "median": 1e3 * float(np.median(length)),
        "p95": 1e3 * float(np.percentile(length, 95)), "ok": found.status is Status.OK,
        "normalised": float(square.mean() / 3), "seconds": seconds,
    }  # fmt: skip


def _summaries(runs: list[Run], method: str, count: int) -> list[dict[str, Any]]:
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
        normalised = np.array([run["normalised"] for run in own])
        inside = (normalised >= INSIDE[0]) & (normalised <= INSIDE[1])
        rows.append({
            "method": method, "anchors": count, "boards": name, "runs": len(own),
            "median_mm": float(np.mean([run["median"] for run in own])),
            "p95_mm": float(np.mean([run["p95"] for run in own])),
            "worst_median_ok_mm": max((run["median"] for run in own if run["ok"]), default=None),
            "refused": sum(not run["ok"] for run in own),
            "normalised_error_squared": {
                "lowest": float(normalised.min()), "median": float(np.median(normalised)),
                "highest": float(normalised.max()), "share_inside": float(inside.mean()),
            },
            "seconds_median": float(np.median([run["seconds"] for run in own])),
        })  # fmt: skip
    return rows


def anchored(case: Case, count: int, rng: np.random.Generator) -> tuple[IntArray, FloatArray]:
    """Taxels far apart, and where they were measured."""
    taxels = far_apart(case.layout, count, rng)
    return taxels, case.truth[taxels] + rng.normal(0.0, NOISE, (count, 3))


def family_touch_rows(*, some: int | None = None) -> list[dict[str, Any]]:
    """The same boards located by touches alone, gains spread by a quarter."""
    rows = []
    for count, how in ((32, {"noise": 1e-3}), (64, {"noise": 2e-3, "wrong": 0.3, "dead": 0.2})):
        runs = []
        for board in ("flat", "modules"):
            for link, case in list(family_cases(board))[:some]:
                rng = np.random.default_rng([count, len(case.layout), len(case.part)])
                touches = simulate_touches(case, count, rng, **how)
                make_target(case.vertices, case.faces)
                found, seconds, _ = timed(partial(
                    locate_by_touch, case.layout, case.vertices, case.faces, touches,
                    modules=case.modules if board == "modules" else None, rng=rng,
                ))  # fmt: skip
                runs.append(_measured(found, case, board, link.judged, seconds))
        rows += [row | {"touches": count, **how} for row in _summaries(runs, "touches", count)]
    return rows


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
            "ok_and_wrong": sum(run["ok"] and run["median"] > WRONG_BY for run in runs),
            "named_percent": 100.0 * float(np.mean([run["named"] for run in runs])),
            "seconds_mean": float(np.mean([run["seconds"] for run in runs])),
        })  # fmt: skip
    return rows


def _spoilt(case: Case, spoil: Any, count: int, rng: np.random.Generator) -> Run:
    taxels, points = anchored(case, count, rng)
    layout, points, words = spoil(case, case.layout, taxels, points, rng)
    modules = case.modules if len(np.unique(case.modules)) > 1 and "flat" not in case.part else None
    found, seconds, _ = timed(partial(
        wrap_layout, layout, case.vertices, case.faces, taxels, points, modules=modules,
        channels=FIRST_CHANNEL + np.arange(len(layout)), rng=rng,
    ))  # fmt: skip
    said = found.reasons[0] if found.reasons else ""
    return {
        "ok": found.status is Status.OK,
        "median": float(np.median(np.linalg.norm(found.positions - case.truth, axis=1))),
        "named": all(word in said for word in words) and bool(said) == bool(words),
        "seconds": seconds,
    }


Spoilt = tuple[FloatArray, FloatArray, tuple[str, ...]]  # layout, points, words that name it


def _honest(case: Case, layout: Any, taxels: Any, points: Any, rng: Any) -> Spoilt:
    return layout, points, ()


def _mirrored(case: Case, layout: Any, taxels: Any, points: Any, rng: Any) -> Spoilt:
    return layout * [-1.0, 1.0], points, ("drawn from the other side",)


def _misplaced(case: Case, layout: Any, taxels: Any, points: Any, rng: Any) -> Spoilt:
    row = int(rng.integers(len(taxels)))
    away = case.truth - case.truth[taxels[row]]
    near = away[np.argsort(np.linalg.norm(away, axis=1))[:NEAR]]
    normal = np.linalg.svd(near, full_matrices=False)[2][2]
    step = rng.normal(size=3)
    step -= (step @ normal) * normal
    moved = points.copy()
    moved[row] += OFF * step / np.linalg.norm(step)
    return layout, moved, (f"channel {FIRST_CHANNEL + taxels[row]} is misplaced",)


def _exchanged(case: Case, layout: Any, taxels: Any, points: Any, rng: Any) -> Spoilt:
    pair = rng.choice(len(taxels), 2, replace=False)
    moved = points.copy()
    moved[pair] = points[pair[::-1]]
    names = (str(FIRST_CHANNEL + taxels[row]) for row in pair)
    return layout, moved, ("are exchanged", *names)


def _scaled(case: Case, layout: Any, taxels: Any, points: Any, rng: Any) -> Spoilt:
    factor = float(rng.choice([0.8, 0.9, 1.1, 1.3]))
    return factor * layout, points, (f"% too {'large' if factor > 1.0 else 'small'}",)


SPOILT: dict[str, Callable[..., Spoilt]] = {
    "honest": _honest,
    "mirrored": _mirrored,
    "one anchor 9 mm off": _misplaced,
    "two anchors exchanged": _exchanged,
    "drawn 10 to 30 % too large or small": _scaled,
}
