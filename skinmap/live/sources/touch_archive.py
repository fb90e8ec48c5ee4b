"""Recordings of simulated touches (.npz), played back with all parts together."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from skinmap.errors import DataFormatError, SkinMismatchError, UnknownNameError
from skinmap.io.recordings.touch_files import load_recordings
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import StreamInfo
from skinmap.skin.fingerprint import fingerprint
from skinmap.skin.robot import Robot
from skinmap.touch.recording import Recording

SAME_RATE = 0.01  # share by which the rates of parts may differ that are played together


def open_touches(
    path: Path,
    *,
    robot: Robot | None = None,
    parts: Sequence[str] | None = None,
    speed: float = 1.0,
    loop: bool = False,
) -> Playback:
    """Play what `skinmap simulate` wrote: all parts begin together, a short one rests at zero.

    Parameters
    ----------
    path : Path
    robot : Robot, optional
        Whose skin it must be.
    parts : sequence of str, optional
        Only these.
    speed, loop
        As for `Playback`.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or not such a recording.
    UnknownNameError
        A part that is not in it.
    SkinMismatchError
        A part with another number of taxels than the robot's.
    """
    there = {recording.part: recording for recording in load_recordings(path)}
    for part in parts or ():
        if part not in there:
            raise UnknownNameError(f"part in {path}", part, there)
    chosen = [there[part] for part in (parts or there)]
    if not chosen:
        raise DataFormatError("no recording in it", path)
    longest = max(chosen, key=lambda one: len(one.times))
    rate = _rate(longest)
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
