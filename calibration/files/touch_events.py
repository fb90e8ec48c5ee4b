"""Events of self-touch in a recording of samples: two parts pressed at the same time, and the pose.

While the same two parts are active a contact lasts. Its firmest sample stands for it; where the
robot slides or rolls along itself, each few degrees of any joint begin another.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.files.probe_file import Probe
from calibration.mount.chains import TouchRecording
from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import DataFormatError
from skinmap.io.recordings.recorded_stream import RecordedStream

ACTIVE = 10  # counts: above what response calibration leaves of noise (4), below a light touch
ROLLED = np.deg2rad(4.0)  # how far a joint turns until a contact counts as another


def track_events(
    track: RecordedStream, probes: Mapping[str, Probe], path: Path
) -> list[TouchRecording]:
    """The contacts of a recording, one `TouchRecording` for each two sides that touched.

    Touches that are marked with the name of a probe, or that only one part felt where there is one
    probe and no two parts ever touched, are of that probe.

    Raises
    ------
    DataFormatError
        No joint angles, raw values, or no contact of two sides.
    """
    if not track.joints or not np.isfinite(track.angles).all(axis=1).any():
        raise DataFormatError(
            "a recording without joint angles; self-touch needs the pose of every sample", path
        )
    if track.kind != "pressure":
        raise DataFormatError(
            "holds raw values only; record pressures (`skinmap record` with --model or --label)",
            path,
        )
    force = _force(track)
    known: BoolArray = np.asarray(np.isfinite(track.angles).all(axis=1))
    sides = _sides(track, probes, force > 0)
    contacts: dict[tuple[str, str], list[int]] = {}
    for start, stop in _spans(sides, known, track.angles):
        pair = sides[start]
        if pair is not None:
            columns = [track.parts.index(name) for name in pair if name in track.parts]
            firmest = start + int(np.argmax(force[start:stop, columns].min(axis=1)))
            contacts.setdefault(pair, []).append(firmest)
    if not contacts:
        raise DataFormatError(
            f"no two of its parts ({', '.join(track.parts)}) were pressed at the same time, and "
            "no touch is marked with the name of a probe",
            path,
        )
    return [
        _recording(
            track, pair, rows, path.stem if len(contacts) == 1 else f"{path.stem}:{'-'.join(pair)}"
        )
        for pair, rows in contacts.items()
    ]


def lone_touches(track: RecordedStream, found: Sequence[TouchRecording], path: Path) -> list[str]:
    """A note on touches that one part felt alone, and that were left out."""
    if any(side is None for one in found for side in one.touched):
        return []
    lone = (_force(track) > 0).sum(axis=1) == 1
    count = int((np.diff(lone.astype(int), prepend=0) == 1).sum())
    if count == 0:
        return []
    return [f"{path.name}: {count} touches that one part felt alone were left out"]


def _force(track: RecordedStream) -> FloatArray:
    """Counts (t, parts) above what is noise, summed over each part."""
    values = np.asarray(track.values[:], np.float64)
    values = np.where(values > ACTIVE, values, 0.0)
    return np.stack([values[:, track.columns(part)].sum(axis=1) for part in track.parts], axis=1)


def _sides(
    track: RecordedStream, probes: Mapping[str, Probe], active: BoolArray
) -> list[tuple[str, str] | None]:
    """The two sides of each sample; None where nothing, one part or more than two are pressed."""
    marked: dict[int, str] = {}
    for touch in track.touches:
        if touch.label in probes:
            marked |= dict.fromkeys(range(touch.first, touch.last + 1), touch.label)
    count = active.sum(axis=1)
    only = next(iter(probes)) if len(probes) == 1 and not marked and (count < 2).all() else ""
    found: list[tuple[str, str] | None] = []
    for row, own in enumerate(active):
        parts = [track.parts[k] for k in np.flatnonzero(own)]
        probe = marked.get(row, only)
        if len(parts) == 2 and not probe:
            found.append((parts[0], parts[1]))
        elif len(parts) == 1 and probe:
            found.append((probe, parts[0]))
        else:
            found.append(None)
    return found


def _spans(
    sides: Sequence[tuple[str, str] | None], known: BoolArray, angles: FloatArray
) -> Iterator[tuple[int, int]]:
    """First sample of each contact and the one after its last."""
    cuts = [0]
    for row in range(1, len(sides)):
        other = sides[row] != sides[row - 1] or known[row] != known[row - 1]
        if other or (known[row] and np.abs(angles[row] - angles[cuts[-1]]).max() > ROLLED):
            cuts.append(row)
    for start, stop in pairwise([*cuts, len(sides)]):
        if known[start] and sides[start] is not None:
            yield start, stop


def _recording(
    track: RecordedStream, pair: tuple[str, str], rows: Sequence[int], name: str
) -> TouchRecording:
    """The active channels of both sides in some samples."""
    values = np.stack([np.asarray(track.values[row : row + 1])[0] for row in rows])
    first, second = (
        _channels(track, side, values) if side in track.parts else None for side in pair
    )
    return TouchRecording(name, pair, track.angles[np.array(rows)], (first, second))


def _channels(track: RecordedStream, part: str, values: NDArray[np.generic]) -> list[IntArray]:
    """Channels of a part above the noise in each of some samples."""
    own = values[:, track.columns(part)]
    table = track.tables.get(part)
    dense = table is not None and len(table.channels) == own.shape[1]
    names = table.channels if table is not None and dense else np.arange(own.shape[1])
    return [np.asarray(names[np.flatnonzero(row > ACTIVE)], np.int64) for row in own]
