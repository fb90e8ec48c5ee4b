"""Recordings as plain arrays for machine learning: HDF5 and NPZ, the same names in both.

times (t,), and for each part: PART/values (t, n), PART/events (t,), PART/labels (k,),
PART/subjects (k,), PART/sessions (k,), PART/people (k,), and of its taxels PART/channels,
PART/modules, PART/positions, PART/normals; of touches whose true motion is known (number k)
PART/motions/k/presses (p, 2) and PART/motions/k/way (w, 4), as docs/recordings.md has them;
joints (j,) and angles (t, j) where there are any. HDF5 has the rest as attributes, NPZ as JSON in
`about`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.errors import DataFormatError, OutputError
from skinmap.imports import import_optional
from skinmap.io.recordings.recorded_stream import (
    BLOCK,
    PartEvents,
    RecordedStream,
    StreamInfo,
    part_events,
    touches_of,
)
from skinmap.skin.taxels import TaxelTable
from skinmap.touch.recording import TrueMotion

FORMAT = "skinmap-arrays-1"
GZIP = 4
TAXELS = ("channels", "modules", "positions", "normals")  # arrays of a part's taxels


def arrays_of(track: RecordedStream, path: Path) -> Iterator[tuple[str, NDArray[Any]]]:
    """Names and arrays of a recording, all but the values."""
    count = len(track.times)
    yield "times", track.times
    if track.joints:
        yield "joints", np.array(track.joints, np.str_)
        yield "angles", track.angles
    for part, width in zip(track.parts, track.info.widths, strict=True):
        own = min(track.samples.get(part, count), count)
        touches = [one for one in track.touches if one.part == part]
        marked = part_events(touches, own, width, path)
        yield f"{part}/events", np.concatenate([marked.events, np.full(count - own, -1)])
        for name in ("labels", "sessions", "people"):
            yield f"{part}/{name}", np.array(getattr(marked, name), np.str_)
        yield f"{part}/subjects", marked.subjects
        if marked.owners is not None:
            yield f"{part}/owners", marked.owners.astype(np.int8)
        for event, motion in enumerate(marked.motions):
            if motion is not None:
                for name, array in motion.to_arrays().items():
                    yield f"{part}/motions/{event}/{name}", array
        table = track.tables.get(part)
        if table is not None:
            for name in TAXELS:
                yield f"{part}/{name}", getattr(table, name)


def about(track: RecordedStream) -> dict[str, Any]:
    """What is no array."""
    return {
        "format": FORMAT,
        "name": track.info.name,
        "kind": track.kind,
        "robot": track.info.robot,
        "manifest": track.manifest,
        "rate_hz": track.info.rate,
        "clock": track.info.clock,
        "parts": list(track.parts),
        "fingerprints": dict(track.info.fingerprints),
        "samples": dict(track.samples),
        "recovered": track.loss.recovered,
        "lost_seconds": track.loss.seconds,
    }


def write_hdf5(track: RecordedStream, path: Path) -> None:
    """Write HDF5, block by block: a recording need not fit into memory.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    h5py = import_optional("h5py", "HDF5 needs h5py: pip install 'skinmap[hdf5]'")

    try:
        with path.open("w+b", buffering=0) as raw, h5py.File(disk := _Disk(raw), "w") as file:
            for key, value in about(track).items():
                plain = value if isinstance(value, str | int | float) else json.dumps(value)
                file.attrs[key] = plain
            for name, array in arrays_of(track, path):
                kind = h5py.string_dtype() if array.dtype.kind == "U" else array.dtype
                packing = "gzip" if array.ndim and array.size > BLOCK else None
                content = array.astype(object) if array.dtype.kind == "U" else array
                file.create_dataset(name, data=content, dtype=kind, compression=packing)
                disk.check()
            count = len(track.times)
            packed = {"compression": "gzip", "compression_opts": GZIP, "shuffle": True}
            for part, width in zip(track.parts, track.info.widths, strict=True):
                how = {**packed, "chunks": (min(BLOCK, count), width)} if count else {}
                kind = track.values[:1].dtype
                file.create_dataset(f"{part}/values", (count, width), kind, **how)
            for rows, values in track.blocks():
                for part in track.parts:
                    file[f"{part}/values"][rows] = values[:, track.columns(part)]
                disk.check()
    except OSError as error:
        raise OutputError(f"cannot write {str(path)!r}: {error.strerror or error}") from error


