"""Where a skin was touched over a recording or many: how often, how long, how hard, when last."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DataFormatError, MissingFileError, SkinMismatchError, warn
from skinmap.io.recordings.touch_files import find_mapping, is_foreign, recorded_robot
from skinmap.io.ros2.bag import METADATA, is_mapped, recordings_under
from skinmap.live.loop import TouchLoop
from skinmap.live.response.pressures import Response
from skinmap.live.sources.source import Source
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import PreparedSkin

BRIDGE = 0.1  # a taxel that is not touched for longer is touched anew [s], as contacts are
LONGEST = 0.2  # that a sample stands for: what comes later comes after a gap [s]
SINCE_EPOCH = 1e8  # from which a time is one of day and not that of a sensor's own clock [s]
LEAST = 2  # samples of a touch: one alone is a spike
SUFFIXES = (".mcap", ".npz", ".xdf", ".log", ".db3")
COLUMNS = "part,channel,count,dwell_s,largest,last_s,recording"


@dataclass(eq=False, slots=True)
class TouchedPart:
    """What the n taxels of a part went through.

    Attributes
    ----------
    count : (n,) int
        Touches that a taxel was part of.
    dwell : (n,) float
        How long it was touched [s].
    largest : (n,) float
        Largest pressure while it was touched [counts].
    last : (n,) float
        When it was touched last, from the beginning of that recording [s]; NaN where never.
    recording : (n,) int
        Which recording that was, counted from 0; -1 where none.
    """

    count: IntArray
    dwell: FloatArray
    largest: FloatArray
    last: FloatArray
    recording: IntArray

    @classmethod
    def of(cls, n: int) -> TouchedPart:
        """Of n taxels that were never touched."""
        return cls(np.zeros(n, int), np.zeros(n), np.zeros(n), np.full(n, np.nan), np.full(n, -1))

    def add(self, other: TouchedPart, rows: slice, begins: Sequence[float]) -> None:
        """Add what some rows (n) of the last recording went through.

        It is the later one unless both begin (`begins` [s]) at a time of day.
        """
        self.count += other.count[rows]
        self.dwell += other.dwell[rows]
        self.largest = np.maximum(self.largest, other.largest[rows])
        before = np.asarray(begins)[self.recording]
        known = (self.recording >= 0) & (before > SINCE_EPOCH) & (begins[-1] > SINCE_EPOCH)
        seen = (other.count[rows] > 0) & ~(known & (before > begins[-1]))
        self.last[seen] = other.last[rows][seen]
        self.recording[seen] = other.recording[rows][seen]


@dataclass(eq=False, slots=True)
class Touched:
    """Sums over recordings of one robot.

    Attributes
    ----------
    skins : mapping of str to PreparedSkin
    parts : dict of str to TouchedPart
        Those that a recording has.
    recordings : list of str
        Names of what was added.
    begins : list of float
        Time of the first sample of each [s].
    seconds : float
        That were watched.
    """

    skins: Mapping[str, PreparedSkin]
    parts: dict[str, TouchedPart] = field(default_factory=dict)
    recordings: list[str] = field(default_factory=list)
    begins: list[float] = field(default_factory=list)
    seconds: float = 0.0

    def add(self, loop: TouchLoop, name: str) -> None:
        """Add all that a loop's source has; the loop has learnt what hangs."""
        first = before = math.nan
        sizes = [len(skin) for skin in loop.skins.values()]
        found = TouchedPart.of(sum(sizes))
        # Of the touch of each taxel that lasts: its last time, its samples, how long, how hard.
        last, run = np.zeros(sum(sizes)), np.zeros((3, sum(sizes)))
        step = 1.0 / loop.info.rate if loop.info.rate > 0 else 0.02

        def end(taxels: IntArray) -> None:
            over = taxels[run[0, taxels] >= LEAST]
            found.count[over] += 1
            found.dwell[over] += run[1, over]
            found.largest[over] = np.maximum(found.largest[over], run[2, over])
            found.last[over] = last[over] - first
            run[:, taxels] = 0

        for anew, times, touched, stuck in loop.touched_samples():
            if anew:
                end(np.flatnonzero(run[0]))
                before = math.nan
            first = float(times[0]) if math.isnan(first) else first
            spans = np.diff(times, prepend=times[0] - step if math.isnan(before) else before)
            spans = np.clip(np.where(spans > LONGEST, step, spans), 0.0, LONGEST)
            self.seconds += float(spans.sum())
            before = float(times[-1])
            run[:, stuck] = 0  # what hangs was no touch
            on = (touched > 0) & ~stuck
            for row in np.flatnonzero(on.any(axis=1)).tolist():
                taxels = np.flatnonzero(on[row])
                lasting = taxels[run[0, taxels] > 0]
                end(lasting[times[row] - last[lasting] - spans[row] > BRIDGE])
                last[taxels] = times[row]
                run[0, taxels] += 1
                run[1, taxels] += spans[row]
                run[2, taxels] = np.maximum(run[2, taxels], touched[row, taxels])
        end(np.flatnonzero(run[0]))
        found.recording[found.count > 0] = len(self.recordings)
        self.recordings.append(name)
        self.begins.append(first)
        for part, size, end_of in zip(loop.skins, sizes, np.cumsum(sizes).tolist(), strict=True):
            mine = self.parts.setdefault(part, TouchedPart.of(size))
            mine.add(found, slice(end_of - size, end_of), self.begins)

    def csv(self) -> str:
        """A line for each taxel of each part, see `COLUMNS`."""
        lines = [COLUMNS]
        for part, one in self.parts.items():
            for row, channel in enumerate(self.skins[part].skin.channels.tolist()):
                known = one.recording[row] >= 0
                last = f"{one.last[row]:.3f}" if known else ""
                name = self.recordings[one.recording[row]] if known else ""
                quoted = f'"{name}"' if "," in name else name
                lines.append(
                    f"{part},{channel},{one.count[row]},{one.dwell[row]:.3f},"
                    f"{one.largest[row]:.1f},{last},{quoted}"
                )
        return "\n".join(lines) + "\n"


