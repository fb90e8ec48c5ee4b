"""Recordings of all formats as sources: MCAP, our .npz, XDF, and what a data dumper wrote."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from skinmap.errors import MissingFileError, UnknownNameError, check_kind
from skinmap.io.recordings.mapping import find_mapping, is_own_archive
from skinmap.io.recordings.recorded_stream import (
    Kind,
    RecordedStream,
    Samples,
    warn_of_loss,
)
from skinmap.io.recordings.touch_files import FOREIGN, exported_track, read_streams
from skinmap.io.ros2.bag import whole
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import check_skin, describe_skins
from skinmap.skin.robot import Robot

TOUCHES = (".npz", *FOREIGN)  # recordings of dense taxels
FORMATS = (
    ".mcap", ".npz", ".xdf", "data.log", "a folder of data.log files", "a bag of ROS 2",
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
    track = warn_of_loss(open_track(path, robot=robot, kind=kind, parts=parts), path)
    info, values = track.info, track.values
    if parts is not None:
        info, columns = info.only(parts)
        values = _Columns(track.values, columns)
    if robot is not None:
        check_skin(info, robot)
        skins = [robot.skin(part) for part in info.parts]
        dense = [len(skin) for skin in skins] == list(info.widths)
        if dense and path.suffix.lower() in TOUCHES:
            info = describe_skins(info.name, robot.name, skins, info.rate, info.kind, info.clock)
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
    path: Path,
    *,
    robot: Robot | None = None,
    kind: Kind | None = None,
    parts: Sequence[str] | None = None,
) -> RecordedStream:
    """Read a recording in the format that its name says.

    Parameters
    ----------
    path : Path
    robot : Robot, optional
        Whose parts the files of a dumper's folder, or the streams of an XDF file, are.
    kind : {"raw", "pressure"}, optional
    parts : sequence of str, optional
        Of recordings one beside the other, only these need to fit in time.

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
    if suffix in TOUCHES:
        from skinmap.io.recordings.touch_files import at_one_clock, read_recordings, track_of

        own = is_own_archive(path) and path.is_file() and find_mapping(path) is None
        if own and (track := exported_track(path)):  # of `skinmap export`
            return track
        found = read_recordings(path)
        chosen = [one for one in found if one.part in (parts or ())] or found
        return track_of(at_one_clock(chosen), path)
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
