"""What `skinmap flatten` was asked for, every name and number checked before any work is done.

And the maps that others drew, to compare ours with: by hand, or in the file of the skin.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from skinmap.arrays import IntArray
from skinmap.cli.flatten.seam import NONE, Seam, read_seam
from skinmap.errors import InvalidArrayError, MissingFileError, SkinWarning, UnknownNameError
from skinmap.flat.budget import check_budget
from skinmap.flat.drawing_comparison import DrawnChart, compare_drawing
from skinmap.flat.face_metrics import face_metric
from skinmap.flat.flat_map import DEFAULT as DEFAULT_METHOD
from skinmap.flat.flat_map import FlatMap
from skinmap.flat.methods import check_effort, flatteners
from skinmap.io.flat_maps.drawing import Drawing, read_drawing
from skinmap.io.flat_maps.tactile_maps import read_tactile_maps
from skinmap.surface.surface_mesh import MESHING

if TYPE_CHECKING:
    from skinmap.cli.flatten.job import Surfaces

DRAWING = "drawing"
THEIRS = "theirs"  # flat maps in the files of the skin
OWN, FIXED = "own", "fixed"  # scales of colours
MAX_CHANNEL = 10_000_000
Read = Callable[[int], Mapping[str, Drawing]]  # of the number of taxels


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


def drawings_of(options: FlatOptions, surfaces: Surfaces) -> dict[str, Read]:
    """What reads the drawings of each part, by their names.

    Raises
    ------
    MissingFileError, UnknownNameError
        A drawing, or maps of theirs, were asked for and there are none.
    """
    found: dict[str, list[Read]] = {}
    for part, path in _drawings(options, surfaces).items():
        found.setdefault(part, []).append(_reader(path))
    for part, theirs in _theirs(options, surfaces).items():
        found.setdefault(part, []).append(lambda _, theirs=theirs: theirs())  # type: ignore[misc]
    return {part: _every(reads) for part, reads in found.items()}


def _reader(path: Path) -> Read:
    if path.suffix.lower() == ".json":
        return lambda count: read_tactile_maps([path], count)
    return lambda _: {DRAWING: read_drawing(path)}


def _every(reads: list[Read]) -> Read:
    return lambda count: {name: one for read in reads for name, one in read(count).items()}


def _theirs(
    options: FlatOptions, surfaces: Surfaces
) -> Mapping[str, Callable[[], Mapping[str, Drawing]]]:
    """What reads the maps that the files of each part bring."""
    if not options.with_theirs:
        return {}
    if not surfaces.theirs:
        raise UnknownNameError(f"flat maps in the files of {surfaces.name} (CySkin):", THEIRS, ())
    _warn_without(set(surfaces.makers) - set(surfaces.theirs), "tactile map")
    return surfaces.theirs


def _drawings(options: FlatOptions, surfaces: Surfaces) -> dict[str, Path]:
    """The drawing of each part that has one."""
    if not options.with_drawing:
        return {}
    if options.drawing is not None:
        if not options.drawing.is_file():
            raise MissingFileError(
                options.drawing, "a drawing of iCubSkinGui (.ini) or CySkin maps (.json)"
            )
        return dict.fromkeys(surfaces.makers, options.drawing)
    if not surfaces.drawings:
        raise MissingFileError(
            "drawing",
            f"`drawing = ...` for a part in the manifest of {surfaces.name}, or --drawing FILE",
        )
    _warn_without(set(surfaces.makers) - set(surfaces.drawings), "drawing")
    return dict(surfaces.drawings)


def _warn_without(parts: set[str], what: str) -> None:
    if parts:
        warnings.warn(f"no {what} of {', '.join(sorted(parts))}", SkinWarning, stacklevel=3)


def drawn_charts(flat: FlatMap, drawing: Drawing) -> list[DrawnChart]:
    """The drawing laid over each chart of a part."""
    return [
        compare_drawing(
            chart,
            flat.mesh.vertices[chart.taxels],
            flat.mesh.skin.channels[chart.taxels],
            drawing.channels,
            drawing.xy,
        )
        for chart in flat.charts
    ]
