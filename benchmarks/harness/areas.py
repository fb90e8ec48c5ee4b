"""The areas of `make bench`: what measures each, and what is shorter in its short form.

A module of an area has `measure(quick) -> dict`; those with a long full form take what the short
form changes as keywords, named here. `make bench-live` and the like run the full form.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any


@dataclass(frozen=True, slots=True)
class Area:
    """One area, whose name is its key in `AREAS` and in the results.

    Attributes
    ----------
    module : str
        The module here that measures it.
    about : str
        What is measured.
    short : mapping of str to Any
        Keywords of `measure` in the short form.
    shorter : str
        In words: how the short form differs from the full one; empty where it does not.
    seconds : float
        Longest time that the area may take [s]; it is stopped then.
    """

    module: str
    about: str
    short: Mapping[str, Any] = field(default_factory=dict)
    shorter: str = ""
    seconds: float = 1800.0


AREAS = {
    "geometry": Area(
        "benchmarks.geometry.geometry",
        "surface meshes, flat maps and contact images beside their peers",
        {"large": 0}, "no map of 1,000,000 vertices"),
    "classify": Area(
        "benchmarks.classify.classify",
        "histograms, SVM, labels and structures beside their peers",
        {"rounds": 5}, "5 turns instead of 15"),
    "calibration": Area(
        "benchmarks.calibration.calibrations",
        "accuracy and time of calibrations (simulated evidence)",
        {"repeats": 1, "wrong": 10, "scans": 16, "wirings": 7, "planes": 2, "trials": 4},
        "23 runs a row instead of 46, 16 scans instead of 50, "
        "7 faulty check-ups of each part instead of 35, 2 trials of presses instead of 30, "
        "10 wrong inputs of each kind instead of 67, 4 simulated self-touches instead of 20"),
    "live": Area(
        "benchmarks.live.live",
        "streams, contacts, identities, memory and recordings",
        {"minutes": 1.0, "seconds": 30.0, "soaked": 20_000, "each": 5.0, "kills": 5, "pairs": 3},
        "60 s at 50 Hz instead of 10 minutes, 30 s at 1 kHz instead of 60, 20,000 samples soaked "
        "instead of 200,000, 5 recorders killed instead of 10"),
    "viewer": Area(
        "benchmarks.viewer.viewer_speed",
        "frames, first picture and memory beside PyVista",
        {"rounds": 5}, "5 rounds instead of 7; 200,000 updates are in `make soak`"),
    "page": Area(
        "benchmarks.viewer.viewer_web",
        "the page in headless Chromium",
        {"openings": 1}, "opened once instead of three times"),
    "needs": Area(
        "benchmarks.scale.needs",
        "time and memory against what is asked for",
        {"turns": 3}, "3 fresh processes a case instead of 5"),
}  # fmt: skip


def run(area: Area, form: str) -> dict[str, Any]:
    """The rows of an area in one of the forms "full", "short" and "quick"."""
    measure = import_module(area.module).measure
    # A module may be older or newer than this table: what it does not take stays as it is there.
    taken = inspect.signature(measure).parameters
    short = {k: v for k, v in area.short.items() if k in taken} if form == "short" else {}
    return dict(measure(form == "quick", **short))
