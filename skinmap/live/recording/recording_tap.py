"""A source whose samples are recorded on their way, and recording without anything else."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skinmap.errors import InvalidArrayError, OutputError, SkinWarning, UnknownNameError
from skinmap.live.recording.recorder import Recorder, continued
from skinmap.live.response.sample_checks import fall_of, odd_times
from skinmap.live.sources.open_source import open_source, resolve_robot
from skinmap.live.sources.source import (
    Block,
    Counts,
    Relay,
    Source,
    SourceEnded,
    blocks,
    is_live,
)
from skinmap.skin.robot import Robot

GRACE = 2.0  # a live source that falls silent ends so long after its time [s]
PATIENCE = 60.0  # seconds to wait for a slow disk before a sample is dropped
KEPT = 6000  # samples from the beginning that are kept in memory
HAIR = 1e-6  # [s]; times are multiples of a step only nearly


class RecordingTap(Relay):
    """A source whose samples are recorded on their way; the recorder is closed on its own.

    Parameters
    ----------
    source : Source
    recorder : Recorder
    patience : float
        Seconds to wait for a slow disk before samples are dropped.
    seconds : float, optional
        Ends after these, in the source's clock.

    Attributes
    ----------
    kept : list of Block
        The first of the samples, to look at when the recording is over.
    unfit : Counts
        Samples of another number of values than the stream's: handed on, not recorded.
    """

    def __init__(
        self,
        source: Source,
        recorder: Recorder,
        *,
        patience: float = 1.0,
        seconds: float | None = None,
    ) -> None:
        super().__init__(source)
        self.recorder, self._patience = recorder, patience
        self._seconds = float("inf") if seconds is None else seconds
        self._end = self._last = float("inf")
        self._ended = False
        self._quiet: float | None = (
            None  # when this machine's clock ends a source that falls silent
        )
        self._later: float | None = None  # than the source says, as files know no time below 0 [s]
        self.unfit = Counts()
        self.kept: list[Block] = []
        self._angles: Mapping[str, float] = {}

    def read(self, timeout: float) -> Block | None:
        """What the source gives, recorded."""
        if self._ended:
            raise SourceEnded
        if self._quiet is None:
            self._quiet = time.monotonic() + self._seconds + GRACE
        block = self.source.read(timeout)
        if block is None or len(block) == 0:
            if is_live(self.source) and time.monotonic() > self._quiet:
                self._ended = True
            return None
        if self._later is None:
            self._later = self._shift(float(block.times[0]))
        if self._later:
            block = Block(block.times + self._later, block.values, block.arrived)
        if (width := block.values.shape[1]) != self.info.channels:
            name = "short" if width < self.info.channels else "long"
            setattr(self.unfit, name, getattr(self.unfit, name) + len(block))
            return block
        if self._end == float("inf"):
            self._quiet = time.monotonic() + self._seconds + GRACE
            self._end = float(block.times[0]) + self._seconds
        elif block.times[0] < self._last - fall_of(self.info.rate):  # the clock began anew
            self._end += float(block.times[0]) - self._last
        self._last = float(block.times[-1])
        if block.times[-1] >= self._end - HAIR:
            self._ended = True
            times = np.concatenate([*(one.times for one in self.kept), block.times])
            step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
            if said := odd_times(step, self.info):
                warnings.warn(said, SkinWarning, stacklevel=2)
            rows = block.times < self._end - HAIR
            if not rows.any():
                raise SourceEnded
            block = Block(block.times[rows], block.values[rows], block.arrived)
        self._record_angles(block)  # first: clouds stand where the joints are
        self.recorder.put(block, patience=self._patience)
        if sum(map(len, self.kept)) < KEPT:
            self.kept.append(block)
        return block

    def _shift(self, first: float) -> float:
        if first >= 0.0:
            return 0.0
        later = float(np.ceil(-first))
        warnings.warn(
            f"times of {self.info.name!r} begin at {first:g} s: recorded {later:g} s later",
            SkinWarning,
            stacklevel=2,
        )
        return later

    def angles_at(self, time: float) -> Mapping[str, float]:
        """Joint angles [rad] of the source at a time of what this gives [s]."""
        return self.source.angles_at(time - (self._later or 0.0))

    def _record_angles(self, block: Block) -> None:
        """Record joint angles where the source has them and they changed."""
        for now in block.times.tolist():
            angles = self.angles_at(now)
            if angles != self._angles:
                self._angles = angles
                self.recorder.put_angles(now, angles)


@dataclass(frozen=True, slots=True)
class Recorded:
    """What a recording became.

    Attributes
    ----------
    files : tuple of Path
        One, or more where a file grew too large.
    samples, dropped : int
        Written, and left out because the disk was too slow.
    """

    files: tuple[Path, ...]
    samples: int
    dropped: int


def record(
    source: Source | str | Path,
    path: str | Path,
    seconds: float | None = None,
    *,
    robot: Robot | str | None = None,
    replace: bool = False,
) -> Recorded:
    """Record what a source sends into an MCAP file.

    Parameters
    ----------
    source : Source, str or Path
        As `skinmap.open_source` gives or takes it. One that is open already stays open.
    path : str or Path
        File to write, ending in .mcap.
    seconds : float, optional
        Stop after these, in the source's clock [s]; else when the source ends.
    robot : Robot or str, optional
        Whose skins the file should hold.
    replace : bool
        Whether a file that is there may be replaced.

    Returns
    -------
    Recorded
        Files, and counts of samples.

    Raises
    ------
    UnknownNameError
        A source that does not exist, or a path of another suffix.
    InvalidArrayError
        Seconds that are not above 0.
    OutputError
        The file is there already, or cannot be written.
    SkinMismatchError
        A source of another skin than the robot's.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> source = skinmap.open_source("sim", robot=robot, parts=["torso"], speed=float("inf"))
    >>> recorded = skinmap.record(source, "touches.mcap", seconds=1.0, robot=robot)
    >>> recorded.samples
    50
    >>> source.close()
    """
    file = Path(path)
    if file.suffix.lower() != ".mcap":
        raise UnknownNameError("format to record in for files ending in", file.suffix, [".mcap"])
    if seconds is not None and not seconds > 0:
        raise InvalidArrayError(f"seconds must be above 0, got {seconds}")
    for path in (file, *continued(file)):
        if path.exists() and not replace:
            raise OutputError(f"{str(path)!r} exists already")
    loaded = resolve_robot(robot)
    opened = isinstance(source, str | Path)
    origin = open_source(source, robot=loaded) if isinstance(source, str | Path) else source
    try:
        for path in continued(file):
            path.unlink()  # of the recording that is replaced
        with closing(Recorder(file, origin.info, robot=loaded)) as recorder:
            for _ in blocks(RecordingTap(origin, recorder, patience=PATIENCE, seconds=seconds)):
                pass
    finally:
        if opened:
            origin.close()
    counts = recorder.counts
    return Recorded(tuple(recorder.files), counts.written, counts.dropped)
