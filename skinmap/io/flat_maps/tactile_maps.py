"""Flat maps that CySkin files bring, as drawings to compare ours with."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from skinmap.errors import DataFormatError, SkinWarning
from skinmap.io.flat_maps.drawing import Drawing
from skinmap.io.taxels.cyskin import map_fits, read_cyskin


def read_tactile_maps(paths: Sequence[Path], count: int | None = None) -> dict[str, Drawing]:
    """The maps of a part by their names, from the files of its pieces in their order.

    A map of another skin than its file's is left out with a `SkinWarning`.

    Parameters
    ----------
    paths : sequence of Path
        CySkin files; taxel i of a file is channel i after those of the files before it.
    count : int, optional
        Taxels of the part that the maps must be of; files may hold maps alone then.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, no CySkin file, or no map that fits the skin.
    """
    files = [read_cyskin(path) for path in paths]
    rows = [len(found) or count or 0 for found in files]
    if count is not None and sum(rows) != count:
        raise DataFormatError(f"maps of another skin: {sum(rows)} taxels, not {count}", paths[0])
    starts = np.cumsum([0, *rows])
    pieces: dict[str, list[Drawing]] = {}
    left = []
    for found, start, most in zip(files, starts.tolist(), rows, strict=False):
        for one in found.maps:
            fits = map_fits(found, one) if len(found) else len(one.ids) == most
            if not fits:
                left.append(f"{one.name!r} ({len(one.ids)} taxels, the skin has {most})")
                continue
            channels = np.arange(len(one.ids)) + start
            pieces.setdefault(one.name, []).append(Drawing(channels, one.ids, one.uv))
    if not pieces:
        why = f"only of another skin: {', '.join(left)}" if left else "a skin without tactile maps"
        raise DataFormatError(why, paths[0])
    if left:
        warnings.warn(
            f"left out maps of another skin: {', '.join(left)}", SkinWarning, stacklevel=2
        )
    return {name: _joined(own) for name, own in pieces.items()}


def _joined(pieces: Sequence[Drawing]) -> Drawing:
    return Drawing(
        np.concatenate([one.channels for one in pieces]),
        np.concatenate([one.modules for one in pieces]),
        np.concatenate([one.xy for one in pieces]),
    )
