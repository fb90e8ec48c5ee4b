"""Open a source by what a user types.

`sim`, `mujoco:FILE`, `lsl:NAME`, `zmq:HOST:PORT`, `zenoh:/TOPIC`, a file, a plug-in.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from skinmap.errors import BrokenPluginError, InvalidArrayError, MissingFileError, UnknownNameError
from skinmap.io.robots.manifest import load_robot
from skinmap.live.sources.source import Kind, Source
from skinmap.registry import Registry
from skinmap.skin.robot import Robot

SEED = "seed="  # a word of the simulator's address
FILES = (".npz", ".mcap", ".xdf", ".log", ".db3", ".csv", ".tsv", ".txt")


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
    from skinmap.live.sources.open_recording import open_recording

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
    raw = "raw" in words
    seeds = [word.removeprefix(SEED) for word in words if word.startswith(SEED)]
    names = tuple(one for one in words if one != "raw" and not one.startswith(SEED))
    unknown = [name for name in names if name not in NAMES]
    if unknown or not all(one.isascii() and one.isdecimal() for one in seeds):
        raise InvalidArrayError(
            f"the simulator is 'sim', or 'sim:' with raw, seed=N and gestures, commas between; not "
            f"'sim:{address}'; gestures: {', '.join(NAMES)}"
        )
    seed = int(seeds[-1]) if seeds else seed
    kind: Kind = "raw" if raw else "pressure"
    robot = robot or load_robot("icub")
    return SimulatedSource(robot, seed=seed, kind=kind, gestures=names, **wish)
