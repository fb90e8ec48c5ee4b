"""Maps that others drew, to compare ours with: by hand, or in the file of the skin."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from skinmap.cli.flatten.options import DRAWING, THEIRS, FlatOptions
from skinmap.errors import MissingFileError, SkinWarning, UnknownNameError
from skinmap.flat.drawing_comparison import DrawnChart, compare_drawing
from skinmap.flat.flat_map import FlatMap
from skinmap.io.flat_maps.drawing import Drawing, read_drawing
from skinmap.io.flat_maps.tactile_maps import read_tactile_maps

if TYPE_CHECKING:
    from skinmap.cli.flatten.job import Surfaces

Read = Callable[[int], Mapping[str, Drawing]]  # of the number of taxels


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
