"""Recordings as plain arrays for machine learning: HDF5 and NPZ, the same names in both.

times (t,), and for each part: PART/values (t, n), PART/events (t,), PART/labels (k,),
PART/subjects (k,), PART/sessions (k,), PART/people (k,), and of its taxels PART/channels,
PART/modules, PART/positions, PART/normals; of touches whose true motion is known (number k)
PART/motions/k/presses (p, 2) and PART/motions/k/way (w, 4), as docs/recordings.md has them;
joints (j,) and angles (t, j) where there are any. HDF5 has the rest as attributes, NPZ as JSON in
`about`.

A LeRobot data set of version 3 has frames and tasks in Parquet and the rest in JSON.

One recording is one episode. A frame holds the values of each part, the joint angles, and as its
task the names of what touches then. `meta/skin.json` holds the place of each taxel, and each touch
with its frames and, where a model answered, its kind, its motion and whether it is a hand.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DataFormatError, OutputError, warn
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
                bare = isinstance(value, str | int | float)
                file.attrs[key] = value if bare else json.dumps(value)
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


DATA = "data/chunk-000/file-000.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
NO_TOUCH = "no touch"
PRESSURES, STATE, TIME = "observation.tactile", "observation.state", "observation.time"
COUNTERS = ("frame_index", "episode_index", "index", "task_index")


def write_lerobot(track: RecordedStream, folder: Path) -> None:
    """Write a data set.

    Parameters
    ----------
    track : RecordedStream
    folder : Path
        Made where it is not there.

    Raises
    ------
    MissingLibraryError
        The package `pyarrow` is not installed.
    DataFormatError
        No sample, or no rate.
    """
    need = "a LeRobot data set needs pyarrow: pip install 'skinmap[lerobot]'"
    pa, pq = import_optional("pyarrow", need), import_optional("pyarrow.parquet", need)
    fps = round(track.info.rate)
    if any(touch.motion is not None for touch in track.touches):
        warn("a LeRobot data set does not keep the true motion of touches, .mcap, .npz and .h5 do")
    if len(track.times) == 0 or fps < 1:
        raise DataFormatError(f"{len(track.times)} samples at {track.info.rate:g} Hz", folder)
    _warn_of_times(track.times, fps)
    angles = _held_angles(track) if track.joints else track.angles
    tasks, task_of = _tasks(track)
    features = _features(track)
    for file in (DATA, EPISODES):
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
    statistics = {name: _Statistics() for name in features}
    schema = _schema(features, pa)
    with pq.ParquetWriter(folder / DATA, schema) as writer:
        for columns in _blocks(track, fps, task_of, angles):
            for name, values in columns.items():
                statistics[name].add(values)
            arrays = [_arrow(columns[name], schema.field(name).type, pa) for name in schema.names]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
    stats = {name: one.result() for name, one in statistics.items()}
    pq.write_table(_episode(len(track.times), tasks, stats, pa), folder / EPISODES)
    pq.write_table(_task_table(tasks, pa), folder / "meta" / "tasks.parquet")
    _json(folder / "meta" / "info.json", _info(track, fps, len(tasks), features))
    _json(folder / "meta" / "stats.json", stats)
    _json(folder / "meta" / "skin.json", _skin(track))


def _warn_of_times(times: FloatArray, fps: int) -> None:
    """LeRobot has one whole rate: `timestamp` is the number of the frame by it."""
    off = np.abs(times - times[0] - np.arange(len(times)) / fps).max()
    if off > 1.5 / fps:
        warn(
            f"LeRobot counts frames at a whole rate ({fps} a second): its `timestamp` is up to "
            f"{off:.3g} s off the recorded times, which `{TIME}` keeps",
            above=1,
        )


def _held_angles(track: RecordedStream) -> FloatArray:
    """Joint angles (t, j); where one was not recorded, the known one nearest before, else after."""
    rows, known = np.arange(len(track.times)), np.isfinite(track.angles)
    missing = [name for name, one in zip(track.joints, known.T, strict=True) if not one.all()]
    if missing:
        warn(
            f"angles of {', '.join(missing[:4])} are missing in some samples: the last known one "
            f"stands there, 0 where none is known",
            above=1,
        )
    before = np.maximum.accumulate(np.where(known, rows[:, None], -1), axis=0)
    place = np.where(before < 0, known.argmax(axis=0), before)
    return np.nan_to_num(np.take_along_axis(track.angles, place, axis=0))


def _features(track: RecordedStream) -> dict[str, dict[str, Any]]:
    """Name, type and shape of each column, as `info.json` has them."""
    features: dict[str, dict[str, Any]] = {}
    for part, width in zip(track.parts, track.info.widths, strict=True):
        table = track.tables.get(part)
        known = range(width) if table is None or len(table) != width else table.channels.tolist()
        names = [f"{part}_{channel}" for channel in known]
        features[f"{PRESSURES}.{part}"] = {"dtype": "float32", "shape": [width], "names": names}
    if track.joints:
        shape, names = [len(track.joints)], list(track.joints)
        features[STATE] = {"dtype": "float32", "shape": shape, "names": names}
    features[TIME] = {"dtype": "float64", "shape": [1], "names": None}
    features["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
    for name in COUNTERS:
        features[name] = {"dtype": "int64", "shape": [1], "names": None}
    return features


def _blocks(
    track: RecordedStream, fps: int, task_of: IntArray, angles: FloatArray
) -> Iterator[dict[str, NDArray[Any]]]:
    """Columns of the frames, some at a time."""
    for rows, values in track.blocks():
        index = np.arange(rows.start, rows.stop)
        columns: dict[str, NDArray[Any]] = {
            f"{PRESSURES}.{part}": values[:, track.columns(part)].astype(np.float32)
            for part in track.parts
        }
        if track.joints:
            columns[STATE] = angles[rows].astype(np.float32)
        columns[TIME] = track.times[rows]
        columns["timestamp"] = (index / fps).astype(np.float32)
        columns |= dict.fromkeys(("frame_index", "index"), index)
        columns |= {"episode_index": 0 * index, "task_index": task_of[rows]}
        yield columns


def _tasks(track: RecordedStream) -> tuple[list[str], IntArray]:
    """What touches, as words, and which of them each frame (t,) has."""
    words: list[list[str]] = [[] for _ in track.times]
    for touch in track.touches:
        for row in range(touch.first, touch.last + 1):
            words[row].append(f"{touch.label} on {touch.part}")
    said = [" and ".join(sorted(set(one))) or NO_TOUCH for one in words]
    tasks = list(dict.fromkeys(said))
    place = {task: number for number, task in enumerate(tasks)}
    return tasks, np.array([place[one] for one in said], np.int64)


class _Statistics:
    """Smallest, largest, mean and deviation of a column, over blocks."""

    def __init__(self) -> None:
        self._count = 0
        self._zero: Any = 0.0
        self._low: Any = np.inf
        self._high: Any = -np.inf
        self._sum: Any = 0.0
        self._squares: Any = 0.0

    def add(self, values: NDArray[Any]) -> None:
        rows = values.reshape(len(values), -1).astype(np.float64)
        if self._count == 0:
            self._zero = rows[0].copy()  # squares of times since 1970 would leave no deviation
        self._count += len(rows)
        self._low = np.minimum(self._low, rows.min(axis=0))
        self._high = np.maximum(self._high, rows.max(axis=0))
        rows -= self._zero
        self._sum = self._sum + rows.sum(axis=0)
        self._squares = self._squares + (rows**2).sum(axis=0)

    def result(self) -> dict[str, list[float]]:
        mean = self._sum / self._count
        deviation = np.sqrt(np.maximum(self._squares / self._count - mean**2, 0.0))
        return {
            "min": self._low.tolist(),
            "max": self._high.tolist(),
            "mean": (mean + self._zero).tolist(),
            "std": deviation.tolist(),
            "count": [self._count],
        }


def _schema(features: Mapping[str, Mapping[str, Any]], pa: Any) -> Any:
    kinds = {"float32": pa.float32(), "float64": pa.float64(), "int64": pa.int64()}
    fields = []
    for name, one in features.items():
        kind = kinds[one["dtype"]]
        many = one["names"] is not None
        fields.append(pa.field(name, pa.list_(kind, one["shape"][0]) if many else kind))
    return pa.schema(fields)


def _arrow(values: NDArray[Any], kind: Any, pa: Any) -> Any:
    if values.ndim == 1:
        return pa.array(values, kind)
    flat = pa.array(np.ascontiguousarray(values).ravel(), kind.value_type)
    return pa.FixedSizeListArray.from_arrays(flat, values.shape[1])


def _episode(
    frames: int, tasks: list[str], stats: Mapping[str, Mapping[str, list[float]]], pa: Any
) -> Any:
    """The one row of the table of episodes."""
    columns: dict[str, Any] = {
        "episode_index": pa.array([0], pa.int64()),
        "tasks": pa.array([tasks], pa.list_(pa.string())),
        "length": pa.array([frames], pa.int64()),
        "dataset_from_index": pa.array([0], pa.int64()),
        "dataset_to_index": pa.array([frames], pa.int64()),
    }
    for place in ("data", "meta/episodes"):
        for name in ("chunk_index", "file_index"):
            columns[f"{place}/{name}"] = pa.array([0], pa.int64())
    for feature, one in stats.items():
        for key, numbers in one.items():
            kind = pa.int64() if key == "count" else pa.float64()
            columns[f"stats/{feature}/{key}"] = pa.array([numbers], pa.list_(kind))
    return pa.table(columns)


def _task_table(tasks: list[str], pa: Any) -> Any:
    """The tasks by number; pandas, which LeRobot reads it with, takes the words for its index."""
    table = pa.table({"task_index": list(range(len(tasks))), "task": tasks})
    return table.replace_schema_metadata({b"pandas": json.dumps(_fixed("pandas")).encode()})


def _info(
    track: RecordedStream, fps: int, tasks: int, features: Mapping[str, Any]
) -> dict[str, Any]:
    return _fixed("info") | {
        "robot_type": track.info.robot,
        "total_frames": len(track.times),
        "total_tasks": tasks,
        "fps": fps,
        "features": dict(features),
    }


def _fixed(name: str) -> dict[str, Any]:
    """What of a file is the same in all data sets: version and limits, columns of the tasks."""
    held = json.loads(Path(__file__).with_name("lerobot.json").read_text(encoding="utf-8"))
    return dict(held[name])


def _skin(track: RecordedStream) -> dict[str, Any]:
    """What is said of the recording, and the taxels of each part [m]."""
    parts = {}
    for part, width in zip(track.parts, track.info.widths, strict=True):
        table = track.tables.get(part)
        parts[part] = {"columns": width, "column_of_values": f"{PRESSURES}.{part}"}
        if table is not None:
            dense = width == len(table)
            parts[part] |= {
                "link": table.link,
                "taxel_column": list(range(width)) if dense else table.channels.tolist(),
                "channels": table.channels.tolist(),
                "modules": table.modules.tolist(),
                "positions_m": table.positions.tolist(),
                "normals": table.normals.tolist(),
            }
    touches = [
        {
            "part": one.part,
            "label": one.label,
            "first_frame": one.first,
            "last_frame": one.last,
            **(one.answers or dict.fromkeys(("kind", "motion", "hand"))),
        }
        for one in track.touches
    ]
    return {**about(track), "taxels": parts, "touches": touches}


def _json(file: Path, content: object) -> None:
    file.write_text(json.dumps(content, indent=1) + "\n")
