"""Open a source by what a user types.

`sim`, `mujoco:FILE`, `lsl:NAME`, `zmq:HOST:PORT`, `zenoh:/TOPIC`, a file, a plug-in. Recordings of
all formats are sources: MCAP, our .npz, XDF, and what a data dumper wrote.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from skinmap.errors import (
    KINDS,
    BrokenPluginError,
    InvalidArrayError,
    MissingFileError,
    UnknownNameError,
    check_kind,
)
from skinmap.io.mcap.reading import read_track
from skinmap.io.recordings.recorded_stream import Kind, RecordedStream, Samples, warn_of_loss
from skinmap.io.recordings.touch_files import (
    FOREIGN,
    at_one_clock,
    exported_track,
    find_mapping,
    is_own_archive,
    read_recordings,
    read_streams,
    track_of,
)
from skinmap.io.robots.manifest import load_robot
from skinmap.io.ros2.bag import whole
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import Source, check_skin, describe_skins
from skinmap.registry import Registry
from skinmap.skin.robot import Robot

SEED = "seed="  # a word of the simulator's address
FILES = (*KINDS["a recording"], *FOREIGN)


# What an entry point of the group `skinmap.sources` names: it is called with an address, and the
# keywords robot, parts, seed, speed and loop. The address is what follows the colon of
# "name:address", empty where there is none. The rest is what the user asked for; what makes no
# sense for a source is left alone.
sources: Registry[Callable[..., Source]] = Registry(
    "source",
    "skinmap.sources",
    built_in={
        "sim": "skinmap.live.sources.open_source:_simulated",
        "lsl": "skinmap.live.network.lsl_stream:open_lsl",
        "mujoco": "skinmap.live.sources.mujoco_source:open_mujoco",
        "zenoh": "skinmap.live.network.zenoh_stream:open_zenoh",
        "zmq": "skinmap.live.network.zmq_stream:open_zmq",
    },
)


def open_source(
    spec: str | Path,
    *,
    robot: Robot | str | None = None,
    parts: Sequence[str] | None = None,
    seed: int = 0,
    speed: float = 1.0,
    loop: bool = False,
) -> Source:
    """Open a source of samples.

    Parameters
    ----------
    spec : str or Path
        "sim" or "sim:raw,seed=3,poke,stroke" (raw values, a seed, only these gestures),
        "mujoco:FILE", "lsl:NAME", "zmq:HOST:PORT", "zenoh:", a recording (.npz, .mcap, .xdf, a
        data dumper's folder or data.log, a bag of ROS 2), or "NAME" or "NAME:ADDRESS" of the
        group `skinmap.sources`. A name wins over a file of that name; "./sim" is the file.
    robot : Robot or str, optional
        Whose skin it must be; the simulator touches the iCub where none is given.
    parts : sequence of str, optional
        Only these, where the source can choose.
    seed : int
        Of the simulator.
    speed : float
        Of the simulator and of recordings; `inf` as fast as asked.
    loop : bool
        Whether a recording starts again at its end.

    Returns
    -------
    Source
        Open; `read(timeout)` gives blocks of samples (k, channels), `close()` ends it.

    Raises
    ------
    UnknownNameError
        No such source, stream or part (lists those that exist).
    MissingFileError, DataFormatError
        No such file, or not a recording.
    SkinMismatchError
        A source of another skin than the robot's.
    UnreachableError
        Nothing answers at an address.
    BrokenPluginError
        A plug-in that gives something else than a `Source`.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> source = skinmap.open_source("sim", robot=robot, parts=["torso"], speed=float("inf"))
    >>> source.read(1.0).values.shape[1] == len(robot.skin("torso"))
    True
    >>> source.close()
    """
    robot = resolve_robot(robot)
    if isinstance(spec, str):
        name, _, address = spec.partition(":")
        if name in sources.names():
            open_one = sources.get(name)
            made = open_one(address, robot=robot, parts=parts, seed=seed, speed=speed, loop=loop)
            if not isinstance(made, Source):
                raise BrokenPluginError(
                    f"{name!r} gives a {type(made).__name__}, which does not derive from "
                    "skinmap.live.Source (docs/live.md)"
                )
            return made
    path = Path(spec)
    if not path.exists():
        if path.suffix.lower() in FILES or path.name != str(spec):
            raise MissingFileError(path, "a recording")
        raise UnknownNameError("source", str(spec), (*sources.names(), "a recording's file"))
    return open_recording(path, robot=robot, parts=parts, speed=speed, loop=loop)


def resolve_robot(robot: Robot | str | Path | None) -> Robot | None:
    """A robot by its name, or the robot itself."""
    if robot is None or isinstance(robot, Robot):
        return robot
    return load_robot(robot)


def _simulated(address: str, *, robot: Robot | None, seed: int, loop: bool, **wish: Any) -> Source:
    from skinmap.live.sources.simulated_source import SimulatedSource
    from skinmap.touch.simulation.hands import NAMES

    words = [word for word in address.split(",") if word]
    seeds = [word.removeprefix(SEED) for word in words if word.startswith(SEED)]
    names = tuple(one for one in words if one != "raw" and not one.startswith(SEED))
    unknown = [name for name in names if name not in NAMES]
    if unknown or not all(one.isascii() and one.isdecimal() for one in seeds):
        raise InvalidArrayError(
            f"the simulator is 'sim', or 'sim:' with raw, seed=N and gestures, commas between; not "
            f"'sim:{address}'; gestures: {', '.join(NAMES)}"
        )
    seed = int(seeds[-1]) if seeds else seed
    kind: Kind = "raw" if "raw" in words else "pressure"
    robot = robot or load_robot("icub")
    return SimulatedSource(robot, seed=seed, kind=kind, gestures=names, **wish)


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
    info = track.info
    if parts is not None:
        info, columns = info.only(parts)
        track = replace(track, values=_Columns(track.values, columns), overview=None)
    if robot is not None:
        check_skin(info, robot)
        skins = [robot.skin(part) for part in info.parts]
        dense = [len(skin) for skin in skins] == list(info.widths)
        if dense and path.suffix.lower() in TOUCHES:
            info = describe_skins(info.name, robot.name, skins, info.rate, info.kind, info.clock)
    return Playback(replace(track, info=info), speed=speed, loop=loop)


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
        return read_track(path, kind=kind)
    if suffix in TOUCHES:
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
