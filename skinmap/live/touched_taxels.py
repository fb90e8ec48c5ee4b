"""Where a skin was touched over a recording or many: how often, how long, how hard, when last."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import MissingFileError, SkinMismatchError
from skinmap.io.recordings.readers import recorded_robot
from skinmap.live.loop import TouchLoop
from skinmap.live.response.pressures import Response
from skinmap.live.sources.source import Source
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import PreparedSkin

BRIDGE = 0.1  # a taxel that is not touched for longer is touched anew [s], as contacts are
LEARN = 10.0  # as long as it may take to know that a taxel is stuck [s]
LONGEST = 0.2  # that a sample stands for: what comes later comes after a gap [s]
LEAST = 2  # samples of a touch: one alone is a spike
SUFFIXES = (".mcap", ".npz", ".xdf", ".xdfz", ".log", ".db3")
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
        unseen = np.full(n, np.nan)
        return cls(
            np.zeros(n, np.int64), np.zeros(n), np.zeros(n), unseen, np.full(n, -1, np.int64)
        )


@dataclass(eq=False, slots=True)
class _Run:
    """A touch of one taxel that lasts."""

    begun: float
    last: float
    samples: int
    dwell: float
    largest: float


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
    seconds : float
        That were watched.
    """

    skins: Mapping[str, PreparedSkin]
    parts: dict[str, TouchedPart] = field(default_factory=dict)
    recordings: list[str] = field(default_factory=list)
    seconds: float = 0.0

    def add(self, loop: TouchLoop, name: str) -> None:
        """Add all that a loop's source has; the loop has learnt what hangs."""
        number, first = len(self.recordings), math.nan
        self.recordings.append(name)
        runs: dict[int, _Run] = {}
        for part, skin in loop.skins.items():
            self.parts.setdefault(part, TouchedPart.of(len(skin)))
        owner = [(part, row) for part, skin in loop.skins.items() for row in range(len(skin))]
        step, before = 1.0 / loop.info.rate if loop.info.rate > 0 else 0.02, math.nan

        def over(taxel: int) -> None:
            run = runs.pop(taxel)
            if run.samples < LEAST:
                return
            part, row = owner[taxel]
            mine = self.parts[part]
            mine.count[row] += 1
            mine.dwell[row] += run.dwell
            mine.largest[row] = max(mine.largest[row], run.largest)
            mine.last[row], mine.recording[row] = run.last - first, number

        for anew, times, touched, stuck in loop.touched_samples():
            if anew:
                for taxel in list(runs):
                    over(taxel)
                before = math.nan
            first = float(times[0]) if math.isnan(first) else first
            spans = np.diff(times, prepend=times[0] - step if math.isnan(before) else before)
            spans = np.clip(np.where(spans > LONGEST, step, spans), 0.0, LONGEST)
            self.seconds += float(spans.sum())
            before = float(times[-1])
            for taxel in [one for one in runs if stuck[one]]:
                del runs[taxel]  # what hangs was no touch
            on = touched > 0
            on[:, stuck] = False
            for taxel in np.flatnonzero(on.any(axis=0)).tolist():
                rows = np.flatnonzero(on[:, taxel])
                self._follow(runs, taxel, times[rows], spans[rows], touched[rows, taxel], over)
        for taxel in list(runs):
            over(taxel)

    def _follow(
        self,
        runs: dict[int, _Run],
        taxel: int,
        times: FloatArray,
        spans: FloatArray,
        values: NDArray[Any],
        over: Callable[[int], None],
    ) -> None:
        """Go on with the touch of a taxel, or begin others, by samples (k,) that are touched."""
        run = runs.get(taxel)
        gaps = np.diff(times, prepend=times[0] if run is None else run.last)
        starts = np.flatnonzero(gaps - spans > BRIDGE)
        for piece in np.split(np.arange(len(times)), starts):
            if not len(piece):
                continue
            if piece[0] in starts and taxel in runs:
                over(taxel)
            run = runs.get(taxel)
            if run is None:
                begun = float(times[piece[0]])
                run = runs[taxel] = _Run(begun, begun, 0, 0.0, 0.0)
            run.last, run.samples = float(times[piece[-1]]), run.samples + len(piece)
            run.dwell += float(spans[piece].sum())
            run.largest = max(run.largest, float(values[piece].max()))

    def csv(self) -> str:
        """A line for each taxel of each part, see `COLUMNS`."""
        lines = [COLUMNS]
        for part, one in self.parts.items():
            channels = self.skins[part].skin.channels.tolist()
            for row, channel in enumerate(channels):
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

    Raises
    ------
    MissingFileError
        A folder without any.
    """
    from skinmap.io.ros2.bag import is_bag

    if not path.is_dir() or (path / "data.log").exists() or is_bag(path):
        return [path]
    found = sorted(
        one
        for one in path.rglob("*")
        if one.suffix.lower() in SUFFIXES
        and one.is_file()
        and not any(word.startswith(".") for word in one.relative_to(path).parts)
    )
    if not found:
        raise MissingFileError(path, f"recordings ({', '.join(SUFFIXES)}) in this folder")
    return found


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
    for path in paths:
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
        try:
            with closing(open_one(path)) as ahead:
                loop.learn_rest(ahead, LEARN)
            found.add(loop, path.name)
        finally:
            loop.close()
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
