"""Recording while it happens: a bounded queue, a thread that writes, files that rotate.

A tap records the samples of a source on their way to a loop; `record` needs no loop.
"""

from __future__ import annotations

import contextlib
import glob
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.errors import (
    InvalidArrayError,
    OutputError,
    SkinError,
    SkinMismatchError,
    UnknownNameError,
    warn,
)
from skinmap.io.mcap.mcap_scan import scan_summary
from skinmap.io.mcap.reading import Index, read_head
from skinmap.io.mcap.writing import CHUNK_SECONDS, McapRecording, said_of
from skinmap.io.ros2.messages import TouchMarker
from skinmap.live.bounded_queue import BoundedQueue, QueueEnded
from skinmap.live.response.sample_checks import JUMP, SampleChecks, fall_of, odd_times
from skinmap.live.sources.open_source import open_source, resolve_robot
from skinmap.live.sources.source import (
    Block,
    Counts,
    Kind,
    Relay,
    Source,
    SourceEnded,
    StreamInfo,
    blocks,
    gather,
    is_live,
)
from skinmap.skin.robot import Robot

MAX_BYTES = 64 * 2**20  # waiting to be written: 5 minutes of a whole iCub at 50 Hz
BEHIND = 0.15  # seconds of samples that may wait where they come faster than
AHEAD = 0.05  # seconds before their time: all of a pause at once, as a busy machine gives them
HELD = 60.0  # a file stays open so long [s] after the next one began, for touches that it began
RESTART = 1.0  # of a step of time that counts, at most [s]
ROTATE_SECONDS = 3600.0
ROTATE_BYTES = 2**30


@dataclass(slots=True)
class RecorderCounts:
    """Counts of recorded samples by their fate.

    Attributes
    ----------
    written, dropped : int
        Samples in files, and those left out because the disk was too slow.
    waiting : int
        Bytes in the queue.
    """

    written: int = 0
    dropped: int = 0
    waiting: int = 0


