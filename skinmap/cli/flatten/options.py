"""What `skinmap flatten` was asked for, every name and number checked before any work is done."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from skinmap.arrays import IntArray
from skinmap.cli.flatten.seam import NONE, Seam, read_seam
from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.flat.budget import check_budget
from skinmap.flat.face_metrics import face_metric
from skinmap.flat.flat_map import DEFAULT as DEFAULT_METHOD
from skinmap.flat.flat_map import ISOMETRY
from skinmap.flat.methods import check_effort, flatteners
from skinmap.surface.surface_mesh import MESHING

DRAWING = "drawing"
THEIRS = "theirs"  # flat maps in the files of the skin
OWN, FIXED = "own", "fixed"  # scales of colours
MAX_CHANNEL = 10_000_000


@dataclass(frozen=True, eq=False, kw_only=True, slots=True)
class FlatOptions:
    """The options, as the work takes them.

    Attributes
    ----------
    method, metric : str
    meshing : str or None
        For robots; a mesh file is a surface already, and so is a CySkin file where it is None.
    others : tuple of str
        Methods to compare with.
    drawing : Path or None
        The drawing of all parts, instead of those that the manifest names.
    with_drawing, with_theirs : bool
    away : (k,) int
        Channels that seams keep away from.
    seam : Seam
    max_distortion : float or None
        Mean symmetric Dirichlet energy that each chart is slit to.
    scale : str
        Of the colours: "own" range of each map, or "fixed" for the metric.
    budgets : dict
        `max_seconds` [s] and `max_edge_rms`, a share; None where they were not given.
    seed : int
    iterations : int or None
        None takes the method's own number.
    precision : str
    """

    method: str
    metric: str = "edge_strain"
    meshing: str | None = None
    others: tuple[str, ...] = ()
    drawing: Path | None = None
    with_drawing: bool = False
    with_theirs: bool = False
    away: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    seam: Seam = field(default_factory=Seam)
    max_distortion: float | None = None
    scale: str = "own"
    budgets: Mapping[str, float | None] = field(default_factory=dict)
    seed: int = 0
    iterations: int | None = None
    precision: str = "float64"


def checked_options(
    *,
    method: str | None,
    max_seconds: float | None,
    max_edge_rms: float | None,
    compare: str,
    drawing: Path | None,
    seam_away: tuple[str, ...],
    seam: str,
    max_distortion: float | None,
    metric: str,
    scale: str,
    meshing: str | None,
    iterations: int | None,
    precision: str,
    seed: int,
) -> FlatOptions:
    """The options of the command line, before any work is done.

    Raises
    ------
    UnknownNameError, InvalidArrayError
        A name that does not exist, a number out of range.
    """
    budgets = max_seconds is not None or max_edge_rms is not None
    where = read_seam(seam)
    check_bound(max_distortion)
    if where.kind == NONE and (max_distortion is not None or seam_away):
        raise InvalidArrayError("--seam none cuts nothing: leave out --max-distortion, --seam-away")
    # A bound on the symmetric Dirichlet energy is kept by the method that minimises it.
    usual = DEFAULT_METHOD if max_distortion is None else "dirichlet"
    method = method or ("auto" if budgets else usual)
    flatteners.get(method)
    if meshing is not None and meshing not in MESHING:
        raise UnknownNameError("meshing method", meshing, MESHING)
    check_budget(method, {"--max-seconds": max_seconds, "--max-edge-rms": max_edge_rms})
    check_effort(method, iterations, precision)
    others, drawn = check_compare(compare)
    face_metric(metric)
    return FlatOptions(
        method=method,
        metric=metric,
        meshing=meshing,
        others=others,
        drawing=drawing,
        with_drawing=DRAWING in drawn or drawing is not None,
        with_theirs=THEIRS in drawn,
        away=read_channels(seam_away),
        seam=where,
        max_distortion=max_distortion,
        scale=scale,
        budgets={
            "max_seconds": max_seconds,
            "max_edge_rms": None if max_edge_rms is None else max_edge_rms / 100.0,
        },
        seed=seed,
        iterations=iterations,
        precision=precision,
    )


def check_bound(bound: float | None) -> None:
    """Refuse a bound on the symmetric Dirichlet energy that no map reaches.

    Raises
    ------
    InvalidArrayError
    """
    if bound is not None and not ISOMETRY < bound < np.inf:
        raise InvalidArrayError(
            f"--max-distortion must be above {ISOMETRY:g}, the symmetric Dirichlet energy of a map "
            f"without distortion, got {bound:g}"
        )


def check_compare(words: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The methods named in a list with commas, and what others drew that is among them.

    Raises
    ------
    UnknownNameError
        No such method.
    """
    names = tuple(dict.fromkeys(word.strip() for word in words.split(",") if word.strip()))
    methods = tuple(name for name in names if name not in (DRAWING, THEIRS))
    for name in methods:
        flatteners.get(name)
    return methods, tuple(name for name in names if name not in methods)


def read_channels(words: tuple[str, ...]) -> IntArray:
    """Channels (k,) of lists such as `3,8,20-31`, each once.

    Raises
    ------
    InvalidArrayError
        Something that is no number and no range.
    """
    found: set[int] = set()
    for word in ",".join(words).split(","):
        if not word.strip():
            continue
        match = re.fullmatch(r"\s*(\d{1,8})(?:\s*-\s*(\d{1,8}))?\s*", word)
        low, high = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if not low <= high <= MAX_CHANNEL:
            raise InvalidArrayError(
                f"--seam-away wants channels as 3,8,20-31, got {word.strip()!r}"
            )
        found.update(range(low, high + 1))
    return np.array(sorted(found), np.int64)