class _Disk:
    """A file whose refused writes stay in memory until it is closed: HDF5 crashes where one fails.

    Parameters
    ----------
    file : raw file
        Open for writing and reading, without a buffer.
    """

    def __init__(self, file: Any) -> None:
        self._file = file
        self._refused: OSError | None = None
        self._late: list[tuple[int, bytes]] = []  # what was written since, and where

    def check(self) -> None:
        """Raise what was refused."""
        if self._refused is not None:
            raise self._refused

    def write(self, data: Any) -> int:
        """Write all of it, or keep it."""
        start, whole = self._file.tell(), bytes(data)
        left = memoryview(whole)
        while left and self._refused is None:
            try:
                left = left[self._file.write(left) :]
            except OSError as error:
                self._refused = error
        if self._refused is not None:
            self._late.append((start, whole))
            self._file.seek(start + len(whole))
        return len(whole)

    def readinto(self, buffer: Any) -> int:
        """Read what was written, zeros beyond it."""
        view, start = memoryview(buffer).cast("B"), self._file.tell()
        read = self._file.readinto(view) or 0
        view[read:] = bytes(len(view) - read)
        for place, data in self._late:
            first, last = max(place, start), min(place + len(data), start + len(view))
            if first < last:
                view[first - start : last - start] = data[first - place : last - place]
        self._file.seek(start + len(view))
        return len(view)

    def truncate(self, size: int) -> int:
        """Make the file so long, if it may be."""
        try:
            self._file.truncate(size)
        except OSError as error:
            self._refused = self._refused or error
        return size

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def write_npz(track: RecordedStream, path: Path) -> None:
    """Write a compressed NPZ; the whole recording is in memory meanwhile."""
    arrays = dict(arrays_of(track, path))
    arrays["about"] = np.array(json.dumps(about(track)))
    values = track.values[:]
    for part in track.parts:
        arrays[f"{part}/values"] = values[:, track.columns(part)]
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def track_of_arrays(arrays: Any, path: Path) -> RecordedStream:
    """The whole recording of an NPZ that `write_npz` made.

    Parameters
    ----------
    arrays : numpy.lib.npyio.NpzFile
    path : Path
        For messages.

    Raises
    ------
    DataFormatError
        Another format, or arrays whose lengths differ.
    """
    told: dict[str, Any] = json.loads(str(arrays["about"]))
    if told["format"] != FORMAT:
        raise DataFormatError(f"format {told['format']!r}, expected {FORMAT!r}", path)
    parts = tuple(map(str, told["parts"]))
    times = arrays["times"]
    values = [arrays[f"{part}/values"] for part in parts]
    joints = tuple(map(str, arrays.get("joints", ())))
    angles = arrays.get("angles", np.zeros((0, 0)))
    for what, array in [("angles", angles)] * bool(joints) + list(zip(parts, values, strict=True)):
        if array.ndim != 2 or len(array) != len(times):
            raise DataFormatError(f"{what} of shape {array.shape} for {len(times)} samples", path)
    if joints and angles.shape[1] != len(joints):
        raise DataFormatError(f"{angles.shape[1]} angles for {len(joints)} joints", path)
    return RecordedStream(
        StreamInfo(
            str(told["name"]),
            parts,
            tuple(one.shape[1] for one in values),
            float(told["rate_hz"]),
            told["kind"],
            str(told["robot"]),
            told["fingerprints"],
            str(told["clock"]),
        ),
        times,
        np.concatenate(values, axis=1),
        touches=tuple(
            touch for part in parts for touch in touches_of(part, _events(arrays, part, len(times)))
        ),
        joints=joints,
        angles=angles,
        tables={
            part: TaxelTable(*(arrays[f"{part}/{name}"] for name in TAXELS))
            for part in parts
            if f"{part}/{TAXELS[0]}" in arrays
        },
        samples=told["samples"],
        manifest=str(told.get("manifest", "")),  # files of before have none
    )


def _events(arrays: Any, part: str, count: int) -> PartEvents:
    """Of the first samples of a part."""
    labels, sessions, people = (
        tuple(map(str, arrays.get(f"{part}/{name}", ())))
        for name in ("labels", "sessions", "people")
    )
    nobody = ("",) * len(labels)
    motions = tuple(_motion(arrays, part, event) for event in range(len(labels)))
    return PartEvents(
        arrays[f"{part}/events"][:count],
        labels,
        arrays[f"{part}/subjects"],
        arrays.get(f"{part}/owners", None),
        sessions or nobody,
        people or nobody,
        motions if any(motions) else (),
    )


def _motion(arrays: Any, part: str, event: int) -> TrueMotion | None:
    start = f"{part}/motions/{event}/"
    names = ("presses", "way", "turned")
    if start + "way" not in arrays:
        return None
    return TrueMotion.from_arrays({name: arrays[start + name] for name in names})
