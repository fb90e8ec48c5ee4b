"""Recordings as a Zarr store: the arrays of `skinmap.io.recordings.learning`, chunk by chunk."""

from __future__ import annotations

from pathlib import Path

from skinmap.imports import import_optional
from skinmap.io.recordings.learning import about, arrays_of
from skinmap.io.recordings.recorded_stream import BLOCK, RecordedStream


def write_zarr(track: RecordedStream, folder: Path) -> None:
    """Write a Zarr store of format 3; texts and what is no array are its attributes.

    Raises
    ------
    MissingLibraryError
        The package `zarr` is not installed.
    """
    zarr = import_optional("zarr", "a Zarr store needs zarr: pip install 'skinmap[zarr]'")
    group = zarr.create_group(folder, overwrite=True)
    words = about(track)
    for name, array in arrays_of(track, folder):
        if array.dtype.kind == "U":
            words[name] = array.tolist()
        else:
            group.create_array(name, data=array)
    kind = track.values[:1].dtype
    count = len(track.times)
    stores = {
        part: group.create_array(
            f"{part}/values",
            shape=(count, width),
            chunks=(max(min(BLOCK, count), 1), width),
            dtype=kind,
        )
        for part, width in zip(track.parts, track.info.widths, strict=True)
    }
    for rows, values in track.blocks():
        for part in track.parts:
            stores[part][rows] = values[:, track.columns(part)]
    group.attrs.update(words)
