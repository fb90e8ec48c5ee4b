"""Recordings as plain arrays for machine learning, in an NPZ archive.

times (t,), and for each part: PART/values (t, n), PART/events (t,), PART/labels (k,),
PART/subjects (k,), PART/sessions (k,), PART/people (k,), and of its taxels PART/channels,
PART/modules, PART/positions, PART/normals; of touches whose true motion is known (number k)
PART/motions/k/presses (p, 2) and PART/motions/k/way (w, 4), as docs/recordings.md has them;
joints (j,) and angles (t, j) where there are any. The rest is JSON in `about`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.errors import DataFormatError
from skinmap.io.recordings.recorded_stream import (
    PartEvents,
    RecordedStream,
    StreamInfo,
    part_events,
    touches_of,
)
from skinmap.skin.taxels import TaxelTable
from skinmap.touch.true_motion import TrueMotion

FORMAT = "skinmap-arrays-1"
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
