"""Recordings of all formats as sources: MCAP, our .npz, XDF, and what a data dumper wrote."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.errors import (
    DataFormatError,
    MissingFileError,
    SkinMismatchError,
    SkinWarning,
    UnknownNameError,
    check_kind,
)
from skinmap.io.recordings.recorded_stream import (
    Kind,
    RecordedStream,
    Samples,
    StreamInfo,
    warn_of_loss,
)
from skinmap.io.recordings.touch_files import FOREIGN, read_streams
from skinmap.io.ros2.bag import whole
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import check_skin
from skinmap.skin.robot import Robot
from skinmap.skin.skin import fingerprint
from skinmap.touch.recording import Recording

SAME_RATE = 0.01  # share by which the rates of parts may differ that are played together
FORMATS = (
    ".mcap", ".npz", ".xdf", ".xdfz", "data.log", "a folder of data.log files", "a bag of ROS 2",
    *(f"{suffix} with a mapping" for suffix in FOREIGN),
)  # fmt: skip


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
        Speed as a multiple of the recorded one; `inf` gives all at once.
    loop : bool
        Whether it starts again at its end.
    kind : {"raw", "pressure"}, optional
        Which values of an MCAP recording that has both; pressures by default.

    Returns
    -------
    Playback
        Its `read(timeout)` gives blocks of samples (k, channels) when they are due.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or one that does not follow its format.
    UnknownNameError
        A suffix that no reader has, or a part that is not in it.
    SkinMismatchError
        A recording of another skin than the robot's.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> touches = skinmap.simulate(robot.skin("torso"), gestures=["poke"], per_gesture=1, rng=0)
    >>> skinmap.save_recordings(touches, "touches.mcap", robot=robot)
    >>> source = skinmap.live.open_recording("touches.mcap", robot=robot, speed=float("inf"))
    >>> source.read(1.0).values.shape[1] == len(robot.skin("torso"))
    True
    """
    path = Path(path)
    if path.suffix.lower() == ".npz" or path.suffix.lower() in FOREIGN:
        return _open_touches(path, robot, parts, speed=speed, loop=loop)
    track = warn_of_loss(open_track(path, robot=robot, kind=kind), path)
    info, values = track.info, track.values
    if parts is not None:
        info, columns = info.only(parts)
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
        marks=track.touches,
        overview=None if parts is not None else track.overview,
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
    path = whole(path)
    if (streams := read_streams(path, robot)) is not None:
        return streams
    suffix = path.suffix.lower()
    if suffix == ".mcap":
        from skinmap.io.mcap.reading import read_track

        return read_track(path, kind=kind)
    if suffix in FOREIGN or suffix == ".npz":
        from skinmap.io.recordings.touch_files import read_recordings, track_of

        return track_of(read_recordings(path), path)
    check_kind(path, "a recording", *FOREIGN)
    raise UnknownNameError("reader of recordings for", path.name, FORMATS)


class _Columns:
    """Some columns of samples."""

    def __init__(self, values: Samples, columns: NDArray[Any]) -> None:
        self._values, self._columns = values, columns

    def __len__(self) -> int:
        return len(self._values)

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        return self._values[rows][:, self._columns]


def _open_touches(
    path: Path, robot: Robot | None, parts: Sequence[str] | None, *, speed: float, loop: bool
) -> Playback:
    """Play what `skinmap simulate` wrote: all parts begin together, a short one rests at zero."""
    from skinmap.io.recordings.touch_files import read_recordings

    there = {recording.part: recording for recording in read_recordings(path)}
    for part in parts or ():
        if part not in there:
            raise UnknownNameError(f"part in {path}", part, there)
    chosen = [there[part] for part in (parts or there)]
    if not chosen:
        raise DataFormatError("no recording in it", path)
    longest = max(chosen, key=lambda one: len(one.times))
    rate = _rate(longest)
    if len(longest.times) == 0:
        warnings.warn(f"{path.name}: no samples", SkinWarning, stacklevel=3)
    for one in chosen:
        if robot is not None and one.pressures.shape[1] != len(robot.skin(one.part)):
            raise SkinMismatchError(
                f"{path}: {one.pressures.shape[1]} taxels on {one.part!r}, that of "
                f"{robot.name!r} has {len(robot.skin(one.part))}"
            )
        if len(one.times) > 1 and abs(_rate(one) - rate) > SAME_RATE * rate:
            raise DataFormatError(
                f"parts of several rates do not play together: {one.part!r} has {_rate(one):.6g} "
                f"samples a second, {longest.part!r} {rate:.6g}; choose parts",
                path,
            )
    widths = tuple(one.pressures.shape[1] for one in chosen)
    values = np.zeros((len(longest.times), sum(widths)), np.uint8)
    start = 0
    for one, width in zip(chosen, widths, strict=True):
        values[: len(one.pressures), start : start + width] = one.pressures
        start += width
    info = StreamInfo(
        path.name,
        tuple(one.part for one in chosen),
        widths,
        rate,
        robot="" if robot is None else robot.name,
        fingerprints=(
            {} if robot is None else {one.part: fingerprint(robot.skin(one.part)) for one in chosen}
        ),
    )
    return Playback(info, longest.times, values, speed=speed, loop=loop)


def _rate(recording: Recording) -> float:
    """Samples a second; 0 where one sample or none tells nothing."""
    if len(recording.times) < 2:
        return 0.0
    step = float(np.median(np.diff(recording.times)))
    return 1.0 / step if step > 0 else 0.0