class Recorder:
    """Writes what it is given into MCAP files, in a thread of its own.

    Parameters
    ----------
    path : Path
        The first file; later ones get a number: `touch.mcap`, `touch_0002.mcap`.
    info : StreamInfo
        Of the source.
    robot : Robot, optional
        Its skins are written into each file.
    widths : mapping of kind to tuple of int, optional
        Columns of kinds beside the source's own: pressures of a source of raw values.
    session, person : str
        When and by whom the touches are made, in words.
    rotate_bytes, rotate_seconds : float
        A file ends when it is so large or so old.
    most_bytes : int
        Kept while the disk is busy; more is dropped and counted.

    Raises
    ------
    OutputError
        The first file cannot be made.
    """

    def __init__(
        self,
        path: Path,
        info: StreamInfo,
        *,
        robot: Robot | None = None,
        widths: Mapping[Kind, tuple[int, ...]] | None = None,
        session: str = "",
        person: str = "",
        rotate_bytes: float = ROTATE_BYTES,
        rotate_seconds: float = ROTATE_SECONDS,
        most_bytes: int = MAX_BYTES,
    ) -> None:
        self.info, self.files = info, [path]
        self._session, self._person = session, person
        self.robot = robot
        self._widths: dict[Kind, tuple[int, ...]] = {**(widths or {}), info.kind: info.widths}
        self._rotate = (rotate_bytes, rotate_seconds)
        self._written = self._dropped = 0
        self._clock, self._last, self._ahead = time.monotonic, 0.0, 0.0
        self._given = self._saved = float("-inf")  # times of the last sample put, and in a file
        self._turn = threading.Lock()  # of who writes: the thread, or who gives what it cannot
        self._stuck = False  # the disk: nobody waits for it again before it has caught up
        self._jobs: BoundedQueue[Callable[[McapRecording], None]] = BoundedQueue(most_bytes)
        self._error: Exception | None = None
        self._newest = float("-inf")
        self._fall = fall_of(info.rate)  # of time, by which it starts again [s]
        self._first = float("nan")  # time of the first sample in the file that is written
        self._before: tuple[McapRecording, float, float] | None = None  # with its first and last
        self._file = self._open(path)
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    @property
    def counts(self) -> RecorderCounts:
        """What happened so far; a copy."""
        return RecorderCounts(self._written, self._dropped, self._jobs.size)

    def put(self, block: Block, kind: Kind | None = None, *, patience: float = 1.0) -> None:
        """Queue samples; drop and count them if the disk lags behind for longer than `patience`.

        Samples that come at once, as after a pause of a busy machine, are written here where more
        than `BEHIND` seconds of them wait: they would be lost at once, too. A disk that hangs does
        not hold up samples that come in their time.

        Raises
        ------
        SkinMismatchError
            Another number of channels than the stream's.
        OutputError
            Writing failed, now or before: a full disk, say.
        """
        kind = kind or self.info.kind
        channels = sum(self._widths[kind])
        if block.values.shape[1] != channels:
            raise SkinMismatchError(
                f"{block.values.shape[1]} {kind} values in a sample, stream {self.info.name!r} has "
                f"{channels} channels"
            )
        size = block.values.nbytes
        if not self._jobs.put(lambda _: self._write(kind, block), size, patience=patience):
            self._dropped += len(block)
        elif kind == self.info.kind and len(block):
            now, newest = self._clock(), float(block.times[-1])
            step = newest - self._given if newest > self._given > float("-inf") else 0.0
            self._ahead = max(self._ahead - (now - self._last), 0.0) + min(step, RESTART)
            self._last, self._given = now, newest
            if self._saved == float("-inf"):
                self._saved = float(block.times[0])
            if self._ahead > AHEAD and self._waits_long() and not self._stuck:
                self._save(patience)

    def _waits_long(self) -> bool:
        return self._given - self._saved > BEHIND

    def _save(self, patience: float) -> None:
        """Write what waits, in the thread of who gives samples."""
        with self._writing(patience) as mine:
            self._stuck = not mine
            with contextlib.suppress(QueueEnded):
                while mine and self._do_next():
                    pass
            if mine:
                self._flush()

    @contextlib.contextmanager
    def _writing(self, patience: float = -1.0) -> Iterator[bool]:
        """Whether it is one's turn to write; errors are kept for who gives the next sample."""
        got = self._turn.acquire(timeout=patience)
        try:
            yield got and self._error is None
        except QueueEnded:
            raise
        except Exception as error:  # noqa: BLE001 - the file is ended before another's turn
            self._fail(error)
        finally:
            if got:
                self._turn.release()

    def mark(self, part: str, event: int, label: str, **how: Any) -> None:
        """Queue a mark of a touch (see `McapRecording.mark`)."""
        self._jobs.put(lambda _: self._mark(part, event, label, **how), 0, patience=0.0)

    def _mark(
        self,
        part: str,
        event: int,
        label: str,
        *,
        began: float,
        ended: float | None = None,
        **how: Any,
    ) -> None:
        """Mark a touch in the files that hold its samples, in each from its first one there."""
        last = began if ended is None else ended
        here = self._first <= began and last <= self._newest
        if self._before is not None and not here:
            file, first, newest = self._before
            if first <= began <= newest:
                end = None if ended is None else min(ended, newest)
                file.mark(part, event, label, began=began, ended=end, **how)
                if not self._first <= last <= self._newest:
                    return
                began = self._first
        self._file.mark(part, event, label, began=began, ended=ended, **how)

    def show_touches(self, time: float, touches: Sequence[TouchMarker]) -> None:
        """Queue markers of what touches at a time [s]."""
        self._jobs.put(lambda file: file.show_touches(time, touches), 0, patience=0.0)

    def put_angles(self, time: float, angles: Mapping[str, float]) -> None:
        """Queue joint angles [rad]."""
        content = dict(angles)
        self._jobs.put(lambda file: file.add_angles(time, content), 0, patience=0.0)

    def close(self) -> None:
        """Write what waits and end the file; may be called twice.

        Raises
        ------
        OutputError
            Writing failed, now or before.
        """
        self._jobs.end(QueueEnded("the recording is over"))
        self._thread.join()
        if self._error is not None:
            raise self._error

    def _work(self) -> None:
        try:
            while self._error is None:
                age = self._file.age
                late = not self._jobs.wait(CHUNK_SECONDS - age if age else None)
                with self._writing() as mine:
                    if mine and late:  # what has waited long enough
                        self._flush()
                    elif mine and self._do_next() and not self._file.age:
                        self._saved = self._newest  # all of it is in closed chunks
                self._stuck = self._stuck and self._waits_long()
        except QueueEnded:
            with self._writing() as mine:
                if mine:
                    self._end_before()
                    self._file.close()
        except Exception as error:  # noqa: BLE001 - what the queue was ended with
            self._error = error

    def _do_next(self) -> bool:
        """Write what has waited longest; False where nothing waits. Only in one's turn."""
        job = self._jobs.take(0.0)
        if job is None:
            return False
        if self._is_full():
            self._next_file()
        job(self._file)
        return True

    def _flush(self) -> None:
        """Give the system all that was written. Only in one's turn."""
        if self._file.age:
            self._file.flush()
        self._saved = self._newest

    def _fail(self, error: Exception) -> None:
        """Keep the file readable, and raise the error at the next sample."""
        with contextlib.suppress(SkinError):
            self._end_before()
        with contextlib.suppress(SkinError):
            self._file.close()
        self._error = error
        self._jobs.end(error, at_once=True)

    def _write(self, kind: Kind, block: Block) -> None:
        for now, row in zip(block.times.tolist(), block.values, strict=True):
            if kind == self.info.kind:
                anew = now < self._newest - self._fall
                if anew:
                    self._next_file()
                self._newest = now if anew else max(now, self._newest)
                if self._first != self._first:
                    self._first = now
                elif self._before is not None and now > self._first + HELD:
                    self._end_before()
            self._file.add(kind, now, row)
            if kind == self.info.kind:
                self._written += 1

    def _is_full(self) -> bool:
        most_bytes, most_seconds = self._rotate
        return self._file.size >= most_bytes or time.monotonic() - self._opened >= most_seconds

    def _end_before(self) -> None:
        before, self._before = self._before, None
        if before is not None:
            before[0].close()

    def _next_file(self) -> None:
        self._end_before()
        if self._file.age:
            self._file.flush()
        self._before = self._file, self._first, self._newest
        self._first = float("nan")
        first = self.files[0]
        numbers = count(len(self.files) + 1)
        names = (first.with_name(f"{first.stem}_{k:04d}{first.suffix}") for k in numbers)
        path = next(path for path in names if not path.exists())  # of an earlier recording
        self._file = self._open(path)
        self.files.append(path)

    def _open(self, path: Path) -> McapRecording:
        self._opened = time.monotonic()
        return McapRecording(
            path,
            **said_of(self.info, self.robot),
            widths=self._widths,
            session=self._session,
            person=self._person,
            model=self.robot,
            continues="" if path == self.files[0] else self.files[0].name,
        )