def recordings_of(path: Path) -> list[Path]:
    """The recording, or those in a folder and the folders in it, by their names.

    Files of a folder that cannot be read are left out with a warning.

    Raises
    ------
    MissingFileError
        A folder without any.
    DataFormatError
        A folder of which none can be read.
    """
    if not path.is_dir() or (path / "data.log").exists() or (path / METADATA).is_file():
        return [path]
    found = sorted(
        one
        for one in recordings_under(path)
        if one.suffix.lower() in SUFFIXES
        or is_mapped(one)
        or (is_foreign(one) and not _places_taxels(one))
        if not any(word.startswith(".") for word in one.relative_to(path).parts)
    )
    if not found:
        raise MissingFileError(path, f"recordings ({', '.join(SUFFIXES)}) in this folder")
    return _readable(found, recorded_robot)[0]


def _places_taxels(path: Path) -> bool:
    """Whether a file is a taxel table, which may lie beside recordings and their mapping."""
    with path.open("rb") as file:
        header = file.readline(1000).decode("utf-8-sig", "replace")
    mapping, names = find_mapping(path), set(re.findall(r"\w+", header.lower()))
    # With times it is a recording, of a sensor of three axes.
    return {"x", "y", "z"} <= names and (mapping is None or mapping.time.lower() not in names)


def _readable(paths: Sequence[Path], read: Callable[[Path], Any]) -> tuple[list[Path], list[Any]]:
    """Recordings that can be read and what was read, with a warning of each that cannot.

    Raises
    ------
    DataFormatError
        None can be read.
    """
    kept, found = [], []
    for path in paths:
        try:
            found.append(read(path))
            kept.append(path)
        except DataFormatError as error:
            if len(paths) == 1 or (path == paths[-1] and not kept):
                raise
            warn(f"left out: {error}", above=1)
    return kept, found


def robot_of(paths: Sequence[Path]) -> str:
    """What loads the one robot of some recordings; empty where none says.

    Raises
    ------
    SkinMismatchError
        Recordings of several robots.
    """
    said = {path: recorded_robot(path) for path in paths}
    names = {name: path for path, name in said.items() if name}
    if len(names) > 1:
        (a, one), (b, other), *_ = names.items()
        raise SkinMismatchError(f"two robots: {one} is of {a!r}, {other} of {b!r}")
    return next(iter(names), "")


def touched_in(
    paths: Sequence[Path],
    robot: Robot,
    skins: Mapping[str, PreparedSkin],
    open_one: Callable[[Path], Source],
    *,
    responses: Mapping[str, Response] | None = None,
    progress: Callable[[str], object] = lambda _: None,
) -> Touched:
    """Where the skins were touched in recordings.

    Parameters
    ----------
    paths : sequence of Path
    robot : Robot
    skins : mapping of str to PreparedSkin
        Parts that count; those that a recording lacks were not touched in it.
    open_one : callable
        Opens a recording as a source that gives samples as fast as it is asked.
    responses : mapping of str to Response, optional
        Response calibrations of parts that send raw values.
    progress : callable
        Told the name of each recording before it is read.

    Raises
    ------
    UnknownNameError, SkinMismatchError
        A recording without any of the parts, or of another skin.
    """
    found = Touched(skins)

    def add(path: Path) -> None:
        progress(path.name)
        source = open_one(path)
        shared = [part for part in source.info.parts if part in skins]
        if not shared:
            source.close()
            raise SkinMismatchError(
                f"{path}: parts {', '.join(source.info.parts)}, none of {', '.join(skins)}"
            )
        mine = {part: one for part, one in (responses or {}).items() if part in shared}
        loop = TouchLoop(robot, source, parts=shared, skins=skins, responses=mine)
        with closing(loop):
            loop.learn_rest(open_one(path))
            found.add(loop, path.name)

    _readable(paths, add)
    return found


def touch_stretches(loop: TouchLoop) -> Iterator[list[tuple[str, float, float]]]:
    """When each part of a loop was touched, without names: far faster than playing it.

    Yields
    ------
    list of (str, float, float)
        Part, beginning and end [s] of the stretches that ended in one block of samples; empty for
        most blocks, so that whoever reads can rest or stop.
    """
    ends = np.cumsum([len(skin) for skin in loop.skins.values()])[:-1]
    lasting: dict[str, tuple[float, float]] = {}
    for anew, times, touched, stuck in loop.touched_samples():
        over: list[tuple[str, float, float]] = []
        if anew:
            over, lasting = [(part, *own) for part, own in lasting.items()], {}
        found = np.split((touched > 0) & ~stuck, ends, axis=1)
        for part, on in zip(loop.skins, found, strict=True):
            for now in times[on.any(axis=1)].tolist():
                began, ended = lasting.get(part, (now, now))
                if now - ended > BRIDGE:
                    over.append((part, began, ended))
                    began = now
                lasting[part] = (began, now)
        yield [one for one in over if one[1] < one[2]]  # one sample alone is a spike
    yield [(part, *own) for part, own in lasting.items() if own[0] < own[1]]
