"""Recordings of all formats as sources: MCAP, our .npz, XDF, and what a data dumper wrote."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.errors import MissingFileError, UnknownNameError
from skinmap.io.recordings.recorded_stream import Kind, RecordedStream, Samples
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.skins import check_skin
from skinmap.live.sources.source import StreamInfo
from skinmap.live.sources.touch_archive import open_touches
from skinmap.skin.robot import Robot

FORMATS = (".mcap", ".npz", ".xdf", ".xdfz", "data.log", "a folder of data.log files")


def open_recording(
    path: Path | str,
    *,
    robot: Robot | None = None,
    parts: Sequence[str] | None = None,
    speed: float = 1.0,
    loop: bool = False,
    kind: Kind | None = None,
) -> Playback:
    """Play a recording: a `Seekable` source.

    Parameters
    ----------
    path : Path or str
        MCAP, our .npz, XDF, a `data.log` of iCub's data dumper, or a folder of them.
    robot : Robot, optional
        Whose skin it must be.
    parts : sequence of str, optional
        Only these, in this order.
    speed : float
        How many times faster than recorded; `inf` gives all at once.
    loop : bool
        Whether it starts again at its end.
    kind : {"raw", "pressure"}, optional
        Which values of an MCAP recording that has both; pressures by default.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or one that does not follow its format.
    UnknownNameError
        A suffix that no reader has, or a part that is not in it.
    SkinMismatchError
        A recording of another skin than the robot's.
    """
    path = Path(path)
    if path.suffix.lower() == ".npz":
        return open_touches(path, robot=robot, parts=parts, speed=speed, loop=loop)
    track = open_track(path, robot=robot, kind=kind)
    info = stream_info(track)
    values: Samples = track.values
    if parts is not None:
        columns = np.concatenate([np.r_[info.part_slice(part)] for part in parts])
        info = _only(info, tuple(parts))
        values = _Columns(track.values, columns)
    if robot is not None:
        check_skin(info, robot)
    return Playback(
        info,
        track.times,
        values,
        speed=speed,
        loop=loop,
        joints=track.joints,
        angles=track.angles,
    )


def open_track(
    path: Path, *, robot: Robot | None = None, kind: Kind | None = None
) -> RecordedStream:
    """Read a recording in the format that its name says.

    Parameters
    ----------
    path : Path
    robot : Robot, optional
        Whose parts the files of a dumper's folder, or the streams of an XDF file, are.
    kind : {"raw", "pressure"}, optional

    Raises
    ------
    MissingFileError, DataFormatError, UnknownNameError
        As for `open_recording`.
    """
    if not path.exists():
        raise MissingFileError(path, f"a recording: {', '.join(FORMATS)}")
    suffix = path.suffix.lower()
    if suffix == ".mcap":
        from skinmap.io.recordings.mcap_track import read_track

        return read_track(path, kind=kind)
    if suffix == ".npz":
        from skinmap.io.recordings.touch_files import load_recordings, track_of

        return track_of(load_recordings(path), path)
    if path.is_dir() or suffix == ".log":
        from skinmap.io.recordings.dumper import read_dump

        return read_dump(path, robot=robot)
    if suffix in (".xdf", ".xdfz"):
        from skinmap.io.recordings.xdf import read_xdf

        return read_xdf(path, robot=robot)
    raise UnknownNameError("reader of recordings for", path.name, FORMATS)


def stream_info(track: RecordedStream) -> StreamInfo:
    """What a source says of itself before the first sample."""
    return StreamInfo(
        track.name,
        track.parts,
        track.widths,
        track.rate,
        track.kind,
        track.robot,
        track.fingerprints,
        track.clock,
    )


def _only(info: StreamInfo, parts: tuple[str, ...]) -> StreamInfo:
    widths = dict(zip(info.parts, info.widths, strict=True))
    known = {part: mark for part, mark in info.fingerprints.items() if part in parts}
    return StreamInfo(
        info.name,
        parts,
        tuple(widths[part] for part in parts),
        info.rate,
        info.kind,
        info.robot,
        known,
        info.clock,
    )


class _Columns:
    """Some columns of samples."""

    def __init__(self, values: Samples, columns: NDArray[Any]) -> None:
        self._values, self._columns = values, columns

    def __len__(self) -> int:
        return len(self._values)

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        return self._values[rows][:, self._columns]