def continued(path: Path) -> list[Path]:
    """The files that a recorder went on with after `path`; others with such a name are not."""
    found = path.parent.glob(f"{glob.escape(path.stem)}_[0-9][0-9][0-9][0-9]{path.suffix}")
    return [one for one in sorted(found) if _goes_on(one, path)]


def _goes_on(path: Path, first: Path) -> bool:
    try:
        head = read_head(scan_summary(path) or Index(path).found)
    except SkinError:
        return False
    return head.get("continues") == first.name


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
    looks : bool
        Whether samples are looked at here, as no loop does it: faults are counted and warned of.

    Attributes
    ----------
    kept : list of Block
        The first of the samples, to look at when the recording is over.
    unfit : Counts
        Samples of another number of values than the stream's: handed on, not recorded. And what
        else was found, where it looks.
    """

    def __init__(
        self,
        source: Source,
        recorder: Recorder,
        *,
        patience: float = 1.0,
        seconds: float | None = None,
        looks: bool = False,
    ) -> None:
        super().__init__(source)
        self.recorder, self._patience = recorder, patience
        self._seconds = float("inf") if seconds is None else seconds
        self._elapsed = 0.0  # without steps of the clock [s]
        self._last = self._arrived = float("nan")
        self._ended = False
        # When this machine's clock ends a source that falls silent.
        self._quiet: float | None = None
        self._later: float | None = None  # than the source says, as files know no time below 0 [s]
        self.unfit = Counts()
        self._checks: SampleChecks | None = None
        if looks:
            robot, seekable = recorder.robot, source.seekable
            skins = {part: robot.skin(part) for part in self.info.parts} if robot else {}
            taxels = gather(self.info, skins) if skins else None
            self._checks = SampleChecks(self.info, self.unfit, seekable=seekable, taxels=taxels)
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
            first = float(block.times[0])
            self._later = max(0.0, float(np.ceil(-first)))
            if self._later:
                said = f"times of {self.info.name!r} begin at {first:g} s"
                warn(f"{said}: recorded {self._later:g} s later")
        if self._later:
            block = Block(block.times + self._later, block.values, block.arrived)
        if (width := block.values.shape[1]) != self.info.channels:
            if not self._look(block):
                self.unfit.add_misfits(len(block), width, self.info.channels)
            return block
        elapsed = self._passed(block)
        if elapsed[-1] >= self._seconds - HAIR:
            self._ended = True
            if said := odd_times(self._step(block), self.info):
                warn(said)
            rows = elapsed < self._seconds - HAIR
            if not rows.any():
                raise SourceEnded
            block = Block(block.times[rows], block.values[rows], block.arrived)
        self._look(block)
        self._record_angles(block)  # first: clouds stand where the joints are
        self.recorder.put(block, patience=self._patience)
        if sum(map(len, self.kept)) < KEPT:
            self.kept.append(block)
        return block

    def _look(self, block: Block) -> bool:
        """Whether samples are looked at here."""
        for _ in self._checks.look(block) if self._checks else ():
            pass
        return self._checks is not None

    def _passed(self, block: Block) -> FloatArray:
        """Time (k,) of each sample since the first [s], without steps of the clock."""
        if self._last != self._last:
            self._quiet = time.monotonic() + self._seconds + GRACE
            self._last = float(block.times[0])
        steps = np.diff(block.times, prepend=self._last)
        stepped = steps < -fall_of(self.info.rate)
        # What is missing takes time; where none has passed here, only the clock went on.
        leap = float(steps.max()) - (block.arrived - self._arrived)
        if is_live(self.source) and leap > JUMP and not odd_times(self._step(block), self.info):
            leaps = steps > max(JUMP, 1.5 * self._step(block))
            stepped |= leaps
            if leaps.any() and np.isfinite(self._seconds):
                warn(f"the clock of {self.info.name!r} went on by {leap:.3g} s that did not pass")
        elapsed = self._elapsed + np.cumsum(np.where(stepped, 0.0, steps))
        self._last, self._arrived = float(block.times[-1]), block.arrived
        self._elapsed = float(elapsed[-1])
        return elapsed

    def _step(self, block: Block) -> float:
        """The usual step between samples so far [s]; 0 where only one came."""
        times = np.concatenate([*(one.times for one in self.kept), block.times])
        return float(np.median(np.diff(times))) if len(times) > 1 else 0.0

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
    if isinstance(source, str | Path):
        with closing(open_source(source, robot=loaded)) as origin:
            return record(origin, file, seconds, robot=loaded, replace=replace)
    for path in continued(file):
        path.unlink()  # of the recording that is replaced
    with closing(Recorder(file, source.info, robot=loaded)) as recorder:
        tap = RecordingTap(source, recorder, patience=PATIENCE, seconds=seconds, looks=True)
        for _ in blocks(tap):
            pass
    counts = recorder.counts
    return Recorded(tuple(recorder.files), counts.written, counts.dropped)
